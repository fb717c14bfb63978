# SPDX-License-Identifier: Apache-2.0
"""The libcamera source's promises on the kernel's uvcvideo: corrupt frames."""

import pytest
from camera import load_drivers
from contract import check_corrupt_frames_first, check_only_corrupt_frames
from machine import modprobe
from udev import settle, start_udev

SMALL = "size=640x320&format=grey"


@pytest.fixture(scope="module", autouse=True)
def _flagged():
    """Deliver frames with errors, with a flag."""
    load_drivers(nodrop=1)
    modprobe("firmware_node")
    start_udev()
    settle()
    yield
    load_drivers(nodrop=0)


def test_corrupt_frames_first_are_counted(start, camera):
    check_corrupt_frames_first(start, camera, f"libcamera:?{SMALL}")


def test_only_corrupt_frames_are_a_stall(start, camera):
    check_only_corrupt_frames(start, camera, f"libcamera:?{SMALL}")
