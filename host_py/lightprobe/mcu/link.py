"""How messages travel to and from the microcontroller: proto/mcu.md on serial, I2C and CAN.

`open_carrier` opens what a URI names. What the messages mean: lightprobe.mcu.messages.
"""

import errno
import importlib.resources
import os
import time
from dataclasses import dataclass
from functools import cache
from typing import Protocol, cast

import can
import cantools.database
import serial
from cantools.database.can import Database

from lightprobe.errors import LightprobeError

CAN_BASE = 0x500
BAUD = 500_000
I2C_ADDRESS = 0x2C
#: errno when nobody acknowledges on I2C, by adapter; EREMOTEIO is Linux's alone.
NO_ACKNOWLEDGE = (errno.ENXIO, getattr(errno, "EREMOTEIO", 121))
MAX_PAYLOAD_BYTES = 8
MAX_ENVELOPE_BYTES = MAX_PAYLOAD_BYTES + 4


class McuError(LightprobeError):
    """The microcontroller refused, did not answer, or is not there."""


@cache
def database() -> Database:
    """Load proto/mcu.dbc as it was packed with this package."""
    text = importlib.resources.files("lightprobe_proto").joinpath("mcu.dbc").read_text()
    return cast(Database, cantools.database.load_string(text, "dbc"))


@cache
def lengths() -> dict[int, int]:
    """Map message id to payload length in bytes."""
    return {m.frame_id - CAN_BASE: m.length for m in database().messages}


# --- framing -----------------------------------------------------------------------------------


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF): 0x29B1 for b"123456789"."""
    crc = 0xFFFF
    for byte in data:
        x = (crc >> 8) ^ byte
        x ^= x >> 4
        crc = ((crc << 8) ^ (x << 12) ^ (x << 5) ^ x) & 0xFFFF
    return crc


def pack_envelope(message_id: int, payload: bytes) -> bytes:
    """Wrap a message: id, payload, sum, CRC."""
    body = bytes([message_id]) + payload
    body += bytes([sum(body) & 0xFF])
    return body + crc16(body).to_bytes(2, "little")


def unpack_envelope(data: bytes) -> tuple[int, bytes] | None:
    """Return id and payload; None when CRC, sum, id or length do not fit."""
    if not 4 <= len(data) <= MAX_ENVELOPE_BYTES:
        return None
    if crc16(data[:-2]) != int.from_bytes(data[-2:], "little"):
        return None
    if sum(data[:-3]) & 0xFF != data[-3] or lengths().get(data[0]) != len(data) - 4:
        return None
    return data[0], data[1:-3]


def cobs_encode(data: bytes) -> bytes:
    """COBS without the closing zero, for blocks shorter than 254 bytes."""
    return b"".join(bytes([len(block) + 1]) + block for block in data.split(b"\0"))


def cobs_decode(data: bytes) -> bytes | None:
    """Undo cobs_encode; None when a block overruns or a zero lies within."""
    blocks = []
    at = 0
    while at < len(data):
        end = at + data[at]
        if data[at] == 0 or end > len(data):
            return None
        blocks.append(data[at + 1 : end])
        at = end
    return b"\0".join(blocks)


def serial_frame(message_id: int, payload: bytes) -> bytes:
    """Return the bytes of one message on the serial line, closing zero included."""
    return cobs_encode(pack_envelope(message_id, payload)) + b"\0"


def i2c_mail(message_id: int, payload: bytes) -> bytes:
    """Return the bytes of one message in an I2C write transaction."""
    envelope = pack_envelope(message_id, payload)
    return bytes([len(envelope)]) + envelope


class SerialDecoder:
    """Cuts a byte stream into messages; counts what it had to drop."""

    def __init__(self) -> None:
        """Start with nothing collected."""
        self.good = 0
        self.bad = 0
        self._collected = bytearray()

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Take received bytes; return the messages completed by them, oldest first."""
        messages = []
        *frames, rest = data.split(b"\0")
        for frame in frames:
            self._collect(frame)
            message = self._finish()
            if message:
                messages.append(message)
        self._collect(rest)
        return messages

    def _collect(self, part: bytes) -> None:
        # One byte beyond the longest frame is enough to know that it is too long.
        room = MAX_ENVELOPE_BYTES + 2 - len(self._collected)
        self._collected += part[:room]

    def _finish(self) -> tuple[int, bytes] | None:
        frame, self._collected = bytes(self._collected), bytearray()
        if not frame:
            return None
        envelope = cobs_decode(frame) if len(frame) <= MAX_ENVELOPE_BYTES + 1 else None
        message = unpack_envelope(envelope) if envelope is not None else None
        if message is None:
            self.bad += 1
        else:
            self.good += 1
        return message


# --- carriers ----------------------------------------------------------------------------------


class Carrier(Protocol):
    """Moves messages to and from one microcontroller."""

    def send(self, message_id: int, payload: bytes) -> None:
        """Hand one message to the wire. Raises OSError or McuError when the device is gone."""

    def receive(self, timeout_s: float) -> tuple[int, bytes] | None:
        """Return the next message, or None when none came in time."""

    def close(self) -> None:
        """Give the device back."""


def keep_dtr(descriptor: int, *, keep: bool = True) -> None:
    """Let DTR stay as it is when this serial line is closed; or not, with `keep` False.

    Otherwise it falls, rises at the next opening, and that resets an Arduino: the wheel's angle is
    lost with every command. The line remembers this until it is unplugged.
    """
    import termios  # not on Windows

    settings = termios.tcgetattr(descriptor)
    settings[2] = settings[2] & ~termios.HUPCL if keep else settings[2] | termios.HUPCL
    termios.tcsetattr(descriptor, termios.TCSANOW, settings)


@dataclass(frozen=True)
class CanFrame:
    """A frame as it is on the CAN bus, ours or not."""

    identifier: int
    data: bytes
    extended: bool = False
    remote: bool = False


#: What goes onto the wire without being a message: bytes, or one frame of CAN.
Raw = bytes | CanFrame


class RawCarrier(Carrier, Protocol):
    """A carrier that says what it is, and on which broken messages can be sent, too."""

    @property
    def kind(self) -> str:
        """Name that the DBC's Capabilities.carrier has for it."""

    @property
    def bad(self) -> int:
        """How many broken messages it has received."""

    def send_raw(self, raw: Raw) -> None:
        """Put this onto the wire as it is; OSError when a slave does not acknowledge it."""


class SerialCarrier:
    """COBS frames on a serial port or pty, for this program alone (flock)."""

    kind = "SERIAL"

    def __init__(self, device: str, baud: int = BAUD) -> None:
        """Open `device`; raises serial.SerialException (an OSError) when that fails."""
        self._port = serial.Serial(device, baud, timeout=0, exclusive=True)
        if os.name == "posix":
            keep_dtr(self._port.fileno())
        self.decoder = SerialDecoder()
        self._ready: list[tuple[int, bytes]] = []
        self._port.write(b"\0")  # end whatever half frame a former user left

    def send(self, message_id: int, payload: bytes) -> None:
        """Write one frame."""
        self.send_raw(serial_frame(message_id, payload))

    @property
    def bad(self) -> int:
        """How many broken frames have come."""
        return self.decoder.bad

    def send_raw(self, raw: Raw) -> None:
        """Write bytes as they are."""
        assert isinstance(raw, bytes)
        self._port.write(raw)

    def receive(self, timeout_s: float) -> tuple[int, bytes] | None:
        """Return the next message, or None when none came in time."""
        end = time.monotonic() + timeout_s
        while not self._ready:
            left = end - time.monotonic()
            self._port.timeout = max(0.0, min(left, 0.05))
            data = self._port.read(max(1, self._port.in_waiting))
            self._ready += self.decoder.feed(data)
            if not self._ready and left <= 0:
                return None
        return self._ready.pop(0)

    def close(self) -> None:
        """Close the port."""
        self._port.close()


class I2cBus(Protocol):
    """What I2cCarrier needs of a bus master; errors are OSError (a missing acknowledge too)."""

    def write(self, address: int, data: bytes) -> None:
        """Write one transaction."""

    def read(self, address: int, count: int) -> bytes:
        """Read one transaction of `count` bytes."""

    def close(self) -> None:
        """Give the bus back."""


class LinuxI2cBus:
    """A /dev/i2c-N through smbus2's I2C_RDWR."""

    def __init__(self, device: str) -> None:
        """Open `device`, for instance /dev/i2c-1."""
        from smbus2 import SMBus, i2c_msg  # only Linux has what it imports

        self._bus, self._message = SMBus(device), i2c_msg

    def write(self, address: int, data: bytes) -> None:
        """Write one transaction."""
        self._bus.i2c_rdwr(self._message.write(address, data))

    def read(self, address: int, count: int) -> bytes:
        """Read one transaction of `count` bytes."""
        message = self._message.read(address, count)
        self._bus.i2c_rdwr(message)
        return bytes(message)

    def close(self) -> None:
        """Close the device."""
        self._bus.close()


class I2cCarrier:
    """The mailbox of mcu.md; polls it, since a slave cannot speak first."""

    kind = "I2C"
    POLL_S = 0.002

    def __init__(self, bus: I2cBus, address: int = I2C_ADDRESS) -> None:
        """Use `bus`; takes it over and closes it."""
        self._bus = bus
        self._address = address
        self.bad = 0

    def send(self, message_id: int, payload: bytes) -> None:
        """Write one message into the mailbox."""
        self.send_raw(i2c_mail(message_id, payload))

    def send_raw(self, raw: Raw) -> None:
        """Write bytes as they are, in one transaction."""
        assert isinstance(raw, bytes)
        self._bus.write(self._address, raw)

    def receive(self, timeout_s: float) -> tuple[int, bytes] | None:
        """Read the mailbox until a message is there or the time is over."""
        end = time.monotonic() + timeout_s
        while True:
            mail = self._bus.read(self._address, MAX_ENVELOPE_BYTES + 1)
            if 4 <= mail[0] <= MAX_ENVELOPE_BYTES:
                message = unpack_envelope(mail[1 : 1 + mail[0]])
                if message is not None:
                    return message
                self.bad += 1
            elif mail[0] != 0:
                self.bad += 1
            if time.monotonic() >= end:
                return None
            time.sleep(self.POLL_S)

    def close(self) -> None:
        """Close the bus."""
        self._bus.close()


class CanCarrier:
    """Frames as they are, on any bus that python-can knows."""

    kind = "CAN"

    def __init__(self, bus: can.BusABC) -> None:
        """Use `bus`; takes it over and shuts it down."""
        self._bus = bus
        self.bad = 0

    def send(self, message_id: int, payload: bytes) -> None:
        """Send one frame; raises can.CanError when the bus refuses it."""
        self.send_raw(CanFrame(CAN_BASE + message_id, payload))

    def send_raw(self, raw: Raw) -> None:
        """Send any frame."""
        assert isinstance(raw, CanFrame)
        frame = can.Message(
            arbitration_id=raw.identifier, data=raw.data, is_extended_id=raw.extended,
            is_remote_frame=raw.remote,
        )  # fmt: skip
        self._bus.send(frame)

    def receive(self, timeout_s: float) -> tuple[int, bytes] | None:
        """Return the next message of ours, or None when none came in time."""
        end = time.monotonic() + timeout_s
        while True:
            frame = self._bus.recv(max(0.0, end - time.monotonic()))
            if frame is None:
                return None
            message_id = frame.arbitration_id - CAN_BASE
            odd = frame.is_extended_id or frame.is_remote_frame or frame.is_error_frame
            if odd or message_id not in lengths():
                continue
            if lengths()[message_id] == len(frame.data):
                return message_id, bytes(frame.data)
            self.bad += 1

    def close(self) -> None:
        """Shut the bus down."""
        self._bus.shutdown()


def open_carrier(uri: str) -> RawCarrier:
    """Open serial:DEVICE[?baud=N], i2c:DEVICE[?address=0x2c] or can:CHANNEL (SocketCAN).

    The daemon's way of writing it, with `mcu:` before, means the same. Raises McuError for what
    makes no sense, OSError or can.CanError when the device cannot be opened.
    """
    place, _, query = uri.removeprefix("mcu:").partition("?")
    scheme, _, device = place.partition(":")
    options = {"serial": "baud", "i2c": "address", "can": None}
    if scheme not in options or not device:
        raise McuError(f"mcu: {uri}: unknown carrier; use serial:DEVICE, i2c:DEVICE or can:CHANNEL")
    number = _option(uri, query, options[scheme])
    if scheme == "serial":
        return SerialCarrier(device, BAUD if number is None else number)
    if scheme == "i2c":
        return I2cCarrier(LinuxI2cBus(device), I2C_ADDRESS if number is None else number)
    return CanCarrier(can.Bus(channel=device, interface="socketcan"))


def _option(uri: str, query: str, known: str | None) -> int | None:
    """Value of the one option that a carrier knows; McuError for any other."""
    if not query:
        return None
    key, _, text = query.partition("=")
    try:
        if key != known:
            raise ValueError(key)
        return int(text, 0)
    except ValueError:
        wanted = f"{known}=NUMBER" if known else "no option"
        raise McuError(f"mcu: {uri}: {query}: expected {wanted}") from None
