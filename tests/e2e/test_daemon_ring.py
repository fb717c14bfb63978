"""The ring of light sensors in the daemon: alone, and beside a camera."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from harness import STALE, Daemon, camera, jpeg, panorama, run, streaming
from lightprobe import daemon
from lightprobe.calibrate import ring
from lightprobe.errors import UsageError
from lightprobe.estimate import LightFlag
from lightprobe.evaluate import offline
from lightprobe.evaluate.evaluation import Input, Studio, reference
from lightprobe.evaluate.ring_model import CD_M2_PER_UNIT
from lightprobe.sim import illuminance
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.sensor import encode_jpeg

pytestmark = pytest.mark.many_frames

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
UNDEREXPOSED, RING_ONLY, RING_FAULT, COVERED = 8, 512, 2048, 65536
DIRECTION = np.array([0.6, 0.8, 0.0])
#: One lamp of 400 lx in an even surround of 50 cd/m².
LUX = ",".join(f"{np.pi * 50 + 400 * max(n @ DIRECTION, 0):.6g}" for n in ring.directions())


def test_a_ring_alone_gives_light():
    with (
        Daemon(f"--ring=sim:?lux={LUX}", "--ttl-ms=100") as daemon,
        daemon.client(smoothing="RAW") as client,
    ):
        hello = client.next()
        assert (hello.source, hello.has_ring) == ("none", True)
        estimate = client.until(lambda e: e.flags & RING_ONLY)
        assert estimate.flags & ~STALE == RING_ONLY
        assert estimate.cd_m2_per_unit == 1
        (light,) = estimate.lights
        assert np.degrees(np.arccos(DIRECTION @ light.direction)) < 1
        assert light.irradiance[0] == pytest.approx(400, rel=0.02)
        assert light.flags == 8
        ambient = estimate.sh.coefficients[0] / np.sqrt(4 * np.pi)
        assert ambient == pytest.approx(50, rel=0.03)


def test_without_camera_and_ring_there_is_no_light():
    status, _, log = run()
    assert status == 2
    assert "--ring=URI" in log


def test_the_camera_comes_first_and_the_ring_takes_over():
    with (
        camera() as cam,
        Daemon(f"--source=sim:{cam.path}", f"--ring=sim:?lux={LUX}", "--ttl-ms=300") as daemon,
        daemon.client() as client,
    ):
        cam.accept()
        client.until(lambda e: e.flags & RING_ONLY)  # no frame yet
        cam.send(jpeg(panorama()), exposure_us=2000)
        client.until(lambda e: not e.flags & RING_ONLY)
        client.until(lambda e: e.flags & RING_ONLY)


def is_the_lamp(light):
    assert np.degrees(np.arccos(DIRECTION @ light.direction)) < 1
    assert light.irradiance[0] == pytest.approx(400 / 150, rel=0.02)
    assert light.flags == 8


def test_a_covered_lens_leaves_the_light_to_the_ring():
    """From the first frame on, and with what the map knew before; then the camera sees again."""
    black = jpeg(np.full((64, 128, 3), 1, np.uint8))
    with (
        camera() as cam,
        Daemon(
            f"--source=sim:{cam.path}", f"--ring=sim:?lux={LUX}", "--cd-m2-per-unit=150"
        ) as daemon,
        daemon.client(smoothing="RAW", health_period_ms=100) as client,
    ):
        cam.accept()
        with streaming(cam, black, exposure_us=8000):
            estimate = client.until(lambda e: e.flags & RING_ONLY and not e.flags & STALE)
            assert estimate.flags & COVERED
            (light,) = estimate.lights
            is_the_lamp(light)
            assert 0.15 < estimate.relighting_sigma_permille / 1000 < 0.5
            health = client.until(
                lambda h: any(fault.id == "lens-covered" for fault in h.faults), "health"
            )
            fault = next(fault for fault in health.faults if fault.id == "lens-covered")
            assert "is the lens covered" in fault.text
            assert not client.until(lambda e: True).flags & RING_FAULT
        with streaming(cam, jpeg(panorama()), exposure_us=8000):
            client.until(lambda e: not e.flags & (RING_ONLY | COVERED))
            client.until(lambda h: all(f.id != "lens-covered" for f in h.faults), "health")
        with streaming(cam, black, exposure_us=8000):
            estimate = client.until(lambda e: e.flags & UNDEREXPOSED)
            assert estimate.flags & (RING_ONLY | COVERED) == RING_ONLY | COVERED
            is_the_lamp(estimate.lights[0])


@pytest.mark.parametrize("scale", [None, 150.0])
def test_a_black_picture_and_a_ring(tmp_path: Path, scale) -> None:
    (tmp_path / "0000.jpg").write_bytes(encode_jpeg(np.ones((64, 128, 3), np.uint8)))
    settings = offline.Settings(ring_lux=LUX, ring_sigma=0.03, cd_m2_per_unit=scale)
    estimate = offline.estimate_folder(tmp_path, [8000], settings)
    assert estimate.flags & (RING_ONLY | COVERED) == RING_ONLY | COVERED
    (light,) = estimate.lights
    assert light.irradiance[1] == pytest.approx(400 / (scale or 1), rel=0.02)
    assert estimate.cd_m2_per_unit == (scale or 1)
    assert 0.15 < estimate.relighting_sigma < 0.5
    # where it is dark for the ring, too, it is dark
    dark = offline.Settings(ring_lux=",".join(["0.1"] * 9), ring_sigma=0.03, cd_m2_per_unit=scale)
    assert not offline.estimate_folder(tmp_path, [8000], dark).flags & (RING_ONLY | COVERED)


def test_a_ring_that_contradicts_pictures_is_flagged(tmp_path: Path) -> None:
    (tmp_path / "0000.jpg").write_bytes(encode_jpeg(np.full((64, 128, 3), 90, np.uint8)))
    settings = offline.Settings(
        ring_lux="1000,10,900,10,800,10,700,10,10", ring_sigma=0.03, cd_m2_per_unit=150
    )
    estimate = offline.estimate_folder(tmp_path, [8000], settings)
    assert estimate.flags & RING_FAULT


def test_a_ring_that_sees_other_light_is_told():
    """The picture is dark on the left, and the sensors are not where they say they are."""
    lux = "1000,10,900,10,800,10,700,10,10"
    with (
        camera() as cam,
        Daemon(f"--source=sim:{cam.path}", f"--ring=sim:?lux={lux}") as daemon,
        daemon.client(health_period_ms=100) as client,
    ):
        cam.accept()
        for _ in range(400):
            cam.send(jpeg(panorama()), exposure_us=2000)
            health = client.until(lambda h: True, "health")
            if any(fault.id == "ring-disagrees" for fault in health.faults):
                break
        fault = next(fault for fault in health.faults if fault.id == "ring-disagrees")
        assert "not used" in fault.text
        cam.send(jpeg(panorama()), exposure_us=2000)
        client.until(lambda e: e.flags & RING_FAULT)


# ---------------------------------------------------------------- by files

SCENE = random_scene(1)


@pytest.fixture(scope="module")
def clipped(tmp_path_factory):
    """Two exposures of a room whose lamps clip in both; their exposures, and the true readings."""
    folder = tmp_path_factory.mktemp("clipped")
    exposures_us = Studio(0).shoot(SCENE, Input("2"), folder)
    return folder, exposures_us, CD_M2_PER_UNIT * illuminance.on_ring(SCENE)


def test_sigma_is_one_number_or_nine(tmp_path: Path) -> None:
    picture = tmp_path / "0000.jpg"
    picture.write_bytes(encode_jpeg(np.full((64, 128, 3), 90, np.uint8)))
    lux = ",".join(["nan"] * 9)
    for sigma in ("0.1,0.2", "nan", "0", "1,2,3,4,5,6,7,8,9,10"):
        with pytest.raises(UsageError, match=r"ring-sigma.*one number.*or nine"):
            daemon.estimate_once(
                [f"--source=file:{tmp_path}", f"--ring-lux={lux}", f"--ring-sigma={sigma}"]
            )
    for sigma in ("0.1", "0.1,0.2,0.3,0.4,0.5,0.6,0.7,0.8,0.9"):
        daemon.estimate_once(
            [f"--source=file:{tmp_path}", f"--ring-lux={lux}", f"--ring-sigma={sigma}"]
        )


def test_colours_are_27_numbers(tmp_path: Path) -> None:
    picture = tmp_path / "0000.jpg"
    picture.write_bytes(encode_jpeg(np.full((64, 128, 3), 90, np.uint8)))
    lux = f"--ring-lux={','.join(['100'] * 9)}"
    for rgb in ("1,2,3", ",".join(["1"] * 28), ",".join(["x"] * 27), ",".join(["-1"] * 27)):
        with pytest.raises(UsageError, match=r"ring-rgb.*27 numbers"):
            daemon.estimate_once([f"--source=file:{tmp_path}", lux, f"--ring-rgb={rgb}"])
    for rgb in (",".join(["100"] * 27), ",".join(["nan"] * 27)):
        daemon.estimate_once([f"--source=file:{tmp_path}", lux, f"--ring-rgb={rgb}"])


def score(clipped, lux, scale=CD_M2_PER_UNIT, sigma=0.03, rgb=None, scene=SCENE):
    folder, exposures_us, _ = clipped
    settings = offline.Settings()
    if lux is not None:
        settings = offline.Settings(
            ring_lux=",".join(f"{value:.7g}" for value in lux),
            ring_sigma=sigma,
            cd_m2_per_unit=scale,
            cd_m2_per_unit_sigma=0.05 if scale else None,
            ring_rgb=None if rgb is None else ",".join(f"{v:.7g}" for v in rgb.ravel()),
        )
    estimate = offline.estimate_folder(folder, exposures_us, settings)
    return reference(scene).score(estimate)


def relighting(*arguments, **settings):
    return score(*arguments, **settings).relighting_mae


def test_what_the_ring_found_states_how_well_its_colour_is_known(clipped):
    folder, exposures_us, lux = clipped
    words = ",".join(f"{value:.7g}" for value in lux)
    without = offline.estimate_folder(folder, exposures_us, offline.Settings())
    settings = offline.Settings(
        ring_lux=words, ring_sigma=0.03, cd_m2_per_unit=CD_M2_PER_UNIT, cd_m2_per_unit_sigma=0.05
    )
    ringed = offline.estimate_folder(folder, exposures_us, settings)
    assert all(light.colour_sigma is None for light in without.lights)
    found = [light for light in ringed.lights if light.flags & LightFlag.RING]
    assert found
    for light in found:
        assert light.colour_sigma is not None
        assert light.colour_sigma <= 0.35  # that of what is hidden
    for light in ringed.lights:
        assert light.flags & LightFlag.RING or light.colour_sigma is None


def test_colours_of_the_ring_are_those_of_clipped_lamps(clipped):
    truth = SCENE.truth(np.ones(len(SCENE.lamps)))
    light = CD_M2_PER_UNIT * truth.irradiance(ring.directions())
    grey = relighting(clipped, clipped[2])
    assert relighting(clipped, clipped[2], rgb=light) < 0.6 * grey
    # other gains than the camera's, and no sense at all: never much worse than without colours
    assert relighting(clipped, clipped[2], rgb=light * [1.1, 1.0, 0.9]) < grey
    nonsense = np.random.default_rng(3).uniform(0, 2 * light.max(), light.shape)
    assert relighting(clipped, clipped[2], rgb=nonsense) < relighting(clipped, None)


BAD = {
    "all dead": lambda lux: lux * np.nan,
    "one saturated": lambda lux: np.where(lux == lux.max(), np.nan, lux),
    "one shorted": lambda lux: np.where(np.arange(9) == 2, 0, lux),
    "one reads ten times as much": lambda lux: np.where(np.arange(9) == 5, 10 * lux, lux),
    "a hand before three": lambda lux: np.where(np.isin(np.arange(9), (0, 1, 7)), 0.1 * lux, lux),
    "turned by 45 degrees": lambda lux: np.append(np.roll(lux[:8], 1), lux[8]),
    "uncalibrated, a factor of two": lambda lux: (
        lux * np.exp(np.random.default_rng(4).normal(0, 0.5, 9))
    ),
    "lamps that flicker": lambda lux: lux * 1.4,
    "darkness": lambda lux: 0 * lux,
}


def test_the_ring_finds_what_clips(clipped):
    alone, with_ring = relighting(clipped, None), relighting(clipped, clipped[2])
    assert alone > 0.05
    assert with_ring < alone / 3


@pytest.fixture(scope="module", params=[1, 2, 4, 13], ids=lambda seed: f"room {seed}")
def room(request, tmp_path_factory):
    """As `clipped`, of several rooms; and the room."""
    scene, folder = random_scene(request.param), tmp_path_factory.mktemp("room")
    exposures_us = Studio(0).shoot(scene, Input("2"), folder)
    return (folder, exposures_us, CD_M2_PER_UNIT * illuminance.on_ring(scene)), scene


@pytest.mark.parametrize("name", BAD)
def test_bad_readings_are_never_worse_than_the_camera_alone(room, name):
    """And the sigma holds."""
    pictures, scene = room
    sigma = 0.5 if "uncalibrated" in name else 0.03
    found = score(pictures, BAD[name](pictures[2]), sigma=sigma, scene=scene)
    assert found.relighting_mae < relighting(pictures, None, scene=scene) + 0.005
    assert found.relighting_relative < 3 * found.relighting_stated


@pytest.mark.parametrize("factor", [0.7, 1.3, None])
def test_a_wrong_scale_is_never_worse_than_the_camera_alone(clipped, factor):
    scale = CD_M2_PER_UNIT * factor if factor else None
    assert relighting(clipped, clipped[2], scale) < relighting(clipped, None) + 0.005


def test_the_command(clipped):
    folder, exposures_us, lux = clipped
    command = [
        LIGHTPROBE, "estimate", *sorted(folder.glob("*.jpg")),
        "--exposure-us", ",".join(f"{value:.9g}" for value in exposures_us),
        "--ring-lux", ",".join(f"{value:.7g}" for value in lux),
        "--cd-m2-per-unit", str(CD_M2_PER_UNIT), "--json",
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    shape = json.loads(done.stdout)
    assert "RING" in shape["lights"][0]["flags"]
    assert shape["scale"]["cd_m2_per_unit"] == pytest.approx(CD_M2_PER_UNIT, rel=0.05)
    assert 0 < shape["scale"]["cd_m2_per_unit_sigma"] < 0.06


# ---------------------------------------------------------------- the scale


def calibrate_scale(probe, *arguments):
    command = [LIGHTPROBE, "calibrate", "scale", probe, "--seconds", "0.5", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


@pytest.fixture
def steady_light():
    """A daemon in an even grey room; the ring beside its camera reads what 300 cd/m² gives."""
    grey = jpeg(np.full((64, 128, 3), 124, np.uint8), quality=95)
    lux = np.pi * 300
    with camera() as cam, Daemon(f"--source=sim:{cam.path}", f"--ring=sim:?lux={lux}") as daemon:
        cam.accept()
        with streaming(cam, grey, exposure_us=10000):
            yield daemon


def test_the_scale_by_the_ring_and_by_a_meter(steady_light, tmp_path):
    uri = f"unix:{steady_light.socket}"
    by_ring = calibrate_scale(uri, "--json")
    assert by_ring.returncode == 0, by_ring.stderr
    found = json.loads(by_ring.stdout)
    file = tmp_path / "my.camera"
    by_meter = calibrate_scale(uri, "--lux", np.pi * 300, "--output", file, "--json")
    assert by_meter.returncode == 0, by_meter.stderr
    same = json.loads(by_meter.stdout)
    assert same["cd_m2_per_unit"] == pytest.approx(found["cd_m2_per_unit"], rel=0.02)
    code = 124 / 255
    radiance = ((code + 0.055) / 1.055) ** 2.4 / 0.01  # full scale at one second is 1
    assert found["cd_m2_per_unit"] == pytest.approx(300 / radiance, rel=0.02)
    assert 0.02 <= found["sigma"] <= 0.04
    # the daemon then sends it, without any ring
    folder = tmp_path / "pictures"
    folder.mkdir()
    (folder / "0.jpg").write_bytes(jpeg())
    estimate = offline.estimate_folder(folder, [10000], offline.Settings(camera=str(file)))
    assert estimate.cd_m2_per_unit == pytest.approx(same["cd_m2_per_unit"], rel=1e-4)
    assert estimate.cd_m2_per_unit_sigma == pytest.approx(same["sigma"], abs=0.001)


def test_a_probe_without_ring_needs_a_meter():
    with camera() as cam, Daemon(f"--source=sim:{cam.path}") as daemon:
        cam.accept()
        with streaming(cam, jpeg(), exposure_us=10000):
            done = calibrate_scale(f"unix:{daemon.socket}")
    assert done.returncode == 1
    assert "--lux" in done.stderr
