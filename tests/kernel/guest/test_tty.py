# SPDX-License-Identifier: Apache-2.0
"""Serial lines: a CDC-ACM gadget that can be unplugged; two emulated FTDI adapters, joined."""

import os
import select
import time
import tty
from contextlib import contextmanager
from pathlib import Path

import pytest
from gadget import Gadget
from machine import modprobe, wait_for


@contextmanager
def serial(path: Path):
    """File descriptor of a serial device in raw mode."""
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    tty.setraw(fd)
    yield fd
    os.close(fd)


def read_all(fd: int, size_bytes: int, timeout_s: float = 15) -> bytes:
    """Read exactly so many bytes; fewer when the time is up."""
    data = b""
    end = time.monotonic() + timeout_s
    while len(data) < size_bytes and select.select([fd], [], [], end - time.monotonic())[0]:
        data += os.read(fd, size_bytes - len(data))
    return data


@pytest.fixture(scope="module")
def acm():
    """A serial gadget: the host's end is ttyACM0, the device's is ttyGS0."""
    modprobe("usb_f_acm")
    modprobe("cdc-acm")
    return Gadget("serial", "acm.usb0", 0x0104)


@pytest.fixture(scope="module")
def ftdi():
    """Two FTDI adapters of QEMU's, joined by a null-modem cable."""
    for module in ("xhci-pci", "ftdi_sio"):
        modprobe(module)
    ends = [Path("/dev/ttyUSB0"), Path("/dev/ttyUSB1")]
    wait_for("two FTDI adapters", lambda: all(end.exists() for end in ends))
    return ends


def test_acm_carries_bytes_and_survives_a_replug(acm):
    host, device = Path("/dev/ttyACM0"), Path("/dev/ttyGS0")
    for _ in range(2):
        acm.plug()
        wait_for("ttyACM0", host.exists)
        with serial(host) as there, serial(device) as here:
            os.write(there, b"hello")
            assert read_all(here, 5) == b"hello"
            os.write(here, b"world")
            assert read_all(there, 5) == b"world"
        acm.unplug()
        wait_for("ttyACM0 gone", lambda: not host.exists())


def test_ftdi_pair_carries_bytes(ftdi):
    with serial(ftdi[0]) as one, serial(ftdi[1]) as other:
        os.write(one, b"to the other")
        assert read_all(other, 12) == b"to the other"
        os.write(other, b"and back")
        assert read_all(one, 8) == b"and back"
