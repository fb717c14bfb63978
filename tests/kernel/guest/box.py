# SPDX-License-Identifier: Apache-2.0
"""The microcontroller's firmware as a process in the guest, and bridges from its serial line to the
kernel's devices: a serial gadget, a CAN interface, the mailbox of an I2C slave.

A bridge carries whole messages; what their bytes are on each carrier: proto/mcu.md.
"""

import os
import select
import socket
import struct
import subprocess
import threading
import tty
from abc import ABC, abstractmethod
from contextlib import suppress
from pathlib import Path

from machine import wait_for

REPO = Path(__file__).resolve().parents[3]
FIRMWARE = REPO / "build" / "firmware" / "lightprobe-mcu-host"
CAN_BASE = 0x500
CAN_FRAME = struct.Struct("=IB3x8s")
MAIL_BYTES = 13


class Firmware:
    """The firmware in its simulated box, on a pty."""

    def __init__(self, name: str) -> None:
        self.line = Path(f"/run/{name}-tty")
        control = Path(f"/run/{name}-control")
        self._process = subprocess.Popen([FIRMWARE, "--pty", self.line, "--control", control])
        wait_for("the box's control socket", control.exists)
        self._control = socket.socket(socket.AF_UNIX)
        self._control.connect(str(control))
        wait_for("the box's line", self.line.exists)

    def set(self, **numbers: float) -> None:
        """Set numbers of the box (firmware/board/host/world.h)."""
        for name, value in numbers.items():
            self.command(f"set {name} {value}")

    def command(self, line: str) -> str:
        """Send one command; return its answer."""
        self._control.sendall(line.encode() + b"\n")
        answer = self._control.recv(4096).decode().strip()
        assert not answer.startswith("error"), answer
        return answer

    def stop(self) -> None:
        """End it."""
        self._control.close()
        self._process.terminate()
        self._process.wait()


def cobs_decode(block: bytes) -> bytes:
    """Undo COBS; the block is without its closing zero."""
    out = bytearray()
    while block:
        out += block[1 : block[0]]
        block = block[block[0] :]
        if block:
            out.append(0)
    return bytes(out)


def cobs_encode(data: bytes) -> bytes:
    """COBS, with the closing zero."""
    return b"".join(bytes([len(part) + 1]) + part for part in data.split(b"\0")) + b"\0"


def envelope_of(identifier: int, payload: bytes) -> bytes:
    """Id, payload, sum, CRC-16/CCITT-FALSE."""
    data = bytes([identifier]) + payload
    data += bytes([sum(data) & 0xFF])
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return data + struct.pack("<H", crc)


class Bridge(threading.Thread, ABC):
    """Carries messages between a line and a device until stop()."""

    def __init__(self, line: Path) -> None:
        super().__init__(daemon=True)
        self._line = os.open(line, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self._line)
        self._rest = b""
        self._ended = threading.Event()
        self.start()

    @abstractmethod
    def open(self) -> int:
        """Descriptor of the device; -1: not there."""

    @abstractmethod
    def read(self, fd: int) -> bytes:
        """What came from the daemon, as bytes of the line."""

    @abstractmethod
    def write(self, fd: int, frames: list[bytes], raw: bytes) -> None:
        """Hand on what the firmware has said: envelopes, and the line's own bytes."""

    def _take_line(self) -> tuple[list[bytes], bytes]:
        raw = os.read(self._line, 4096)
        *blocks, self._rest = (self._rest + raw).split(b"\0")
        return [cobs_decode(block) for block in blocks if block], raw

    def _serve(self, fd: int) -> None:
        while not self._ended.is_set():
            ready = select.select([fd, self._line], [], [], 0.1)[0]
            if fd in ready:
                os.write(self._line, self.read(fd))
            if self._line in ready:
                self.write(fd, *self._take_line())

    def run(self) -> None:
        """Serve the device, again and again when it goes."""
        while not self._ended.is_set():
            with suppress(OSError):
                fd = self.open()
                try:
                    self._serve(fd)
                finally:
                    os.close(fd)
            self._ended.wait(0.1)

    def stop(self) -> None:
        """End it and wait."""
        self._ended.set()
        self.join()
        os.close(self._line)


class SerialBridge(Bridge):
    """To the device's end of a serial line."""

    def __init__(self, line: Path, device: Path) -> None:
        self._device = device
        super().__init__(line)

    def open(self) -> int:
        fd = os.open(self._device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(fd)
        return fd

    def read(self, fd: int) -> bytes:
        data = os.read(fd, 4096)
        if not data:
            raise OSError("hung up")
        return data

    def write(self, fd: int, frames: list[bytes], raw: bytes) -> None:
        with suppress(BlockingIOError):  # nobody reads: lost, as on a line
            os.write(fd, raw)


class CanBridge(Bridge):
    """To a CAN interface."""

    def __init__(self, line: Path, interface: str) -> None:
        self._interface = interface
        super().__init__(line)

    def open(self) -> int:
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as bus:
            bus.bind((self._interface,))
            return bus.detach()

    def read(self, fd: int) -> bytes:
        identifier, length, data = CAN_FRAME.unpack(os.read(fd, CAN_FRAME.size))
        if not CAN_BASE < identifier < CAN_BASE + 0x40:
            return b""
        return cobs_encode(envelope_of(identifier - CAN_BASE, data[:length]))

    def write(self, fd: int, frames: list[bytes], raw: bytes) -> None:
        for envelope in frames:
            payload = envelope[1:-3]
            frame = CAN_FRAME.pack(CAN_BASE + envelope[0], len(payload), payload.ljust(8, b"\0"))
            with suppress(BlockingIOError):
                os.write(fd, frame)


class MailboxBridge(Bridge):
    """To the I2C slave of modules/i2c_mailbox.c."""

    def open(self) -> int:
        return os.open("/dev/i2c_mailbox", os.O_RDWR)

    def read(self, fd: int) -> bytes:
        mail = os.read(fd, MAIL_BYTES)
        return cobs_encode(mail[1 : 1 + mail[0]])

    def write(self, fd: int, frames: list[bytes], raw: bytes) -> None:
        for envelope in frames:
            with suppress(OSError):  # the mailbox is full: nobody reads
                os.write(fd, (bytes([len(envelope)]) + envelope).ljust(MAIL_BYTES, b"\xff"))
