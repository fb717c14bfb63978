"""What a camera does to its pictures by itself: each step does what its name says."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from lightprobe.colour import srgb_table
from lightprobe.errors import UsageError
from lightprobe.imaging import camera as lenses
from lightprobe.sim import response as responses
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.lens_defects import LensDefects
from lightprobe.sim.osc.camera import OscCamera
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.processing import (
    Developer,
    Processing,
    saturated,
    sharpened,
    stitched,
    tone_mapped,
)
from lightprobe.sim.sensor import Sensor, SensorModel
from lightprobe.sim.world import Behaviour, World

SIZE, SHOT = (256, 128), Shot(1e6)
FISHEYE = Path(__file__).resolve().parents[3] / "packaging/cameras/theta_s.camera"
MODEL = SensorModel(full_well_e=50000, read_noise_e=1)
NOISY = SensorModel(full_well_e=2000, read_noise_e=5)
LINEAR = srgb_table()
#: Each kind at a strength that shows.
KINDS = [
    "exposure_tear=0.5", "white_drift=0.1", "white_adapt=1", "denoise=5", "denoise_time=0.8",
    "stitch_gain=0.1", "stitch_deg=3", "tone_ev=1", "saturation=1.5", "sharpen=0.7", "jpeg_kb=4",
]  # fmt: skip


def developer(query: str, pixel_format: str = "MJPG", model: SensorModel = MODEL) -> Developer:
    sensor = Sensor(*SIZE, model, seed=3)
    processing = Processing().merged(query)
    return Developer(processing, sensor, lenses.equirect(), pixel_format, 100, "444")


def flat(*value: float) -> Any:
    return np.full((SIZE[1], SIZE[0], 3), value, np.float32)


def pictures(made: Developer, radiance: Any, count: int = 1, rate_hz: float = 10.0) -> list[Any]:
    """Codes of frames, the first one at 0 s."""
    signal = made.sensor.expect(radiance, SHOT.exposure_us)
    return [codes(made.picture(signal, n, SHOT, 0, n / rate_hz)) for n in range(count)]


def codes(payload: bytes) -> Any:
    bgr = cv2.imdecode(np.frombuffer(payload, np.uint8), cv2.IMREAD_COLOR)
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)


def linear(picture: Any) -> Any:
    return LINEAR[picture]


def camera(query: str, behaviour: Behaviour | None = None, **more: Any) -> SimulatedCamera:
    scene = random_scene(3).scaled(20.0)
    world = World([scene], behaviour or Behaviour(act_s=0))
    return SimulatedCamera(
        world, lenses.equirect(), SIZE, rate_hz=10, processing=Processing().merged(query), **more
    )


def shots(count: int) -> list[Shot]:
    return [Shot(10000.0 if n % 2 else 40000.0) for n in range(count)]


def test_linear_light_and_response_make_what_one_table_makes() -> None:
    sensor = Sensor(*SIZE, SensorModel(), seed=3)
    radiance = np.linspace(0, 1.3, SIZE[1] * SIZE[0] * 3, dtype=np.float32)
    signal = sensor.expect(radiance.reshape(SIZE[1], SIZE[0], 3), 1e6)
    apart = sensor.respond(sensor.linear(signal, 5, turn_px=7))
    assert np.abs(apart.astype(int) - sensor.develop(signal, 5, turn_px=7)).max() <= 1
    assert np.mean(apart != sensor.develop(signal, 5, turn_px=7)) < 0.01


def test_white_balance_is_at_each_time_what_it_says() -> None:
    made = developer("white_drift=0.06&white_drift_s=20")
    for t_s, red, blue in ((0.0, 1.0, 1.0), (5.0, 1.06, 0.94), (15.0, 0.94, 1.06)):
        signal = made.sensor.expect(flat(0.3, 0.3, 0.3), SHOT.exposure_us)
        mean = linear(codes(made.picture(signal, 0, SHOT, 0, t_s))).mean(axis=(0, 1))
        assert mean / 0.3 == pytest.approx([red, 1, blue], abs=0.01)
    clipped = made.picture(made.sensor.expect(flat(9, 9, 9), 1e6), 0, SHOT, 0, 15.0)
    assert np.all(codes(clipped) >= 254)  # white stays white


def test_white_balance_adapts_to_what_it_sees_in_the_stated_time() -> None:
    made = developer("white_adapt=1&white_adapt_s=2")
    seen = [linear(one).mean(axis=(0, 1)) for one in pictures(made, flat(0.4, 0.2, 0.1), 100)]
    assert seen[0] == pytest.approx([0.4, 0.2, 0.1], rel=0.02)
    assert seen[-1] == pytest.approx([0.2, 0.2, 0.2], rel=0.02)
    ratio = np.log(seen[20][0] / seen[20][1]) / np.log(2)  # after 2 s 1/e is left
    assert ratio == pytest.approx(np.exp(-1), abs=0.04)
    half = pictures(developer("white_adapt=0.5&white_adapt_s=0.1"), flat(0.4, 0.2, 0.1), 30)[-1]
    assert linear(half).mean(axis=(0, 1)) == pytest.approx(
        [0.4 / 2**0.5, 0.2, 0.1 * 2**0.5], rel=0.02
    )


def test_noise_reduction_takes_noise_and_leaves_edges() -> None:
    step = flat(0.05, 0.05, 0.05)
    step[:, SIZE[0] // 2 :] = 0.4
    step[:, -16:] = 0.05
    middle = SIZE[0] // 2
    plain = pictures(developer("saturation=1.0001", model=NOISY), step)[0].astype(float)
    quiet = pictures(developer("denoise=8&denoise_px=3", model=NOISY), step)[0].astype(float)
    inside = np.s_[20:-20, middle + 10 : middle + 80]
    assert quiet[inside].std() < 0.5 * plain[inside].std()
    jump = [one[:, middle + 1].mean() - one[:, middle - 2].mean() for one in (plain, quiet)]
    assert jump[1] == pytest.approx(jump[0], rel=0.03)


def test_successive_pictures_are_blended_but_not_what_moves() -> None:
    made = developer("denoise_time=0.8", "YUYV", NOISY)
    grey = made.sensor.expect(flat(0.2, 0.2, 0.2), 1e6)
    bright = made.sensor.expect(flat(0.6, 0.6, 0.6), 1e6)

    def luma(signal: Any, number: int) -> Any:
        payload = made.picture(signal, number, SHOT, 0, number / 10)
        return np.frombuffer(payload, np.uint8).reshape(SIZE[1], SIZE[0], 2)[..., 0].astype(float)

    noise = [luma(grey, n).std() for n in range(12)]
    assert noise[-1] < 0.7 * noise[0]
    changed = luma(bright, 12)
    plain = np.interp(0.6, LINEAR, np.arange(256))
    assert changed.mean() == pytest.approx(plain, abs=1)


def test_sharpening_overshoots_an_edge_by_the_stated_share() -> None:
    step = np.full((*SIZE[::-1], 3), 80, np.uint8)
    step[:, 128:] = 120
    wide = sharpened(step, 0.7, 1.3).astype(int)
    # Beside a step of 40 a blur is off by 40 Φ(-0.5 / 1.3) = 14, of which 0.7 is added.
    assert wide[64, 128, 0] - 120 == pytest.approx(0.7 * 14, abs=1)
    assert 80 - wide[64, 127, 0] == pytest.approx(0.7 * 14, abs=1)
    assert np.all(wide[:, :100] == 80)
    assert sharpened(step, 1.4, 1.3)[64, 128, 0] - 120 == pytest.approx(1.4 * 14, abs=1)
    seen = pictures(developer("sharpen=0.7"), _step_of_light())[0].astype(int)
    plain = pictures(developer("saturation=1.0001"), _step_of_light())[0].astype(int)
    assert seen[:, 128].mean() > plain[:, 128].mean() + 5


def _step_of_light() -> Any:
    step = flat(0.08, 0.08, 0.08)
    step[:, SIZE[0] // 2 :] = 0.2
    return step


def test_tone_mapping_depends_on_the_surroundings_and_is_no_more_than_stated() -> None:
    def patch(around: float) -> float:
        picture = flat(0.2, 0.2, 0.2)
        picture[:, :128] = around
        picture[62:66, 62:66] = 0.05
        return float(tone_mapped(picture, 1.0, 25.0)[64, 64, 0])

    dark, bright = patch(0.02), patch(0.8)
    assert dark > 1.3 * 0.05 > 0.05 > 1.2 * bright
    assert dark < 2 * 0.05
    assert bright > 0.05 / 2
    ends = tone_mapped(np.stack([flat(0, 0, 0), flat(1, 1, 1)])[:, 0], 1.0, 10.0)
    assert np.all(ends[0] == 0)
    assert np.all(ends[1] == 1)


def test_tone_mapping_may_keep_the_mean_or_aim_at_a_level() -> None:
    dim = flat(0.01, 0.01, 0.01)
    assert tone_mapped(dim, 1.0, 10.0) == pytest.approx(dim, rel=1e-3)
    raised = tone_mapped(dim, 1.0, 10.0, aim=0.18)
    assert raised[0, 0, 0] / 0.01 == pytest.approx(2 ** np.tanh(np.log2(18) / 2), rel=0.03)


def test_a_pixel_is_not_linear_in_exposure_where_tones_are_mapped() -> None:
    """What a camera's check would find: the ratio of two exposures differs from place to place."""
    made = developer("tone_ev=1&tone_aim=0.18")
    picture = flat(0.01, 0.01, 0.01)
    picture[:, :128] = 0.1
    ratios = []
    for column in (64, 192):
        long, short = (
            linear(codes(made.picture(made.sensor.expect(picture, us), 0, SHOT, 0, 0)))
            for us in (4e6, 1e6)
        )
        ratios.append(long[:, column].mean() / short[:, column].mean())
    assert abs(ratios[0] / ratios[1] - 1) > 0.1


def test_two_lenses_differ_by_the_stated_gain() -> None:
    grey = stitched(flat(0.5, 0.5, 0.5), 0.06, 0.0)[0, :, 0]
    assert grey[SIZE[0] // 2] / grey[0] == pytest.approx(1.03 / 0.97, rel=1e-4)
    assert grey[SIZE[0] // 4] == pytest.approx(0.5, rel=0.01)  # the seam is between
    assert np.all(stitched(flat(1, 1, 1), 0.06, 0.0) == 1)  # and what clips, clips


def test_near_things_are_doubled_at_the_seam_by_the_stated_angle_and_nowhere_else() -> None:
    width = 3600  # a tenth of a degree to a column
    longitude = (np.arange(width) + 0.5) / 10 - 180
    for at in (-90, 90):
        line = np.exp(-0.5 * ((longitude - at) / 0.2) ** 2).astype(np.float32)
        row = stitched(np.repeat(line[None, :, None], 3, 2), 0.0, 2.0)[0, :, 0]
        peaks = [k for k in range(1, width - 1) if row[k - 1] < row[k] >= row[k + 1] > 0.2]
        assert len(peaks) == 2
        assert longitude[peaks[1]] - longitude[peaks[0]] == pytest.approx(2.0, abs=0.15)
        assert row[peaks] == pytest.approx([0.375, 0.375], abs=0.06)
    ahead = np.exp(-0.5 * (longitude / 0.2) ** 2).astype(np.float32)
    away = np.repeat(ahead[None, :, None], 3, 2)
    assert stitched(away, 0.0, 2.0) == pytest.approx(away, abs=1e-6)


def test_saturation_spreads_colours_and_keeps_luma_and_grey() -> None:
    picture = np.full((*SIZE[::-1], 3), (120, 100, 90), np.uint8)
    more = saturated(picture, 1.5)[0, 0].astype(int)
    luma = np.array([0.299, 0.587, 0.114])
    assert more @ luma == pytest.approx(picture[0, 0] @ luma, abs=1)
    assert more[0] - more[2] == pytest.approx(45, abs=1)
    assert np.ptp(saturated(picture, 0.0)[0, 0]) <= 1
    grey = np.full((*SIZE[::-1], 3), 77, np.uint8)
    assert np.array_equal(saturated(grey, 2.0), grey)


def test_rate_control_keeps_frames_below_a_size_and_lets_quality_rise_again() -> None:
    rng = np.random.default_rng(1)
    busy = rng.uniform(0, 1, (SIZE[1], SIZE[0], 3)).astype(np.float32)
    made, free = developer("jpeg_kb=30"), developer("saturation=1.0001")
    signals = [made.sensor.expect(one, 1e6) for one in (busy, flat(0.2, 0.2, 0.2))]
    assert len(free.picture(signals[0], 0, SHOT, 0, 0)) > 60000
    few = [len(made.picture(signals[0], n, SHOT, 0, n / 10)) for n in range(5)]
    assert max(few) <= 30000
    assert min(few[1:]) > 20000  # no less than it must
    calm = [len(made.picture(signals[1], n, SHOT, 0, n / 10)) for n in range(100)]
    wanted = [len(free.picture(signals[1], n, SHOT, 0, n / 10)) for n in (0, 99)]
    assert calm[0] < 0.9 * wanted[0]  # it has not risen yet
    assert calm[-1] == pytest.approx(wanted[1], rel=0.02)


def test_rows_of_a_torn_frame_have_the_exposure_of_the_frame_before() -> None:
    torn, plain = camera("exposure_tear=0.25"), camera("")
    seen = [codes(torn.frame(n, shot)) for n, shot in enumerate(shots(2))]
    before, now = (codes(plain.frame(1, shot)) for shot in shots(2))
    rows = SIZE[1] // 4
    assert np.abs(seen[1][: rows - 16].astype(int) - before[: rows - 16]).mean() < 1
    assert np.abs(seen[1][rows + 16 :].astype(int) - now[rows + 16 :]).mean() < 1
    assert np.abs(before[: rows - 16].astype(int) - now[: rows - 16]).mean() > 20
    same = codes(torn.frame(2, shots(2)[1]))  # the exposure has not changed
    assert np.abs(same.astype(int) - codes(plain.frame(2, shots(2)[1]))).max() <= 1


@pytest.mark.parametrize("kind", KINDS)
def test_each_shows_in_pictures_and_repeats_exactly(kind: str) -> None:
    turning = Behaviour(act_s=0, turn_deg_s=30)
    makers = [camera(kind, turning), camera(kind, turning), camera("", turning)]
    first, second, plain = (
        [made.frame(n, shot) for n, shot in enumerate(shots(4))] for made in makers
    )
    assert first == second
    assert first != plain


def test_none_of_it_changes_no_byte() -> None:
    for more in ({"pixel_format": "MJPG"}, {"pixel_format": "NV12"}, {"pixel_format": "RGBF"}):
        made = camera("sharpen_px=4&tone_deg=30&white_drift_s=3", None, **more)
        plain = SimulatedCamera(made.world, lenses.equirect(), SIZE, rate_hz=10, **more)
        for n, shot in enumerate(shots(3)):
            assert made.frame(n, shot) == plain.frame(n, shot)


def test_a_theta_on_the_network_does_it_too() -> None:
    world = World([random_scene(3).scaled(20.0)], Behaviour(act_s=0))
    found = [
        OscCamera(world, processing=processing, lens_defects=defects)._optics(SIZE, 10.0)
        for processing, defects in (
            (None, None),
            (Processing(sharpen=0.7), None),
            (None, LensDefects(glare=0.1)),
        )
    ]
    assert len({made.frame(0, Shot(10000)) for made in found}) == 3


def test_it_comes_and_goes_and_no_picture_is_kept_that_it_changes() -> None:
    made = camera("white_drift=0.1&white_drift_s=4&from_s=1&to_s=2", kept=1)
    plain, shot = camera(""), Shot(10000)
    differs = [made.frame(n, shot) != plain.frame(n, shot) for n in range(30)]
    assert not any(differs[:9])
    assert all(differs[11:19])
    assert not any(differs[21:])
    turned = camera("white_drift=0.1&white_drift_s=4", kept=1)
    assert len({turned.frame(n, shots(1)[0]) for n in range(8)}) == 8


def test_a_response_may_be_a_power_of_the_one_that_is_believed() -> None:
    assert responses.parse("srgb:1.04") == pytest.approx(responses.parse("srgb") ** 1.04)
    with pytest.raises(UsageError, match="response srgb:9: expected numbers"):
        responses.parse("srgb:9")


def test_what_a_camera_has_not_is_refused() -> None:
    with pytest.raises(UsageError, match="processing: RGBF has no sensor"):
        camera("sharpen=1", pixel_format="RGBF")
    with pytest.raises(UsageError, match="processing: jpeg_kb: NV12 has no quality"):
        camera("jpeg_kb=20", pixel_format="NV12")
    with pytest.raises(UsageError, match="is not stitched: take --camera equirect"):
        SimulatedCamera(
            World([random_scene(3)]), lenses.load(str(FISHEYE)), SIZE,
            processing=Processing(stitch_gain=0.1),
        )  # fmt: skip
    with pytest.raises(UsageError, match="processing: unknown option sharp: known are"):
        Processing().merged("sharp=1")
    with pytest.raises(UsageError, match="processing: tone_ev=9: expected a number, 0…4"):
        Processing().merged("tone_ev=9")


def test_gain_of_the_frame_before_counts_as_light_does() -> None:
    made = developer("exposure_tear=0.5")
    assert made.torn_from(Shot(1000, 4.0), 0.0) is None
    torn = made.torn_from(Shot(1000, 2.0), 0.1)
    assert torn == (Shot(2000, 2.0), SIZE[1] // 2)
    assert made.torn_from(Shot(1000, 2.0), 0.2) is None
    late = developer("exposure_tear=0.5&from_s=5")
    late.torn_from(SHOT, 0)
    assert late.torn_from(replace(SHOT, gain=2.0), 1.0) is None
