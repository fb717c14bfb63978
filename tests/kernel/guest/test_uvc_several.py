# SPDX-License-Identifier: Apache-2.0
"""Two fisheye modules of one make on USB, back to back: one probe. They have one serial number."""

import time
from pathlib import Path

import pytest
from camera import Camera, device_of, load_drivers
from modules import CAMERA_FILES, PARTIAL_VIEW, STILL, make_modules, wait_room

RATES = (15, 5)


@pytest.fixture(scope="module", autouse=True)
def _drivers():
    load_drivers()


@pytest.fixture
def modules(make_camera):
    """Two cameras, plugged in."""
    return make_modules(make_camera)


def port_of(camera: Camera) -> str:
    """USB port, as the kernel names it."""
    return Path(device_of(camera.node())).name.partition(":")[0]


@pytest.fixture
def daemon(start, modules):
    """A daemon that reads both, each named by its port."""
    first, second = (
        f"v4l2:port:{port_of(camera)}?size=640x320&format=mjpeg&fps={rate}"
        for camera, rate in zip(modules, RATES, strict=True)
    )
    return start(first, f"--source={second}", *CAMERA_FILES, *STILL)


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
