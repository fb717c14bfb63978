# SPDX-License-Identifier: Apache-2.0
"""CAN: virtual interfaces, and two emulated Kvaser cards on one bus with real bit timing."""

import subprocess
from pathlib import Path

from machine import run, wait_for


def listening_interfaces() -> set[str]:
    """Interfaces on which some socket takes all frames: first words of the kernel's table."""
    lines = Path("/proc/net/can/rcvlist_all").read_text().splitlines()
    return {line.split()[0] for line in lines if line.split()}


def frame_over(sender: str, receiver: str, frame: str) -> str:
    """Send one frame and return what candump saw at the other end."""
    with subprocess.Popen(
        ["candump", "-L", "-n", "1", "-T", "15000", receiver],
        stdout=subprocess.PIPE,
        text=True,
    ) as dump:
        wait_for("candump", lambda: receiver in listening_interfaces())
        run("cansend", sender, frame)
        return dump.communicate(timeout=20)[0]


def test_vcan_carries_a_frame(vcan):
    assert "123#DEADBEEF" in frame_over(vcan, vcan, "123#DEADBEEF")


def test_kvaser_pair_carries_a_frame(kvaser):
    assert "7FF#1122334455667788" in frame_over(*kvaser, "7FF#1122334455667788")
    state = run("ip", "-details", "link", "show", kvaser[0])
    assert "state ERROR-ACTIVE" in state
    assert "bitrate 500000" in state
