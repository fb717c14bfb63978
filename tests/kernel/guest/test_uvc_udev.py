# SPDX-License-Identifier: Apache-2.0
"""A node that udevd gives its group late, as on a real machine: the daemon waits for it."""

from pathlib import Path

import pytest
from camera import load_drivers
from machine import run
from udev import settle, start_udev

SMALL = "size=640x320&format=grey"
NOBODY = 65534
# Rules run before the node gets its group: until this one has ended only root may open it.
LATE = Path("/run/udev/rules.d/10-late.rules")
RULE = 'SUBSYSTEM=="video4linux", PROGRAM="/bin/sleep 4"\n'


@pytest.fixture(scope="module", autouse=True)
def _late_udev():
    load_drivers()
    LATE.parent.mkdir(parents=True, exist_ok=True)
    LATE.write_text(RULE)
    start_udev()
    run("udevadm", "control", "--reload")
    yield
    LATE.unlink()
    run("udevadm", "control", "--reload")


def test_permissions_that_come_late(start, camera):
    daemon = start(f"v4l2:?{SMALL}", user=NOBODY, groups="video")
    daemon.wait_state("WAITING")
    camera.plug()
    daemon.wait_state("STREAMING")
    settle()


def test_a_camera_swapped_for_another(start, make_camera):
    """The first one is of no use for what was asked; the second one may not be opened at once."""
    unfit, fit = make_camera(), make_camera(port=1, serial="0002")
    unfit.command("other-size 1")
    unfit.plug()
    settle()
    daemon = start("v4l2:?size=1920x960", user=NOBODY, groups="video")
    daemon.wait_state("DOWN")
    unfit.unplug()
    fit.plug()
    daemon.wait_state("STREAMING")
    settle()
