# SPDX-License-Identifier: Apache-2.0
"""Two fisheye modules through libcamera, whose manager of cameras they share: one probe."""

import time

import pytest
from modules import CAMERA_FILES, PARTIAL_VIEW, STILL, make_modules, wait_room
from udev import prepare_libcamera, settle

# libcamera's names leave out which bus a camera is on: these two differ by their product.
USB = ("1d6b:0102", "1d6b:0103")
STREAMING = 3


@pytest.fixture(scope="module", autouse=True)
def _drivers():
    prepare_libcamera()


@pytest.fixture
def modules(make_camera):
    """Two cameras, plugged in, and known to udev."""
    found = make_modules(make_camera, USB)
    settle()
    return found


@pytest.fixture
def daemon(start, modules):
    """A daemon that reads both."""
    first, second = (f"libcamera:{usb}?size=640x320&format=mjpeg" for usb in USB)
    return start(first, f"--source={second}", *CAMERA_FILES, *STILL)


@pytest.mark.limit_s(900)
def test_one_is_unplugged_and_comes_back(daemon, modules):
    wait_room(daemon, whole=True)
    for reconnects, (camera, usb) in enumerate(zip(modules, USB, strict=True), 1):
        camera.unplug()
        health = daemon.wait_health("a fault", lambda health: len(health.faults) == 1)
        assert health.source_state == STREAMING
        assert health.faults[0].id == "source-waiting"
        assert usb in health.faults[0].text
        # The other goes on.
        for _ in range(10):
            estimate = daemon.wait_estimate(time.time_ns())
        assert estimate.flags & PARTIAL_VIEW
        camera.plug()
        wait_room(daemon, whole=True)
        health = daemon.wait_health("no fault", lambda health: not health.faults)
        assert health.source_reconnects == reconnects


def test_both_are_unplugged_and_come_back(daemon, modules):
    """With the last camera libcamera's manager ends, and begins anew for the next."""
    wait_room(daemon, whole=True)
    for camera in modules:
        camera.unplug()
    daemon.wait_state("WAITING")
    for camera in reversed(modules):
        camera.plug()
    wait_room(daemon, whole=True)
