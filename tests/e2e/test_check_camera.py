"""`lightprobe check-camera` with the real daemon, a simulated camera, and somebody who helps."""

import contextlib
import json
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from lightprobe.imaging import camera
from lightprobe.sim import control

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


def checked(desk, *arguments):
    """Do what it asks for; gives its exit status and its report."""
    process = subprocess.Popen(
        [LIGHTPROBE, "check-camera", *map(str, arguments), "--json", "--rest-s", "12"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    watch = threading.Timer(LONG_S, process.kill)
    watch.start()
    said = ""
    while "press Enter" not in said.replace("\n", " ") or "leave" not in said:
        said += process.stderr.read(1)
    answers = {"Point": None, "Hold": "-40,0,50,0.7,0.08,0.05", "Cover": "0,0,180"}
    while True:
        for word, card in list(answers.items()):
            if word in said and "leave it out)" in " ".join(said[said.index(word) :].split()):
                if card is not None:
                    control.send(desk, f"card {card}")
                process.stdin.write("\n")
                process.stdin.flush()
                del answers[word]
        more = process.stderr.read(1)
        if not more:
            break
        said += more
    report = process.stdout.read()
    status = process.wait(LONG_S)
    watch.cancel()
    return status, json.loads(report), said


def test_stuck_pixels_are_found_and_written(tmp_path):
    out, plot = tmp_path / "my.camera", tmp_path / "checked.png"
    with simulated(tmp_path, "--pixel-defects", "stuck=6&warm=6") as (link, desk):
        status, report, said = checked(
            desk, f"sim:{link}?hide_exposure=1", "--output", out, "--plot", plot
        )
    assert status == 0, said + json.dumps(report)
    assert report["defects"] == ["pixels"]
    assert report["verdict"] == "fit with 6 stuck and 6 warm pixels"
    assert len(camera.load(str(out)).stuck_px) == 12
    assert "exposure_delay_frames" in out.read_text()
    assert plot.stat().st_size > 10000


def test_tone_mapping_is_unfit_in_a_script(tmp_path):
    with simulated(tmp_path, "--processing", "tone_ev=1") as (link, _):
        done = subprocess.run(
            [LIGHTPROBE, "check-camera", f"sim:{link}", "--json", "--skip", "rest,colour,cover"],
            input="\n", capture_output=True, text=True, timeout=LONG_S,
        )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert json.loads(done.stdout)["defects"] == ["tone mapping"]


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
