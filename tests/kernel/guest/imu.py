# SPDX-License-Identifier: Apache-2.0
"""An inertial sensor in user space: a HID sensor (UHID) that the kernel's own drivers serve as IIO.

The report descriptor is that of a three-axis gyrometer (HID Usage Tables, sensors page 0x20):
angular velocities in hundredths of a degree per second, sent as often as the host asks for.
"""

import os
import select
import struct
import threading
import time
from collections.abc import Callable

_CREATE2, _DESTROY, _INPUT2 = 11, 1, 12
_GET_REPORT, _GET_REPORT_REPLY, _SET_REPORT, _SET_REPORT_REPLY = 9, 10, 13, 14
_INPUT_REPORT = 2
_EVENT_BYTES = 4380
_BUS_USB = 3


def _descriptor() -> bytes:
    def selectors(usage: int, first: int, count: int) -> bytes:
        """One byte that names one of `count` usages from `first` on."""
        body = b"\x0a" + struct.pack("<H", usage) + b"\x15\x00\x25" + bytes([count - 1])
        body += b"\x75\x08\x95\x01\xa1\x02"
        for k in range(count):
            body += b"\x0a" + struct.pack("<H", first + k)
        return body

    feature, data = b"\xb1\x00\xc0", b"\x81\x00\xc0"
    text = b"\x05\x20\x09\x76\xa1\x00\x85\x01"  # sensors; gyrometer 3D; physical; report 1
    text += selectors(0x0316, 0x0840, 6) + feature  # reporting state
    text += selectors(0x0319, 0x0850, 6) + feature  # power state
    text += b"\x0a\x0e\x03\x15\x00\x27\xff\xff\xff\x7f\x75\x20\x95\x01\x55\x00\xb1\x02"  # interval
    text += selectors(0x0201, 0x0800, 7) + data  # sensor state
    text += selectors(0x0202, 0x0810, 6) + data  # sensor event
    for axis in (0x0457, 0x0458, 0x0459):  # angular velocity, 0.01 degrees per second
        text += b"\x0a" + struct.pack("<H", axis)
        text += b"\x17\x00\x00\x00\x80\x27\xff\xff\xff\x7f\x75\x20\x95\x01"
        text += b"\x55\x0e\x81\x02"
    return text + b"\xc0"


class Imu:
    """A gyroscope; `rate(t_s)` gives degrees per second about x, y, z."""

    def __init__(self, rate: Callable[[float], tuple[float, float, float]]) -> None:
        """Plug it in."""
        self.rate = rate
        self.interval_ms = 10
        self._begin_s = time.monotonic()
        self._fd = os.open("/dev/uhid", os.O_RDWR)
        descriptor = _descriptor()
        head = struct.pack("<I128s64s64s", _CREATE2, b"lightprobe gyroscope", b"imu", b"1")
        ids = struct.pack("<HHIIII", len(descriptor), _BUS_USB, 0x1209, 0x0001, 0, 0)
        self._write(head + ids + descriptor)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Take it away."""
        self._ended.set()
        self._thread.join()
        os.close(self._fd)

    def _write(self, event: bytes) -> None:
        os.write(self._fd, event.ljust(_EVENT_BYTES, b"\0")[:_EVENT_BYTES])

    def _run(self) -> None:
        due_s = self._begin_s
        while not self._ended.is_set():
            ready, _, _ = select.select([self._fd], [], [], max(0, due_s - time.monotonic()))
            if ready:
                self._answer(os.read(self._fd, _EVENT_BYTES))
            now_s = time.monotonic()
            if now_s >= due_s:
                due_s = max(due_s + max(self.interval_ms, 1) / 1000, now_s)
                self._send()

    def _input(self) -> bytes:
        """Input report: number, state ready, event sample, axes."""
        axes = [round(100 * value) for value in self.rate(time.monotonic() - self._begin_s)]
        return struct.pack("<BBBiii", 1, 1, 1, *axes)

    def _send(self) -> None:
        data = self._input()
        self._write(struct.pack("<IH", _INPUT2, len(data)) + data)

    def _answer(self, event: bytes) -> None:
        kind = struct.unpack_from("<I", event)[0]
        if kind == _GET_REPORT:
            number, _, kind_of_report = struct.unpack_from("<IBB", event, 4)
            data = struct.pack("<BBBI", 1, 1, 1, self.interval_ms)
            if kind_of_report == _INPUT_REPORT:
                data = self._input()
            self._write(struct.pack("<IIHH", _GET_REPORT_REPLY, number, 0, len(data)) + data)
        elif kind == _SET_REPORT:
            number, _, _, size = struct.unpack_from("<IBBH", event, 4)
            data = event[12 : 12 + size]
            if len(data) >= 7:
                self.interval_ms = struct.unpack_from("<I", data, 3)[0] or self.interval_ms
            self._write(struct.pack("<IIH", _SET_REPORT_REPLY, number, 0))
