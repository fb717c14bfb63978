"""`lightprobe calibrate polarizer`: a film of known numbers is found, and what is wrong named."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from lightprobe.calibrate import polarizer
from lightprobe.calibrate.files import CalibrationError
from lightprobe.calibrate.polarizer import Region, Target
from lightprobe.errors import UsageError
from lightprobe.imaging import camera
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.polarizer import Polarizer
from lightprobe.imaging.stokes import Picture
from lightprobe.sim.sensor import Sensor

SIZE_PX = (360, 180)
LENS = camera.load("equirect")
LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
ANGLES = (0.0, 45.0, 90.0, 135.0, 0.0)
SCREEN, FLOOR, LAMP = Target(dolp=1.0), Target(aolp_deg=0.0), Target(dolp=0.0)


def light(dolp: float, aolp_deg: float, radiance: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """S0 and S1, S2 of a sphere that is polarized alike in every pixel's own frame."""
    s0 = np.full((SIZE_PX[1], SIZE_PX[0], 3), radiance, np.float32)
    turned = np.radians(2 * aolp_deg)
    return s0, np.stack([dolp * np.cos(turned) * s0, dolp * np.sin(turned) * s0])


def behind(sheet: Sheet, dolp: float, aolp_deg: float, angles=ANGLES) -> list[np.ndarray]:
    film = Polarizer(sheet, LENS, SIZE_PX)
    return [film.through(*light(dolp, aolp_deg), (angle,)) for angle in angles]


def pictures(seen) -> list[Picture]:
    return [Picture(one) for one in seen]


@settings(max_examples=25, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(
    st.floats(0.3, 1), st.floats(10, 3000), st.floats(-89, 89), st.floats(0, 179),
    st.floats(-60, 60), st.floats(-50, 50), st.booleans(),
)  # fmt: skip
def test_any_film_is_found(transmission, extinction, offset, aolp, azimuth, elevation, away):
    """By a wholly polarized target of known direction, also behind the camera, and without film."""
    sheet, region = Sheet(transmission, extinction, offset), Region(azimuth + 180 * away, elevation)
    centre = np.cos(np.radians(azimuth)) * np.cos(np.radians(elevation))
    if centre < np.cos(np.radians(65)):
        return
    found = polarizer.fit(
        pictures(behind(sheet, 1.0, aolp)), ANGLES, LENS, Target(1.0, aolp), region,
        Picture(light(1.0, aolp)[0]),
    )  # fmt: skip
    assert found.transmission == pytest.approx(transmission, rel=0.003)
    assert found.offset_deg is not None
    assert found.offset_sigma_deg is not None
    assert found.offset_sigma_deg < 0.1
    assert abs((found.offset_deg - offset + 90) % 180 - 90) < 4 * found.offset_sigma_deg + 0.02
    assert found.modulation == pytest.approx(sheet.diattenuation, abs=0.003)
    assert found.is_turned == (abs(offset) > 45) or abs(abs(offset) - 45) < 0.3
    assert found.residual < 1e-3


def test_what_the_target_does_not_tell_stays_unknown():
    sheet = Sheet(0.8, 80)
    by_screen = polarizer.fit(pictures(behind(sheet, 1, 33)), ANGLES, LENS, SCREEN, Region())
    assert by_screen.extinction_ratio == pytest.approx(80, rel=0.02)
    assert not by_screen.extinction_is_bound
    assert set(by_screen.values()) == {"extinction"}
    by_floor = polarizer.fit(pictures(behind(sheet, 0.6, 0)), ANGLES, LENS, FLOOR, Region(0, -34))
    assert set(by_floor.values()) == {"offset_deg"}
    assert abs(float(by_floor.values()["offset_deg"])) < 0.1
    good = polarizer.fit(pictures(behind(Sheet(0.8, 1e5), 1, 0)), ANGLES, LENS, SCREEN, Region())
    assert good.extinction_is_bound
    assert good.extinction_ratio is not None
    assert 100 < good.extinction_ratio < 1e5


def test_what_is_wrong_is_named():
    seen = behind(Sheet(), 0.7, 0)
    for changed, target, region, words in [
        (seen[:3], FLOOR, Region(), "four angles at least"),
        ([*seen[:2], 1.4 * seen[2], *seen[3:]], FLOOR, Region(), "is the exposure fixed"),
        ([seen[1], seen[0], *seen[2:]], FLOOR, Region(), "angles in the order"),
        (behind(Sheet(), 0.02, 0), FLOOR, Region(), "choose an LCD screen"),
        (seen, FLOOR, Region(90, 0), "edge-on"),
        (seen, FLOOR, Region(0, 0, 0.5), "larger --radius"),
    ]:
        angles = ANGLES[: len(changed)]
        with pytest.raises(CalibrationError, match=words):
            polarizer.fit(pictures(changed), angles, LENS, target, region)
    clipped = [one.copy() for one in seen]
    clipped[2][88:92, 178:182] = np.nan
    with pytest.raises(CalibrationError, match="picture 3 clips"):
        polarizer.fit(pictures(clipped), ANGLES, LENS, FLOOR, Region())
    with pytest.raises(UsageError, match="need three"):
        polarizer.fit(pictures(seen[:2]), (0, 90), LENS, FLOOR, Region())


def test_the_command_writes_the_camera_file(tmp_path):
    """8-bit pictures with noise; a film put in a quarter turn wrong; a second run adds to it."""
    sheet, sensor = Sheet(0.8, 100, -87.5), Sensor(*SIZE_PX)

    def taken(seen, name: str) -> list[Path]:
        files = []
        for index, one in enumerate(seen):
            files.append(tmp_path / f"{name}{index}.png")
            codes = sensor.capture(one, 1e6, frame=index)
            cv2.imwrite(str(files[-1]), np.ascontiguousarray(codes[..., ::-1]))
        return files

    def calibrate(*arguments) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [LIGHTPROBE, "calibrate", "polarizer", *arguments, "--wheel-deg", "0,45,90,135,0",
             "--output", tmp_path / "my.camera"],
            capture_output=True, text=True, timeout=60,
        )  # fmt: skip

    floor = taken(behind(sheet, 0.8, 0), "floor")
    clear = taken([light(0.8, 0)[0]], "clear")
    done = calibrate(*floor, "--target", "floor", "--at", "0,-34", "--without", *clear)
    assert done.returncode == 0, done.stderr
    assert "a quarter turn wrong" in done.stdout
    done = calibrate(*taken(behind(sheet, 1, 70), "screen"), "--target", "screen", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["extinction_ratio"] == pytest.approx(100, rel=0.3)
    found = camera.load(str(tmp_path / "my.camera")).sheet
    assert found.offset_deg == pytest.approx(-87.5, abs=0.5)
    assert found.transmission == pytest.approx(0.8, rel=0.02)
    assert found.extinction_ratio == pytest.approx(100, rel=0.3)
    done = calibrate(*floor, "--target", "sky")
    assert done.returncode == 2
    assert "expected one of screen, floor, window, lamp" in done.stderr


def noisy(seen, seed: int = 0) -> list[Picture]:
    rng = np.random.default_rng(seed)
    return pictures([(one * rng.normal(1, 0.02, one.shape)).astype(np.float32) for one in seen])


@pytest.mark.parametrize("index", [1.35, 1.5])
@pytest.mark.parametrize("place", [(50, 10), (0, -60), (125, -20)])
def test_light_that_is_not_polarized_tells_the_index_off_the_axis(index, place):
    seen = noisy(behind(Sheet(0.8, 200, index=index), 0.0, 0.0))
    found = polarizer.fit(seen, ANGLES, LENS, LAMP, Region(*place))
    assert found.index is not None
    assert found.index_sigma is not None
    assert found.index_sigma < 0.06
    assert abs(found.index - index) < 2 * found.index_sigma
    assert set(found.values()) == {"index"}
    assert found.modulation < 0.01


def test_light_on_the_axis_tells_no_index():
    seen = noisy(behind(Sheet(0.8, 200, index=1.35), 0.0, 0.0))
    assert polarizer.fit(seen, ANGLES, LENS, LAMP, Region()).values() == {}


def test_a_target_off_the_axis_is_seen_through_the_surfaces():
    """A screen 50° aside."""
    seen, region = pictures(behind(Sheet(0.8, 80, index=1.35), 1.0, 0.0)), Region(50, 0)
    right = polarizer.fit(seen, ANGLES, LENS, SCREEN, region, index=1.35)
    assert right.extinction_ratio == pytest.approx(80, rel=0.05)
    with pytest.raises(CalibrationError, match="index right"):
        polarizer.fit(seen, ANGLES, LENS, SCREEN, region, index=1.0)
