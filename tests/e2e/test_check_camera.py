"""`lightprobe check-camera` with the real daemon and a simulated camera."""

import contextlib
import json
import math
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from lightprobe.imaging import camera as cameras
from lightprobe.sim.scenes import load

pytestmark = pytest.mark.many_frames

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
LONG_S = 300  # the machine may be busy


@contextlib.contextmanager
def simulated(folder, *options):
    """A simulated camera; yields its socket and that of its control."""
    link, desk = folder / "sim", folder / "control"
    process = subprocess.Popen(
        [LIGHTPROBE, "simulate", "--socket", link, "--size", "640x320", "--scenes", "room",
         "--act-s", "0", "--exposure-min-us", "8", "--exposure-step-us", "0", "--control", desk,
         *options],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        yield link, desk
    finally:
        process.terminate()
        process.wait(30)


def test_tone_mapping_is_unfit_in_a_script(tmp_path):
    with simulated(tmp_path, "--processing", "tone_ev=1") as (link, _):
        done = subprocess.run(
            [LIGHTPROBE, "check-camera", f"sim:{link}", "--json",
             "--skip", "rest,colour,shade,cover"],
            input="\n", capture_output=True, text=True, timeout=LONG_S,
        )  # fmt: skip
    assert done.stdout, done.stderr
    assert done.returncode == 1, done.stderr
    assert json.loads(done.stdout)["defects"] == ["tone mapping"]


@pytest.mark.nightly
def test_a_veil_is_measured_and_written(tmp_path):
    path, plot = tmp_path / "my.camera", tmp_path / "checked.png"
    x, y, z = max(load(["room"])[0].lamps, key=lambda one: sum(one.irradiance)).direction
    card = f"{math.degrees(math.atan2(x, -z))},{math.degrees(math.asin(y))},6"
    with simulated(tmp_path, "--lens-defects", "glare=0.04") as (link, desk):
        process = subprocess.Popen(
            [LIGHTPROBE, "check-camera", f"sim:{link}", "--json", "--output", path,
             "--plot", plot, "--skip", "rest,colour,cover"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        process.stdin.write("\n\n")
        process.stdin.flush()
        told = ""
        while "Hide that lamp" not in told:
            line = process.stderr.readline()
            assert line, told
            told += line
        subprocess.run([LIGHTPROBE, "control", "card", desk, "--", card], check=True)
        out, err = process.communicate("\n", timeout=LONG_S)
    assert process.returncode == 0, out + err
    assert json.loads(out)["defects"] == ["glare"], out
    assert cv2.imread(str(plot)).std() > 10
    glare = cameras.load(str(path)).glare
    assert glare.even + glare.around == pytest.approx(0.04, rel=0.25)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("file:x",), "live camera"),
        (("my.jpg",), "live camera"),
        (("sim:/x", "--skip", "turn"), "--skip turn"),
    ],
)
def test_bad_options_are_named(arguments, words):
    done = subprocess.run([LIGHTPROBE, "check-camera", *arguments], capture_output=True, text=True)
    assert done.returncode == 2
    assert words in done.stderr


def test_nobody_at_the_keyboard_is_told(tmp_path):
    with simulated(tmp_path) as (link, _):
        done = subprocess.run(
            [LIGHTPROBE, "check-camera", f"sim:{link}", "--json"],
            stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=LONG_S,
        )  # fmt: skip
    assert done.returncode == 3, done.stderr
    assert "nobody pressed Enter" in done.stdout


def test_a_camera_that_is_not_there_is_told(tmp_path):
    done = subprocess.run(
        [LIGHTPROBE, "check-camera", f"sim:{tmp_path}/x", "--patience-s", "1"],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 1
    assert "lightprobe simulate" in done.stderr
