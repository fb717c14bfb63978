# SPDX-License-Identifier: Apache-2.0
"""The daemon's libcamera source: libcamera's pipeline for USB cameras on the kernel's uvcvideo."""

import math
import subprocess
import time

import pytest
from machine import run, wait_for
from room import assert_room, wait_whole_bracket
from udev import prepare_libcamera, settle

SMALL = "size=640x320"


@pytest.fixture(scope="module", autouse=True)
def _drivers():
    prepare_libcamera()


@pytest.fixture
def plugged(camera):
    """A camera, plugged in, and known to udev."""
    camera.plug()
    settle()
    return camera


@pytest.mark.parametrize("pixel_format", ["mjpeg", "yuyv", "nv12", "grey"])
def test_each_format_gives_estimates(start, plugged, pixel_format):
    daemon = start(f"libcamera:?{SMALL}&format={pixel_format}", "--exposure-us=2000")
    estimate = wait_for("exposure", lambda: (e := daemon.wait_estimate()).exposure_us == 2000 and e)
    # The lamp of the camera's pattern is ahead, 27 degrees above the horizon.
    x, y, z = estimate.lights[0].direction
    assert abs(x) < 0.02
    assert abs(y - math.sin(math.radians(27))) < 0.02
    assert z < 0
    assert plugged.state()["exposure"] == 20
    assert plugged.state()["ae_mode"] == 1
    assert daemon.health().frames_rejected == 0


@pytest.mark.parametrize(
    "name",
    [
        "1d6b:0102",
        "lightprobe test camera: lightpr",
        "\\_SB_.PCI0-1:1.0-1d6b:0102",
    ],
)
def test_camera_by_each_kind_of_name(start, plugged, name):
    daemon = start(f"libcamera:{name}?{SMALL}")
    daemon.wait_estimate()
    assert "libcamera: \\_SB_.PCI0-1:1.0-1d6b:0102: open: lightprobe test camera" in daemon.log()


def test_another_camera_is_not_taken(start, plugged):
    daemon = start("libcamera:imx477")
    health = daemon.wait_state("WAITING")
    assert "imx477: find: no such camera; present: \\_SB_.PCI0" in health.faults[0].text


def test_what_is_not_offered_is_refused_with_what_is(start, plugged):
    daemon = start("libcamera:?size=800x400&format=mjpeg")
    health = daemon.wait_state("DOWN")
    assert "choose: MJPEG 800x400 is not offered — there is" in health.faults[0].text
    assert "640x320" in health.faults[0].text


@pytest.mark.parametrize(
    ("kind", "words"),
    [("read-only", "it refuses to be set"), ("missing", "it has no exposure control")],
)
def test_camera_without_settable_exposure(start, make_camera, kind, words):
    make_camera(exposure=kind).plug()
    settle()
    daemon = start(f"libcamera:?{SMALL}")
    estimate = daemon.wait_estimate()
    assert f"exposure: {words}: no brackets" in daemon.log()
    assert not estimate.HasField("exposure_us")


@pytest.mark.nightly
def test_bracket_is_merged(start, make_camera, simulator):
    make_camera(pictures=f"sim:{simulator}?delay_frames=2").plug()
    settle()
    assert_room(wait_whole_bracket(start(f"libcamera:?{SMALL}&format=mjpeg", "--brackets=3")))


def test_unplugged_and_plugged_in_again(start, plugged, record_property):
    daemon = start(f"libcamera:?{SMALL}")
    daemon.wait_estimate()
    waits = []
    for _ in range(5):
        plugged.unplug()
        daemon.wait_state("WAITING")
        plugged.plug()
        back, back_unix_ns = time.monotonic(), time.time_ns()
        daemon.wait_estimate(captured_after_unix_ns=back_unix_ns)
        waits.append(time.monotonic() - back)
    assert daemon.health().source_reconnects == 5
    record_property("figure", f"libcamera: 5 replugs: resumed within {max(waits):.2f} s")


def test_stall_is_told_and_ends(start, plugged):
    daemon = start(f"libcamera:?{SMALL}&stall_ms=500")
    daemon.expect_stall(plugged.command, "opening the camera anew")


def test_lost_frames_are_counted(start, plugged):
    daemon = start(f"libcamera:?{SMALL}&format=grey")
    before = daemon.wait_state("STREAMING")
    plugged.command("error 2")
    daemon.wait_health(
        "two dropped", lambda health: health.frames_dropped >= before.frames_dropped + 2
    )
    daemon.wait_estimate(time.time_ns())


def test_busy_camera_is_waited_for(start, plugged):
    with subprocess.Popen(
        ["v4l2-ctl", "-d", str(plugged.node()), "--stream-mmap=4", "--stream-to=/dev/null"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as other:  # fmt: skip
        wait_for("frames", lambda: plugged.state()["sent"] > 2)
        daemon = start(f"libcamera:?{SMALL}")
        health = daemon.wait_state("WAITING")
        assert "device busy — is another program using it?" in health.faults[0].text
        other.terminate()
    daemon.wait_state("STREAMING")


def test_missing_permission_names_the_group_and_the_rule(start, plugged):
    daemon = start("libcamera:", user=65534)
    daemon.wait_state("WAITING")
    log = daemon.log()
    assert "no permission for /dev/media0 — add this user to the group video" in log
    assert "70-lightprobe.rules" in log


def test_members_of_the_group_video_may(start, plugged):
    """For nodes that udev has made, with the project's rules."""
    start(f"libcamera:?{SMALL}", user=65534, groups="video").wait_estimate()
    assert run("stat", "-c", "%G", str(plugged.node())).strip() == "video"


def test_end_while_it_is_away(start, plugged):
    daemon = start(f"libcamera:?{SMALL}")
    daemon.wait_estimate()
    plugged.unplug()
    daemon.wait_state("WAITING")
    daemon.stop()
