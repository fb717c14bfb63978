"""`lightprobe demo`: what `make demo` runs, from scene to picture."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from lightprobe.cli.demo_painter import Painter
from lightprobe.estimate import Estimate, EstimateFlag, SphericalHarmonics
from lightprobe.sim.room import Room
from lightprobe.sim.sensor import Sensor, encode_jpeg

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
LONG_S = 180


def run(*arguments, **environment):
    return subprocess.run(
        [LIGHTPROBE, "demo", *map(str, arguments)], capture_output=True, text=True, timeout=LONG_S,
        env=os.environ | environment,
    )  # fmt: skip


@pytest.mark.usefixtures("released_daemon")
def test_lamps_are_where_they_are_and_the_last_picture_is_of_the_first_scene(tmp_path):
    """Lamps switch, the camera looks around; the picture agrees, and is the last one, too.

    The second scene is on from 8 s.
    """
    with tempfile.TemporaryDirectory(prefix="lp-") as folder:  # socket paths are short
        done = run("--seconds", 9, "--scenes", "room", "--scenes", "procedural:1", "--every-s", 3,
                   "--output", tmp_path, "--json", TMPDIR=folder)  # fmt: skip
        assert list(Path(folder).glob("lightprobe-*")) == []
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["estimates"] > 20
    assert summary["frames_rejected"] == 0
    wheel, ring = summary["wheel"], summary["ring"]
    assert wheel["phase"] == "SETTLED"
    assert abs(wheel["measured_deg"] - 45) <= 3 * wheel["sigma_deg"] < 3
    assert wheel["frames_stamped"] > 20
    assert all(lux > 0 for lux in ring["illuminance_lux"])
    assert not [fault for fault in summary["faults"] if fault.startswith(("WHEEL", "mcu", "LDR"))]
    last = str(tmp_path / "room.png")
    assert list(summary["pictures"])[-1] == last
    figures = summary["pictures"][last]
    assert figures["found"] == figures["lamps"] > 0
    assert figures["direction_rmse_deg"] < 1
    assert figures["relighting_mae"] < max(0.05, 3 * figures["stated_error"])  # if starved
    assert cv2.imread(last).shape == (650, 1600, 3)
    assert (tmp_path / "latest.png").read_bytes() == (tmp_path / "room.png").read_bytes()


def frames_in(folder):
    """Source of frames of the room, again and again."""
    folder.mkdir()
    radiance = Room().render(640, 320).compose([1, 1, 1, 1])
    sensor = Sensor(640, 320)
    for k in range(3):
        codes = sensor.capture(radiance, 5e5, frame=k)
        (folder / f"{k}.jpg").write_bytes(encode_jpeg(codes))
    return f"file:{folder}?rate=20&loop=1"


def test_ctrl_c_ends_it_well(tmp_path):
    source = frames_in(tmp_path / "frames")
    command = [LIGHTPROBE, "demo", "--source", source, "--output", tmp_path, "--every-s", "1"]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + LONG_S
    while not list(tmp_path.glob("*.png")) and time.monotonic() < deadline:
        assert process.poll() is None
        time.sleep(0.2)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does it
    out, err = process.communicate(timeout=LONG_S)
    assert process.returncode == 0, err
    assert "estimates" in out
    assert "picture:" in out
    assert "Traceback" not in err


def an_estimate() -> Estimate:
    even = SphericalHarmonics("AMBIENT", 2, np.eye(9, 3))
    return Estimate(1, 2, 3, 4, 500, EstimateFlag(0), (), even, 0.01, None, 1, None)


def test_the_last_picture_is_waited_for_however_long_it_takes(tmp_path):
    with Painter(tmp_path, []) as painter:
        os.kill(painter._process.pid, signal.SIGSTOP)
        painter.start(an_estimate(), None, "")
        waiting = threading.Thread(target=painter.collect, kwargs={"wait": True})
        waiting.start()
        assert not painter.pictures
        os.kill(painter._process.pid, signal.SIGCONT)
        waiting.join(LONG_S)
        assert list(painter.pictures) == [str(tmp_path / "camera.png")]
        assert (tmp_path / "latest.png").exists()


def test_a_painter_that_dies_is_told_and_not_waited_for(tmp_path):
    with Painter(tmp_path, []) as painter:
        os.kill(painter._process.pid, signal.SIGSTOP)
        painter.start(an_estimate(), None, "")
        os.kill(painter._process.pid, signal.SIGKILL)
        assert painter.collect(wait=True)
        assert painter.problem == "demo: the process that draws has ended: -9"
        painter.start(an_estimate(), None, "")
        assert painter.collect(wait=True)


def test_another_source_has_no_truth(tmp_path):
    source = frames_in(tmp_path / "frames")
    done = run("--source", source, "--seconds", 3, "--output", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "camera.png" in done.stdout
    assert np.ptp(cv2.imread(str(tmp_path / "camera.png"))) > 100


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--source", "magic:wand"], "magic"),
        (["--source", "file:/nowhere"], "/nowhere"),
        (["--source", "v4l2:/dev/video99"], "no picture from the source: v4l2: /dev/video99: find"),
        (["--camera", "none.camera"], "none.camera"),
        (["--scenes", "none.exr"], "none.exr"),
    ],
)
def test_what_cannot_be_shown_says_why(tmp_path, options, message):
    done = run(*options, "--seconds", 2, "--output", tmp_path)
    assert done.returncode in (1, 2)
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_no_panoramas_says_how_to_get_them(tmp_path, monkeypatch):
    monkeypatch.setenv("LIGHTPROBE_SCENES", str(tmp_path))
    done = run("--seconds", 2)
    assert done.returncode == 2
    assert "make scenes" in done.stderr
