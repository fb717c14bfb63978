# SPDX-License-Identifier: Apache-2.0
"""The host's udev in the guest, with the project's rules, for tests that need its database."""

import shutil
from pathlib import Path

from camera import load_drivers
from machine import modprobe, run

RULES = Path(__file__).resolve().parents[3] / "packaging" / "udev" / "70-lightprobe.rules"


def start_udev() -> None:
    """Start it, once; from now on nodes get their group, and devices their properties."""
    if Path("/run/udev/control").exists():
        return
    Path("/etc/udev/rules.d").mkdir(parents=True, exist_ok=True)
    shutil.copy(RULES, "/etc/udev/rules.d")
    run("/lib/systemd/systemd-udevd", "--daemon")


def settle() -> None:
    """Wait until all events are handled."""
    run("udevadm", "settle", "--timeout=60", timeout_s=90)


def prepare_libcamera(nodrop: int = 0) -> None:
    """Load the drivers of cameras, and what libcamera finds them by; nodrop: see load_drivers()."""
    load_drivers(nodrop=nodrop)
    modprobe("firmware_node")
    start_udev()
