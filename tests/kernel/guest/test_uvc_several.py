# SPDX-License-Identifier: Apache-2.0
"""Two fisheye modules of one make on USB, back to back: one probe. They have one serial number."""

import time
from pathlib import Path

import pytest
from camera import Camera, device_of, load_drivers
from machine import wait_for
from room import PICTURES, TRUTH, angle_deg

NAMES = ("ahead", "back")
PARTIAL_VIEW = 32  # ESTIMATE_FLAG_PARTIAL_VIEW
EXPOSURE_US = 100  # one of those that there are pictures of
STILL = (f"--exposure-us={EXPOSURE_US}", "--orientation=none", "--preset=fast")
OFF_DEG = 4.0  # lamps of 5 to 9 pixels; the nearest two are 60° apart
RATES = {"ahead": 15, "back": 5}


@pytest.fixture(scope="module", autouse=True)
def _drivers():
    load_drivers()


@pytest.fixture
def modules(make_camera):
    """Two cameras, plugged in."""
    found = [
        make_camera(port=port, pictures=f"folder:{PICTURES / name}")
        for port, name in enumerate(NAMES)
    ]
    for camera in found:
        camera.plug()
    return found


def port_of(camera: Camera) -> str:
    """USB port, as the kernel names it."""
    return Path(device_of(camera.node())).name.partition(":")[0]


@pytest.fixture
def daemon(start, modules):
    """A daemon that reads both, each named by its port."""
    first, second = (
        f"v4l2:port:{port_of(camera)}?size=640x320&format=mjpeg&fps={RATES[name]}"
        for camera, name in zip(modules, NAMES, strict=True)
    )
    files = [f"--camera={PICTURES / name}.camera" for name in NAMES]
    return start(first, f"--source={second}", *files, *STILL)


def off_deg(estimate, *, ahead: bool = False) -> float:
    """By how much the lamp known worst is off; `ahead`: of those that the first module sees."""
    return max(
        min(
            (angle_deg(light.direction, lamp["direction"]) for light in estimate.lights),
            default=180,
        )
        for lamp in TRUTH["lamps"]
        if not ahead or lamp["direction"][2] < 0
    )


def wait_room(daemon, *, whole: bool):
    """Wait until the room is known, and all directions are seen by frames from now on, or not."""
    since_ns = time.time_ns()

    def is_known():
        estimate = daemon.wait_estimate(since_ns)
        seen = not estimate.flags & PARTIAL_VIEW
        known = off_deg(estimate, ahead=not whole) < OFF_DEG
        return estimate.exposure_us == EXPOSURE_US and known and seen == whole

    return wait_for("a whole view" if whole else "a partial view", is_known, timeout_s=240)


def test_one_is_unplugged_and_comes_back(daemon, modules):
    _, back = modules
    wait_room(daemon, whole=True)
    port = port_of(back)
    back.unplug()
    health = daemon.wait_health("a fault", lambda health: len(health.faults) == 1)
    assert health.source_state == 3  # STREAMING
    assert health.faults[0].id == "source-waiting"
    assert f"unplugged from port {port} — replug it there" in health.faults[0].text
    # The other goes on.
    wait_room(daemon, whole=False)
    for _ in range(10):
        estimate = daemon.wait_estimate(time.time_ns())
        assert estimate.flags & PARTIAL_VIEW
    back.plug()
    wait_room(daemon, whole=True)
    health = daemon.wait_health("no fault", lambda health: not health.faults)
    assert health.source_reconnects == 1


def test_one_is_not_taken_for_the_other(daemon, modules):
    """Both go; the one that comes back alone is used as itself, though their numbers are one."""
    ahead, back = modules
    wait_room(daemon, whole=True)
    port = port_of(ahead)
    ahead.unplug()
    back.unplug()
    daemon.wait_state("WAITING")
    back.plug()
    health = daemon.wait_state("STREAMING")
    (fault,) = health.faults
    assert f"unplugged from port {port} — replug it there" in fault.text, fault.text
    ahead.plug()
    wait_room(daemon, whole=True)


def test_named_by_what_they_have_in_common_they_are_refused(start, modules):
    alike = start("v4l2:1d6b:0102:0001?size=640x320")
    health = alike.wait_state("WAITING")
    text = health.faults[0].text
    assert "— name one by its port, like v4l2:port:" in text, text
    for camera in modules:
        assert f"port {port_of(camera)}" in alike.log()
