# SPDX-License-Identifier: Apache-2.0
"""A camera for stills on a real bus: its descriptors and endpoints, by FunctionFS."""

import os
import queue
import struct
import threading
import time
from pathlib import Path

from gadget import Gadget
from machine import run
from theta import Theta

RICOH = 0x05CA
PRODUCT = 0x0370
BULK, INTERRUPT = 2, 3
PACKET_BYTES = 512  # of a bulk endpoint at high speed
FULL_SPEED, HIGH_SPEED = 1, 2
STILL_IMAGE = (6, 1, 1)  # class, subclass, protocol: PTP


def descriptors(bulk_bytes: int) -> bytes:
    """Interface and endpoints at one speed."""
    ends = ((0x81, BULK, bulk_bytes, 0), (0x02, BULK, bulk_bytes, 0), (0x83, INTERRUPT, 64, 4))
    data = struct.pack("<9B", 9, 4, 0, 0, len(ends), *STILL_IMAGE, 1)
    for address, kind, packet_bytes, interval in ends:
        data += struct.pack("<BBBBHB", 7, 5, address, kind, packet_bytes, interval)
    return data


class StillCamera:
    """A THETA on port 0 of the bus, unplugged until plug()."""

    def __init__(self, theta: Theta) -> None:
        self.theta = theta
        self._gadget = Gadget("theta", "ffs.theta", PRODUCT, RICOH, serial=theta.serial)
        self._folder = Path("/dev/ffs-theta")
        self._folder.mkdir(exist_ok=True)
        run("mount", "-t", "functionfs", "theta", str(self._folder))
        self._control = os.open(self._folder / "ep0", os.O_RDWR)
        data = descriptors(64) + descriptors(PACKET_BYTES)
        head = struct.pack("<5I", 3, 20 + len(data), FULL_SPEED | HIGH_SPEED, 4, 4)
        os.write(self._control, head + data)
        name = b"\x09\x04PTP\0"
        os.write(self._control, struct.pack("<4I", 2, 16 + len(name), 1, 1) + name)
        self._in = os.open(self._folder / "ep1", os.O_RDWR)
        self._out = os.open(self._folder / "ep2", os.O_RDWR)
        self._interrupt = os.open(self._folder / "ep3", os.O_RDWR)
        self._events: queue.Queue[bytes] = queue.Queue()
        self.become(theta)
        self._is_plugged = False
        for work in (self._watch, self._serve, self._announce):
            threading.Thread(target=work, daemon=True).start()

    def become(self, theta: Theta) -> None:
        """Another camera at the same cable, which must be unplugged."""
        self.theta.send_event = lambda event: None  # of a set that it has not ended yet
        self.theta = theta
        theta.send_event = self._events.put

    def plug(self) -> None:
        """Attach to the bus."""
        self.theta.replugged()
        self._is_plugged = True
        self._gadget.plug(0)

    def unplug(self) -> None:
        """Detach, as pulling the cable does."""
        if self._is_plugged:
            self._is_plugged = False
            self._gadget.unplug()
        while not self._events.empty():
            self._events.get()

    def _watch(self) -> None:
        """Take what the bus says: a function whose events nobody reads is not enabled."""
        while True:
            os.read(self._control, 4096)

    def _serve(self) -> None:
        while True:
            try:
                for answer in self.theta.receive(os.read(self._out, 4 * PACKET_BYTES)):
                    os.write(self._in, answer)
                    if len(answer) % PACKET_BYTES == 0:
                        os.write(self._in, b"")
            except OSError:  # unplugged
                time.sleep(0.05)

    def _announce(self) -> None:
        while True:
            event = self._events.get()
            try:
                os.write(self._interrupt, event)
            except OSError:
                time.sleep(0.05)
