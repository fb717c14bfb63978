# SPDX-License-Identifier: Apache-2.0
"""The libcamera source's promises on the kernel's uvcvideo: corrupt frames."""

import pytest
from camera import load_drivers
from contract import check_corrupt_frames_first, check_only_corrupt_frames
from udev import prepare_libcamera, settle

SMALL = "size=640x320&format=grey"


@pytest.fixture(scope="module", autouse=True)
def _flagged():
    """Deliver frames with errors, with a flag."""
    prepare_libcamera(nodrop=1)
    settle()
    yield
    load_drivers(nodrop=0)


def test_corrupt_frames_first_are_counted(start, camera):
    check_corrupt_frames_first(start, camera, f"libcamera:?{SMALL}")


def test_only_corrupt_frames_are_a_stall(start, camera):
    check_only_corrupt_frames(start, camera, f"libcamera:?{SMALL}")
