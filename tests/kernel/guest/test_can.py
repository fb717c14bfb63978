# SPDX-License-Identifier: Apache-2.0
"""CAN: virtual interfaces, and two emulated Kvaser cards on one bus with real bit timing."""

import subprocess
from pathlib import Path

import pytest
from machine import modprobe, run, wait_for


@pytest.fixture(scope="module")
def vcan():
    """Name of a virtual CAN interface that is up."""
    modprobe("vcan")
    modprobe("can-raw")
    run("ip", "link", "add", "dev", "vcan0", "type", "vcan")
    run("ip", "link", "set", "up", "vcan0")
    return "vcan0"


@pytest.fixture(scope="module")
def kvaser():
    """Names of two interfaces on one bus at 500 kbit/s."""
    modprobe("can-raw")
    modprobe("kvaser_pci")
    for name in ("can0", "can1"):
        wait_for(name, lambda name=name: name in run("ip", "-br", "link"))
        run("ip", "link", "set", name, "type", "can", "bitrate", "500000")
        run("ip", "link", "set", name, "up")
    return "can0", "can1"


def listening_interfaces() -> set[str]:
    """Interfaces on which some socket takes all frames: first words of the kernel's table."""
    lines = Path("/proc/net/can/rcvlist_all").read_text().splitlines()
    return {line.split()[0] for line in lines if line.split()}


def frame_over(sender: str, receiver: str, frame: str) -> str:
    """Send one frame and return what candump saw at the other end."""
    with subprocess.Popen(
        ["candump", "-L", "-n", "1", "-T", "15000", receiver], stdout=subprocess.PIPE, text=True
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
