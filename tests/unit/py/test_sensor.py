"""The simulated sensor's physics."""

import cv2
import numpy as np
import pytest
from lightprobe.colour import srgb_table
from lightprobe.sim.sensor import Sensor, SensorModel, encode_jpeg

MODEL = SensorModel(full_well_e=10000, read_noise_e=4)
LINEAR = srgb_table()


def flat(value, shape=(256, 256)):
    return np.full((*shape, 3), value, np.float32)


@pytest.fixture(scope="module")
def sensor():
    """A response with a step a quarter as large as the noise, so that rounding does not matter."""
    table = np.repeat(np.linspace(0, 1, 256)[:, None], 3, 1)
    return Sensor(256, 256, MODEL, response=table, seed=1)


@pytest.mark.parametrize("radiance", [0.05, 0.2, 0.5, 0.9])
def test_photon_and_read_noise(sensor, radiance):
    codes = sensor.capture(flat(radiance), 1e6) / 255
    electrons = radiance * MODEL.full_well_e
    sigma = np.sqrt(electrons + MODEL.read_noise_e**2) / MODEL.full_well_e
    assert codes.mean() == pytest.approx(radiance, abs=3e-4)
    rounding = 1 / 255 / np.sqrt(12)
    assert codes.std() == pytest.approx(np.hypot(sigma, rounding), rel=0.03)


def test_exposure_and_gain_scale_the_signal(sensor):
    assert (sensor.capture(flat(4.0), 0.05e6) / 255).mean() == pytest.approx(0.2, abs=1e-3)
    gained = sensor.capture(flat(0.05), 1e6, gain=4.0) / 255
    assert gained.mean() == pytest.approx(0.2, abs=1e-3)
    sigma = 4 * np.sqrt(0.05 * MODEL.full_well_e + MODEL.read_noise_e**2) / MODEL.full_well_e
    assert gained.std() == pytest.approx(sigma, rel=0.03)


def test_saturation_and_black(sensor):
    assert np.all(sensor.capture(flat(1e9), 1e6) == 255)
    assert sensor.capture(flat(0), 1e6).mean() < 0.3


def test_srgb_codes(sensor):
    srgb = Sensor(256, 256, MODEL, seed=1)
    mean = LINEAR[srgb.capture(flat(0.18), 1e6)].mean()
    assert mean == pytest.approx(0.18, abs=5e-4)


def test_noise_repeats_by_seed_and_frame_and_else_differs():
    make = lambda seed, frame: Sensor(64, 32, MODEL, seed=seed).capture(  # noqa: E731
        flat(0.3, (32, 64)), 1e6, frame
    )
    assert np.array_equal(make(5, 9), make(5, 9))
    assert not np.array_equal(make(5, 9), make(5, 10))
    assert not np.array_equal(make(5, 9), make(6, 9))


def test_turned_frame_is_rolled_but_its_noise_is_not():
    sensor = Sensor(64, 32, SensorModel(read_noise_e=1e-3, full_well_e=1e9), seed=0)
    ramp = np.broadcast_to(np.linspace(0.1, 0.9, 64, dtype=np.float32)[None, :, None], (32, 64, 3))
    expected = sensor.expect(ramp, 1e6)
    assert np.array_equal(
        sensor.develop(expected, 0, turn_px=10), np.roll(sensor.develop(expected, 0), 10, axis=1)
    )
    noisy = Sensor(64, 32, MODEL, seed=0)
    even = noisy.expect(flat(0.4, (32, 64)), 1e6)
    assert np.array_equal(noisy.develop(even, 3, turn_px=10), noisy.develop(even, 3))


@pytest.mark.parametrize("chroma", ["420", "422", "444"])
def test_jpeg(chroma):
    codes = np.zeros((32, 64, 3), np.uint8)
    codes[:, :32, 0] = 200
    data = encode_jpeg(codes, 95, chroma)
    seen = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert seen[16, 8] == pytest.approx([200, 0, 0], abs=6)
    assert seen[16, 56] == pytest.approx([0, 0, 0], abs=6)
