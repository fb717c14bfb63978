"""EXR and Radiance pictures as programs write them, through the whole of `lightprobe estimate`."""

from pathlib import Path

import pytest
from lightprobe.colour import luminance
from lightprobe.estimate import flag_names
from lightprobe.evaluate import offline

FOLDER = Path(__file__).resolve().parents[1] / "files"
SH0, AZIMUTH_DEG, ELEVATION_DEG = 0.911, 60.15, 29.98
PLAIN = (
    "exr/plain.exr", "exr/blender_layers.exr", "exr/luminance_chroma.exr", "exr/lower_case.exr",
    "hdr/plain.hdr", "hdr/exposure_half.hdr", "hdr/exposure_twice.hdr", "hdr/colorcorr.hdr",
    "hdr/bottom_up.hdr", "hdr/mirrored.hdr", "hdr/xyze.hdr", "hdr/oldrle.hdr",
)  # fmt: skip


def estimate(name):
    return offline.estimate_files([FOLDER / name])


@pytest.mark.usefixtures("released_daemon")
@pytest.mark.parametrize("name", PLAIN)
def test_the_right_light(name):
    found, _ = estimate(name)
    assert luminance(found.sh.coefficients[0]) == pytest.approx(SH0, rel=0.02)
    assert found.lights[0].azimuth_deg == pytest.approx(AZIMUTH_DEG, abs=0.2)
    assert found.lights[0].elevation_deg == pytest.approx(ELEVATION_DEG, abs=0.2)
    assert found.lights[0].irradiance == pytest.approx([6.04, 4.53, 3.02], rel=0.02)


@pytest.mark.usefixtures("released_daemon")
def test_an_infinite_lamp_is_a_lower_bound():
    found, _ = estimate("exr/lamp_is_inf.exr")
    assert "CLIPPED" in flag_names(found.flags)
    assert found.lights[0].azimuth_deg == pytest.approx(AZIMUTH_DEG, abs=1)
    assert max(found.lights[0].irradiance) > 100


@pytest.mark.usefixtures("released_daemon")
def test_what_a_file_does_not_hold_is_told():
    found, log = estimate("exr/cropped.exr")
    assert "INVALID_INPUT" in flag_names(found.flags)
    assert any("the rest is black" in line for line in log)
    assert found.lights[0].azimuth_deg == pytest.approx(AZIMUTH_DEG, abs=0.2)
