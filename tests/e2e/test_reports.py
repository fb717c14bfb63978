"""Pictures as people have them: the right light, or a refusal that says why, from every preset."""

import sys
from pathlib import Path

import numpy as np
import pytest
from lightprobe import daemon
from lightprobe.colour import luminance
from lightprobe.estimate import flag_names
from lightprobe.evaluate import offline

FOLDER = Path(__file__).resolve().parents[1] / "files"
sys.path.insert(0, str(FOLDER))
import files  # noqa: E402


@pytest.mark.usefixtures("released_daemon")
@pytest.mark.parametrize("file", files.FILES, ids=[file.name for file in files.FILES])
def test_the_right_light_or_a_refusal(file):
    found = [files.fault(file, answer) for answer in files.answers(file)]
    assert found
    assert not any(found), [fault for fault in found if fault]


#: Of the lamp, in one second at full scale.
IRRADIANCE = (47.7, 35.8, 23.9)


@pytest.mark.usefixtures("released_daemon")
@pytest.mark.parametrize("kind", ["", "_mpf"], ids=["photos", "photos with a preview behind them"])
def test_the_right_light_of_a_bracket(kind, tmp_path):
    """Each exposure is of its own picture, and none of a preview."""
    exposures_us = [16000.0, 2000.0, 250.0]
    pictures = [FOLDER / f"jpeg/b_{name}{kind}.jpg" for name in ("long", "mid", "short")]
    for number, picture in enumerate(pictures):
        (tmp_path / f"{number}.jpg").symlink_to(picture)
    alone, _ = daemon.estimate_once(
        [f"--source=file:{tmp_path}?exposures_us=16000,2000,250", "--preset=accurate"]
    )
    for found in (alone, offline.estimate_files(pictures, exposures_us)[0]):
        assert luminance(found.sh.coefficients[0]) == pytest.approx(54.83, rel=0.02)
        assert np.asarray(found.lights[0].irradiance) == pytest.approx(
            np.array(IRRADIANCE), rel=0.05
        )
        assert "CLIPPED" not in flag_names(found.flags)


@pytest.mark.usefixtures("released_daemon")
def test_an_infinite_lamp_is_a_lower_bound():
    found, _ = offline.estimate_files([FOLDER / "exr/lamp_is_inf.exr"])
    assert max(found.lights[0].irradiance) > 100


@pytest.mark.parametrize("kind", ["jpeg", "mjpeg", "png", "fisheye", "exr", "hdr"])
def test_every_picture_has_its_right_answer(kind):
    """One that nobody looks at would stand there as if it were tested."""
    listed = {Path(file.name).name for file in files.FILES if file.name.startswith(f"{kind}/")}
    there = {
        path.name
        for path in (FOLDER / kind).iterdir()
        if not path.name.startswith("b_") and path.suffix != ".camera"
    }
    assert listed == there


def test_the_page_lists_them_all():
    """After a change: `build/venv/bin/python tests/files/files.py`."""
    page = (FOLDER.parents[1] / "docs/users/accuracy.md").read_text()
    part = page.partition("<!-- generated: files -->")[2].partition("<!-- end -->")[0]
    listed = [line.split(" | ")[0].lstrip("| ") for line in part.splitlines()[2:]]
    assert listed[1:] == [file.name for file in files.FILES]
