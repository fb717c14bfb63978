# SPDX-License-Identifier: Apache-2.0
"""A simulated RICOH THETA X as PTP shows it: RICOH's THETA USB API v2, with what goes wrong there.

Bytes in, bytes out; the USB is functionfs.py's. Published at github.com/ricohapi/theta-api-specs.
"""

import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

COMMAND, DATA, RESPONSE, EVENT = 1, 2, 3, 4
OK, SESSION_NOT_OPEN, NOT_SUPPORTED = 0x2001, 0x2003, 0x2005
BAD_OBJECT, BAD_PROPERTY, READ_ONLY = 0x2009, 0x200A, 0x200F
BUSY, BAD_VALUE, ALREADY_OPEN = 0x2019, 0x201C, 0x201E
OBJECT_ADDED, CAPTURE_COMPLETE = 0x4002, 0x400D
JPEG = 0x3801
SINGLE, MULTI_BRACKET, LIVE_STREAMING = 0x0001, 0x8004, 0x8005
MANUAL = 1
STILL_CAPTURE_MODE, CAPTURE_STATUS, PROGRAM, ISO = 0x5013, 0xD808, 0x500E, 0x500F
SHUTTER_SPEED, BRACKET = 0xD00F, 0xD812
#: Numerator in the upper half, denominator in the lower one.
SHUTTERS = [
    (1 << 32) + n
    for n in (
        *(16000, 12800, 10000, 8000, 6400, 5000, 4000, 3200, 2500, 2000, 1600, 1250, 1000, 800),
        *(640, 500, 400, 320, 250, 200, 160, 125, 100, 80, 60, 50, 40, 30, 25, 20, 15, 10, 8),
        *(4, 2, 1),
    )
]
ISOS = [50, 64, 80, 100, 125, 160, 200, 400, 800, 1600, 3200]

#: How each property is read, and what it holds at first: (struct format, value).
PROPERTIES: dict[int, tuple[str, int]] = {
    0x5001: ("B", 100), 0x5002: ("H", 0), 0x5005: ("H", 2), PROGRAM: ("H", 2),
    ISO: ("H", 0xFFFF), 0x5012: ("I", 0), STILL_CAPTURE_MODE: ("H", SINGLE),
    SHUTTER_SPEED: ("Q", 0), 0xD803: ("H", 180), CAPTURE_STATUS: ("B", 0),
    0xD813: ("H", 5000), 0xD81B: ("I", 64800), 0xD825: ("B", 1), 0xD827: ("B", 0),
    0xD834: ("H", 1),
}  # fmt: skip
READ_ONLY_PROPERTIES = {0x5001, 0x5002, CAPTURE_STATUS}
#: Of a bracket nobody has set: two stills, automatic.
FIRST_BRACKET = struct.pack("<I", 4) + bytes(64)


def text(words: str) -> bytes:
    """Return a PTP string."""
    return struct.pack("B", len(words) + 1) + (words + "\0").encode("utf-16-le")


def codes(values: list[int]) -> bytes:
    """Return an array of 16-bit codes."""
    return struct.pack(f"<I{len(values)}H", len(values), *values)


def with_exif(jpeg: bytes, exposure_us: float, iso: int) -> bytes:
    """Put exposure time and sensitivity into a JPEG."""
    pointer = struct.pack("<HHHIII", 1, 0x8769, 4, 1, 26, 0)
    entries = struct.pack("<HHHII", 2, 0x829A, 5, 1, 56) + struct.pack(
        "<HHIII", 0x8827, 3, 1, iso, 0
    )
    tiff = b"II*\0\x08\0\0\0" + pointer + entries + struct.pack("<II", round(exposure_us), 1000000)
    part = b"Exif\0\0" + tiff
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(part) + 2) + part + jpeg[2:]


@dataclass
class Moods:
    """What it may do to who talks with it."""

    busy: int = 0  # answers in a row that it is busy, wherever that may be
    late_s: float = 0.05  # from the end of an exposure until a still is announced
    refuses: set[int] = field(default_factory=set)  # properties that it does not let be set
    loses: int = 0  # so many stills are never announced
    cuts: bool = False  # stills are cut off
    mute: bool = False  # no answers at all


class Theta:
    """`picture`: the JPEG of an exposure (microseconds), and what the exposure really was."""

    def __init__(self, picture: Callable[[float], tuple[bytes, float]], serial: str) -> None:
        self.picture, self.serial = picture, serial
        self.model, self.firmware = "RICOH THETA X", "2.71.1"
        self.values = {code: struct.pack(f"<{f}", v) for code, (f, v) in PROPERTIES.items()}
        self.values[BRACKET] = FIRST_BRACKET
        self.first_values = dict(self.values)
        self.moods = Moods()
        self.objects: dict[int, bytes] = {}
        self.stills = self.sets = 0
        self.has_session = False
        self.send_event: Callable[[bytes], None] = lambda event: None
        self._stops = threading.Event()
        self._asked: tuple[int, int, tuple[int, ...]] = (0, 0, ())

    def replugged(self) -> None:
        """Begin a new life on the bus; what is set stays, as on a battery."""
        self._stops.set()
        self.has_session = False

    def number(self, code: int) -> int:
        """Value of a property that is a number."""
        return int.from_bytes(self.values[code], "little")

    def set_number(self, code: int, value: int) -> None:
        """Change one, as somebody at the camera does."""
        self.values[code] = value.to_bytes(len(self.values[code]), "little")

    # ------------------------------------------------------------ containers

    def receive(self, container: bytes) -> list[bytes]:
        """Take one container from the host; returns those that answer it."""
        length, kind, code, transaction = struct.unpack_from("<IHHI", container)
        payload = container[12:length]
        if self.moods.mute:
            return []
        if kind == DATA:
            return self._answer(transaction, code, self._set(self._asked[2][0], payload), None)
        parameters = struct.unpack(f"<{len(payload) // 4}I", payload)
        self._asked = (code, transaction, parameters)
        if code == 0x1016:  # its data come in a container of their own
            return []
        response, data = self._operate(code, parameters)
        return self._answer(transaction, code, response, data)

    def _answer(
        self, transaction: int, code: int, response: int, data: bytes | None
    ) -> list[bytes]:
        answer = [struct.pack("<IHHI", 12, RESPONSE, response, transaction)]
        if data is not None and response == OK:
            head = struct.pack("<IHHI", 12 + len(data), DATA, code, transaction)
            answer.insert(0, head + data)
        return answer

    def _event(self, code: int, parameter: int) -> None:
        self.send_event(struct.pack("<IHHII", 16, EVENT, code, 0xFFFFFFFF, parameter))

    # ------------------------------------------------------------ operations

    def _operate(self, code: int, parameters: tuple[int, ...]) -> tuple[int, bytes | None]:
        if code == 0x1001:
            return OK, self._device_info()
        if code == 0x1002:
            if self.has_session:
                return ALREADY_OPEN, None
            self.has_session = True
            return OK, None
        if not self.has_session:
            return SESSION_NOT_OPEN, None
        if code == 0x1003:
            self.has_session = False
            return OK, None
        if code in (0x1008, 0x1009, 0x101C) and self.moods.busy > 0:
            self.moods.busy -= 1
            return BUSY, None
        return self._operate_in_session(code, parameters)

    def _operate_in_session(
        self, code: int, parameters: tuple[int, ...]
    ) -> tuple[int, bytes | None]:
        first = parameters[0] if parameters else 0
        if code in (0x1014, 0x1015):
            if first not in self.values:
                return BAD_PROPERTY, None
            return OK, self.values[first] if code == 0x1015 else self._description(first)
        if code in (0x1008, 0x1009, 0x100B):
            if first not in self.objects:
                return BAD_OBJECT, None
            if code == 0x100B:
                del self.objects[first]
                return OK, None
            info = struct.pack("<IHHI", 0x10001, JPEG, 0, len(self.objects[first])) + bytes(60)
            return OK, info if code == 0x1008 else self.objects[first]
        if code == 0x1018:
            self._stops.set()
            return OK, None
        if code == 0x101C:
            return self._begin_bracket(), None
        return NOT_SUPPORTED, None

    def _device_info(self) -> bytes:
        operations = [0x1001, 0x1002, 0x1003, 0x1008, 0x1009, 0x100B, 0x1014, 0x1015, 0x1016]
        return (
            struct.pack("<HIH", 100, 6, 110) + text("") + self.values[0x5002]
            + codes([*operations, 0x1018, 0x101C]) + codes([OBJECT_ADDED, CAPTURE_COMPLETE])
            + codes(list(self.values)) + codes([JPEG]) + codes([JPEG])
            + text("Ricoh Company, Ltd.") + text(self.model) + text(self.firmware)
            + text(self.serial)
        )  # fmt: skip

    def _description(self, code: int) -> bytes:
        """Of what can be set now: only manual exposure lists its values."""
        form = "" if code == BRACKET else PROPERTIES[code][0]
        kind = {"B": 2, "H": 4, "I": 6, "Q": 8, "": 0x400A}[form]
        head = struct.pack("<HHB", code, kind, code not in READ_ONLY_PROPERTIES)
        head += self.values[code] + self.values[code]
        listed = {SHUTTER_SPEED: SHUTTERS, ISO: ISOS}.get(code)
        if listed is None:
            return head + b"\0"
        if self.number(PROGRAM) != MANUAL:
            listed = [0 if code == SHUTTER_SPEED else 0xFFFF]
        return head + struct.pack(f"<BH{len(listed)}{form}", 2, len(listed), *listed)

    def _set(self, code: int, value: bytes) -> int:
        if code not in self.values:
            return BAD_PROPERTY
        if self.number(CAPTURE_STATUS):
            return BUSY
        if code in READ_ONLY_PROPERTIES:
            return READ_ONLY
        if code in self.moods.refuses:
            return BAD_VALUE
        if code == BRACKET and not self._is_bracket(value):
            return BAD_VALUE
        if code != BRACKET and len(value) != len(self.values[code]):
            return 0x201B
        self.values[code] = value
        return OK

    # ------------------------------------------------------------ multi-brackets

    @staticmethod
    def _settings(value: bytes) -> list[tuple[int, int, int]]:
        """Sensitivity, shutter speed and program of each still."""
        count = struct.unpack_from("<I", value)[0] // 2
        return [struct.unpack_from("<hHQHH", value, 4 + 32 * k)[1:3]
                + struct.unpack_from("<hHQHH", value, 4 + 32 * k)[4:5]
                for k in range(count)]  # fmt: skip

    def _is_bracket(self, value: bytes) -> bool:
        units = struct.unpack_from("<I", value)[0]
        if units % 2 or not 4 <= units <= 26 or len(value) != 4 + 16 * units:
            return False
        return value == FIRST_BRACKET or all(
            iso in ISOS and shutter in SHUTTERS and program == MANUAL
            for iso, shutter, program in self._settings(value)
        )

    def _begin_bracket(self) -> int:
        if self.number(CAPTURE_STATUS):
            return BUSY
        if self.number(STILL_CAPTURE_MODE) != MULTI_BRACKET:
            return NOT_SUPPORTED
        self.set_number(CAPTURE_STATUS, 3)
        self.sets += 1
        self._stops.clear()
        threading.Thread(target=self._take_bracket, daemon=True).start()
        return OK

    def _take_bracket(self) -> None:
        for iso, shutter, _ in self._settings(self.values[BRACKET]):
            asked_us = 1e6 * (shutter >> 32) / (shutter & 0xFFFFFFFF)
            if self._stops.wait(asked_us / 1e6 + self.moods.late_s):
                break
            jpeg, exposure_us = self.picture(asked_us)
            still = with_exif(jpeg, exposure_us, iso)
            self.stills += 1
            self.objects[self.stills] = still[: len(still) // 2] if self.moods.cuts else still
            if self.moods.loses > 0:
                self.moods.loses -= 1
            else:
                self._event(OBJECT_ADDED, self.stills)
        time.sleep(0.02)
        self.set_number(CAPTURE_STATUS, 0)
        self._event(CAPTURE_COMPLETE, 0)
