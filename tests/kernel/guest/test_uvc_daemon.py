# SPDX-License-Identifier: Apache-2.0
"""The daemon's v4l2 source on the kernel's uvcvideo: streaming, controls, bad cameras."""

import itertools
import math
import subprocess
import time

import pytest
from camera import load_drivers
from machine import run, wait_for

USB = "v4l2:1d6b:0102"
SMALL = "size=640x320"


@pytest.fixture(scope="module", autouse=True)
def _drivers():
    load_drivers()


# ---------------------------------------------------------------- finding it


@pytest.mark.parametrize(
    "device",
    [
        "/dev/video0",
        "1d6b:0102",
        "1d6b:0102:0001",
        "usb-lightprobe_lightprobe_test_camera_0001-video-index0",
        "",
    ],
)
def test_device_by_each_kind_of_name(start, camera, device):
    assert str(camera.plug()) == "/dev/video0"
    daemon = start(f"v4l2:{device}?{SMALL}")
    daemon.wait_estimate()
    assert "v4l2: /dev/video0: open: lightprobe test camera" in daemon.log()


def test_waits_for_a_camera_that_comes_later(start, camera):
    daemon = start(f"{USB}?{SMALL}")
    health = daemon.wait_state("WAITING")
    assert "no such device; no camera is present" in health.faults[0].text
    camera.plug()
    daemon.wait_state("STREAMING")
    assert daemon.health().source_reconnects == 0


@pytest.mark.parametrize("path", ["/dev/null", "/etc/passwd"])
def test_what_is_no_camera_is_said_to_be_none(start, path):
    daemon = start(f"v4l2:{path}")
    daemon.wait_state("DOWN")
    assert f"v4l2: {path}: find: not a capture device" in daemon.log()


def test_several_cameras_are_told_apart(start, camera, make_camera):
    other = make_camera(port=1, serial="0002")
    camera.plug()
    node = other.plug()
    undecided = start(f"{USB}?{SMALL}")
    health = undecided.wait_state("WAITING")
    assert "several cameras match" in undecided.log()
    assert health.faults
    start(f"{USB}:0002?{SMALL}").wait_estimate()
    assert run("fuser", str(node), check=False).strip()


# ---------------------------------------------------------------- formats


@pytest.mark.parametrize("pixel_format", ["mjpeg", "yuyv", "nv12", "grey"])
def test_each_format_gives_estimates(start, camera, pixel_format):
    camera.plug()
    daemon = start(f"{USB}?{SMALL}&format={pixel_format}&fps=15", "--exposure-us=2000")
    estimate = wait_for("exposure", lambda: (e := daemon.wait_estimate()).exposure_us == 2000 and e)
    # The lamp of the camera's pattern is ahead, 27 degrees above the horizon.
    x, y, z = estimate.lights[0].direction
    assert abs(x) < 0.02
    assert abs(y - math.sin(math.radians(27))) < 0.02
    assert z < 0
    assert daemon.health().frames_rejected == 0


@pytest.mark.parametrize(
    ("wish", "words"),
    [
        ("size=800x400&format=mjpeg", "MJPEG 800x400"),
        (f"{SMALL}&fps=25", "640x320 at 25"),
    ],
)
def test_what_is_not_offered_is_refused_with_what_is(start, camera, wish, words):
    camera.plug()
    daemon = start(f"{USB}?{wish}")
    daemon.wait_state("DOWN")
    log = daemon.log()
    assert f"{words} is not offered — there is" in log
    assert "MJPG 1920x960 at 30/15/5" in log


def test_driver_that_sets_another_size_than_it_offers(start, camera):
    camera.plug()
    camera.command("other-size 1")
    daemon = start(f"{USB}?size=1920x960")
    health = daemon.wait_state("DOWN")
    assert "S_FMT: the driver sets another format or size than it offers" in health.faults[0].text
    assert not health.frames_received


# ---------------------------------------------------------------- controls


def test_controls_are_held_and_put_back(start, camera):
    camera.plug()
    before = camera.state()
    assert before["ae_mode"] == 8
    assert before["white_balance_auto"] == 1
    daemon = start(f"{USB}?{SMALL}&white_balance_k=5003&power_line=50", "--exposure-us=2030")
    daemon.wait_estimate()
    wait_for("exposure", lambda: camera.state()["exposure"] == 20)
    held = camera.state()
    assert held["ae_mode"] == 1
    assert held["gain"] == 16
    assert held["white_balance_auto"] == 0
    assert held["white_balance"] == 5000
    assert held["power_line"] == 1
    assert (held["sharpness"], held["backlight"]) == (0, 0)
    assert "switched off: backlight compensation 1 → 0, sharpness 3 → 0" in daemon.log()
    daemon.wait_health("exposure", lambda health: True)
    wait_for("known exposure", lambda: daemon.wait_estimate().exposure_us == 2000)
    daemon.stop()
    after = camera.state()
    assert {key: after[key] for key in before if key not in ("sent", "overrun")} == {
        key: before[key] for key in before if key not in ("sent", "overrun")
    }


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("read-only", "cannot be switched off"),
        ("missing", "it has no exposure control"),
    ],
)
def test_camera_without_settable_exposure(start, make_camera, kind, words):
    make_camera(exposure=kind).plug()
    daemon = start(f"{USB}?{SMALL}")
    estimate = daemon.wait_estimate()
    assert words in daemon.log()
    assert "no brackets" in daemon.log()
    if kind == "read-only":
        assert not estimate.HasField("exposure_us")
        assert estimate.flags & 2  # ESTIMATE_FLAG_EXPOSURE_UNKNOWN
        assert (
            "stays on, and alters the light: backlight compensation 1 (read-only)" in daemon.log()
        )


def test_camera_file_decides(start, make_camera, tmp_path):
    make_camera(usb="2e1a:1000").plug()
    profile = tmp_path / "test.camera"
    profile.write_text(
        "[camera]\nmatch = usb:2e1a:1000\nprojection = equirect\nwidth_px = 640\n"
        "height_px = 320\n[v4l2]\nformat = grey\nexposure = auto\n"
    )
    daemon = start("v4l2:", f"--camera={profile}")
    estimate = daemon.wait_estimate()
    assert "GREY 640x320 at 30 Hz, of unknown exposure" in daemon.log()
    assert not estimate.HasField("exposure_us")


# ---------------------------------------------------------------- bad frames


def test_spoiled_frames_are_gaps_that_are_counted(start, camera):
    camera.plug()
    daemon = start(f"{USB}?{SMALL}&format=grey&fps=5")
    before = daemon.wait_state("STREAMING")
    for fault in ("empty 1", "error 1", "truncated 1", "overlong 1"):
        spoiled = camera.state()["spoiled"]
        camera.command(fault)
        wait_for(fault, lambda before=spoiled: camera.state()["spoiled"] > before)
    daemon.wait_health(
        "four dropped",
        lambda health: health.frames_dropped >= before.frames_dropped + 4,
    )


@pytest.mark.parametrize("fault", ["error 3", "truncated 3", "overlong 3"])
def test_flagged_frames_are_rejected(start, camera, fault):
    """uvcvideo with nodrop=1 delivers frames with errors; they are counted and not used."""
    load_drivers(nodrop=1)
    try:
        camera.plug()
        daemon = start(f"{USB}?{SMALL}&format=grey&fps=5")
        daemon.wait_estimate()
        camera.command(fault)
        daemon.wait_health("rejected", lambda health: health.frames_rejected >= 1)
    finally:
        load_drivers(nodrop=0)


@pytest.mark.parametrize("fault", ["garbage 3", "truncated 3", "wrong-size 3"])
def test_broken_jpeg_is_rejected_and_the_next_is_used(start, camera, fault):
    camera.plug()
    daemon = start(f"{USB}?{SMALL}&format=mjpeg&fps=5")
    daemon.wait_estimate()
    camera.command(fault)
    daemon.wait_health("rejected", lambda health: health.frames_rejected >= 1)
    daemon.wait_estimate(time.time_ns())


# ---------------------------------------------------------------- silence


def test_stall_is_told_and_ends(start, camera):
    camera.plug()
    daemon = start(f"{USB}?{SMALL}&stall_ms=500&reset=0")
    daemon.expect_stall(camera.command, "restarting the stream")


def test_halted_endpoint_is_cleared(start, camera):
    camera.plug()
    daemon = start(f"{USB}?{SMALL}&stall_ms=500")
    daemon.wait_estimate()
    camera.command("halt 1")
    wait_for("restart", lambda: "restarting the stream" in daemon.log())
    daemon.wait_estimate(time.time_ns())


def test_hanging_camera_is_cured_by_a_reset_of_its_port(start, camera):
    camera.plug()
    daemon = start(f"{USB}?{SMALL}&stall_ms=500")
    daemon.wait_estimate()
    camera.command("hang 1")
    daemon.wait_state("STALLED")
    daemon.wait_state("STREAMING")
    assert "the camera hung: its USB port" in daemon.log()


def test_camera_that_does_not_answer_does_not_stop_the_daemon(start, camera):
    """Requests time out after five seconds in the kernel; clients are served meanwhile."""
    camera.plug()
    daemon = start(f"{USB}?{SMALL}&stall_ms=500&reset=0")
    daemon.wait_estimate()
    camera.command("mute 1")
    camera.command("silent 1")
    daemon.wait_state("STALLED")
    times = []
    for _ in range(20):
        daemon.wait_health("health", lambda health: True)
        times.append(time.monotonic())
    assert max(b - a for a, b in itertools.pairwise(times)) < 3
    camera.command("mute 0")
    camera.command("silent 0")
    daemon.wait_state("STREAMING")


# ---------------------------------------------------------------- who may


def test_busy_camera_is_waited_for(start, camera):
    node = camera.plug()
    with subprocess.Popen(
        ["v4l2-ctl", "-d", str(node), "--stream-mmap=4", "--stream-to=/dev/null"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as other:  # fmt: skip
        wait_for("frames", lambda: camera.state()["sent"] > 2)
        daemon = start(f"{USB}?{SMALL}")
        health = daemon.wait_state("WAITING")
        assert "device busy — is another program using it?" in health.faults[0].text
        other.terminate()
    daemon.wait_state("STREAMING")


def test_missing_permission_names_the_group_and_the_rule(start, camera):
    camera.plug()
    daemon = start(f"{USB}?{SMALL}", user=65534)
    daemon.wait_state("WAITING")
    wait_for("message", lambda: "no permission" in daemon.log())
    assert "group video" in daemon.log()
    assert "70-lightprobe.rules" in daemon.log()


def test_metadata_node_is_no_capture_device(start, camera):
    camera.plug()
    daemon = start("v4l2:/dev/video1")
    daemon.wait_state("DOWN")
    assert "not a capture device" in daemon.log()
