# SPDX-License-Identifier: Apache-2.0
"""The v4l2 source's promises on the kernel's uvcvideo: corrupt frames, other models, hanging."""

import pytest
from camera import load_drivers
from contract import check_corrupt_frames_first, check_only_corrupt_frames

USB = "v4l2:1d6b:0102"
SMALL = "size=640x320&format=grey&fps=5"


@pytest.fixture(scope="module")
def _flagged():
    """Deliver frames with errors, with a flag."""
    load_drivers(nodrop=1)
    yield
    load_drivers(nodrop=0)


@pytest.mark.usefixtures("_flagged")
def test_corrupt_frames_first_are_counted(start, camera):
    check_corrupt_frames_first(start, camera, f"{USB}?{SMALL}")


@pytest.mark.nightly
@pytest.mark.usefixtures("_flagged")
def test_only_corrupt_frames_are_a_stall(start, camera):
    check_only_corrupt_frames(start, camera, f"{USB}?{SMALL}&reset=0")


def test_another_model_is_named_and_not_taken(start, camera, make_camera):
    load_drivers()
    other = make_camera(port=1, usb="1d6b:0103", serial="0002")
    camera.plug()
    daemon = start(f"v4l2:?{SMALL}")
    daemon.wait_estimate()
    camera.unplug()
    daemon.wait_state("WAITING")
    other.plug()
    health = daemon.wait_health(
        "what to do", lambda h: h.faults and "or restart lightprobed" in h.faults[0].text
    )
    assert health.faults[0].text.startswith("v4l2: /dev/video0: find: lightprobe test camera")
    assert "is unplugged; present: /dev/video1 (lightprobe test camera" in daemon.log()
    assert "1d6b:0103:0002" in daemon.log()
    other.unplug()
    camera.plug()
    daemon.wait_state("STREAMING")


def test_a_camera_that_hangs_is_asked_once_at_the_end(start, camera):
    """Each request to it takes the kernel five seconds."""
    load_drivers()
    camera.plug()
    daemon = start(f"{USB}?{SMALL}&reset=0&stall_ms=60000")
    daemon.wait_estimate()
    camera.command("mute 1")
    log = daemon.stop()
    assert log.count("controls are not put back — replug it") == 1
    assert "cannot be put back" not in log
    camera.command("mute 0")
