# SPDX-License-Identifier: Apache-2.0
"""The simulator's frames through the USB camera: the daemon measures the simulated light."""

import json
import subprocess

import pytest
from camera import load_drivers
from machine import wait_for
from room import CLIPPED, PICTURES, PROGRAM, assert_room, wait_whole_bracket

from daemon import Daemon

IGNORED = 1024  # ESTIMATE_FLAG_EXPOSURE_IGNORED
WAITING_FRAMES = 5  # what the daemon lets wait in the driver (drivers/source/v4l2/stream.c)
SOURCE = "v4l2:1d6b:0102?size=640x320&format=mjpeg"


@pytest.fixture(scope="module", autouse=True)
def _drivers():
    load_drivers()


def estimate_at(daemon: Daemon, exposure_us: int):
    """Wait for an estimate from frames of this exposure."""
    return wait_for(
        f"{exposure_us} us", lambda: (e := daemon.wait_estimate()).exposure_us == exposure_us and e
    )


def test_a_simulated_room_is_measured(start, make_camera):
    make_camera(pictures=f"folder:{PICTURES}").plug()
    assert_room(estimate_at(start(SOURCE, "--exposure-us=100"), 100))


def test_exposure_reaches_the_picture(start, make_camera):
    """At 128 times the exposure the same lamps clip: the camera chose other frames."""
    make_camera(pictures=f"folder:{PICTURES}").plug()
    assert estimate_at(start(SOURCE, "--exposure-us=12800"), 12800).flags & CLIPPED


def test_the_live_simulator_behind_usb(start, make_camera, simulator):
    """The daemon's exposure goes over USB to the simulator; its next frames have it."""
    make_camera(pictures=f"sim:{simulator}?delay_frames=0").plug()
    assert_room(estimate_at(start(SOURCE, "--exposure-us=100"), 100))


@pytest.mark.parametrize(
    "delay_frames", [1, *(pytest.param(n, marks=pytest.mark.nightly) for n in (2, 3, 4))]
)
def test_bracket_merges_at_any_delay(start, make_camera, simulator, delay_frames):
    """Exposures that land late are told from each other by what they show, and merged rightly."""
    make_camera(pictures=f"sim:{simulator}?delay_frames={delay_frames}").plug()
    assert_room(wait_whole_bracket(start(SOURCE, "--brackets=3")))


def test_bracket_is_refused_when_the_camera_ignores_commands(start, make_camera, simulator):
    make_camera(pictures=f"sim:{simulator}?ignore_exposure=1").plug()
    daemon = start(SOURCE, "--brackets=3")
    estimate = wait_for(
        "the flag", lambda: (e := daemon.wait_estimate()).flags & IGNORED and e, timeout_s=180
    )
    assert not estimate.HasField("exposure_us")
    assert "ignores exposure commands" in daemon.log()


@pytest.mark.nightly
def test_the_delay_is_calibrated_through_usb(make_camera, simulator, tmp_path):
    """`lightprobe calibrate exposure` on the kernel's driver, written into a camera file."""
    make_camera(pictures=f"sim:{simulator}?delay_frames=2").plug()
    out = tmp_path / "probe.camera"
    done = subprocess.run(
        [PROGRAM, "calibrate", "exposure", SOURCE,
         "--output", out, "--frames", "8", "--patience-s", "120", "--json"],
        capture_output=True, text=True, timeout=400,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads(done.stdout)
    assert report["follows"]
    assert not report["reports_exposure"]
    # A frame on its way through the bus, and those that wait in the driver until a slow guest reads
    # them, have left the camera before the command is given: all of them come before its effect.
    assert 2 <= report["delay_frames"] <= 2 + 1 + WAITING_FRAMES, report["delays_frames"]
    assert f"exposure_delay_frames = {report['delay_frames']}" in out.read_text()
