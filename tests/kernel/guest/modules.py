# SPDX-License-Identifier: Apache-2.0
"""Two fisheye modules back to back that see the simulated room, and what a daemon makes of them."""

import time

from camera import Camera
from machine import wait_for
from room import PICTURES, TRUTH, angle_deg

from daemon import Daemon

NAMES = ("ahead", "back")
CAMERA_FILES = [f"--camera={PICTURES / name}.camera" for name in NAMES]
PARTIAL_VIEW = 32  # ESTIMATE_FLAG_PARTIAL_VIEW
EXPOSURE_US = 100  # one of those that there are pictures of
STILL = (f"--exposure-us={EXPOSURE_US}", "--orientation=none", "--preset=fast")
OFF_DEG = 4.0  # lamps of 5 to 9 pixels; the nearest two are 60° apart


def make_modules(make_camera, usb: tuple[str, str] = ("1d6b:0102", "1d6b:0102")) -> list[Camera]:
    """Return the two cameras, plugged in, with these identities."""
    found = [
        make_camera(port=port, usb=usb[port], pictures=f"folder:{PICTURES / name}")
        for port, name in enumerate(NAMES)
    ]
    for camera in found:
        camera.plug()
    return found


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


def wait_room(daemon: Daemon, *, whole: bool):
    """Wait until the room is known, and all directions are seen by frames from now on, or not."""
    since_ns = time.time_ns()
    last = ""

    def is_known():
        nonlocal last
        estimate = daemon.wait_estimate(since_ns)
        seen = not estimate.flags & PARTIAL_VIEW
        off = off_deg(estimate, ahead=not whole)
        last = f"flags {estimate.flags:#x}, {estimate.exposure_us} us, {off:.1f} degrees off"
        return estimate.exposure_us == EXPOSURE_US and off < OFF_DEG and seen == whole

    try:
        return wait_for("a whole view" if whole else "a partial view", is_known, timeout_s=240)
    except AssertionError as error:
        raise AssertionError(f"{error}: {last}\n{daemon.log()}") from None
