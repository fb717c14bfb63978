"""The microcontroller's messages (proto/mcu.dbc), typed, and the conversation over a carrier.

`Mcu` sends requests and waits for their answers; everything else comes as events. Angles are
degrees, times seconds unless a name says otherwise; unknown is None, never zero.
"""

import enum
import math
import secrets
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

from lightprobe.mcu.link import CAN_BASE, NO_ACKNOWLEDGE, Carrier, McuError, database

PROTOCOL_MAJOR = 1
PROTOCOL_MINOR = 3
RESET_KEY = 0xB007
REPEAT_AFTER_S = 0.1

#: What to do when the firmware refuses a request.
_REFUSALS = {
    "OUT_OF_RANGE": "`lightprobe mcu params` lists the limits; a move must end within 60 s",
    "NOT_HOMED": "`lightprobe mcu home` first",
    "IN_FAULT": "`lightprobe mcu clear`, then `home`",
    "BUSY": "wait until it is done",
    "UNKNOWN_ID": "the firmware is older than this program: `lightprobe mcu flash`",
    "NOT_STORED": "that cell of the EEPROM is worn out; the former parameters stay stored: save "
    "again, and if that fails too, replace the board",
}


class Phase(enum.Enum):
    """What the wheel is doing."""

    UNKNOWN = "UNKNOWN"
    HOMING = "HOMING"
    MOVING = "MOVING"
    SETTLED = "SETTLED"
    FAULT = "FAULT"


@dataclass(frozen=True)
class WheelState:
    """Where the wheel is; `measured_deg` ± `sigma_deg` holds only while SETTLED (or is None)."""

    phase: Phase
    token: int
    servo_on: bool
    commanded_deg: float | None
    measured_deg: float | None
    sigma_deg: float | None
    counter: int


@dataclass(frozen=True)
class WheelTime:
    """When the phase of the WheelState with the same counter began, on the MCU's clock."""

    phase: Phase
    token: int
    t_phase_us: int
    age_ms: int
    counter: int


@dataclass(frozen=True)
class Ring:
    """One ring: nine levels 0…4092 of the supply; t_us is the middle of the averaging window."""

    counter: int
    t_us: int
    levels: tuple[int, ...]
    dead: tuple[bool, ...]
    supply_v: float | None


@dataclass(frozen=True)
class Fault:
    """A fault was latched (`active`) or cleared; docs/users/faults.md explains `detail`."""

    name: str
    active: bool
    detail: int
    t_us: int
    counter: int


@dataclass(frozen=True)
class Message:
    """Any other message: the DBC's name and its signals by name."""

    name: str
    signals: dict[str, int | str]

    def __getitem__(self, signal: str) -> int | str:
        """Return one signal: a name where the DBC has one, else the raw integer."""
        return self.signals[signal]

    def number(self, signal: str) -> int:
        """Return one signal that is a number."""
        return int(self.signals[signal])


Event = WheelState | WheelTime | Ring | Fault | Message


def encode(name: str, **signals: int | str) -> tuple[int, bytes]:
    """Return id and payload of the DBC's message `name`."""
    message = database().get_message_by_name(name)
    return message.frame_id - CAN_BASE, message.encode(signals, strict=True)


def _plain(value: Any) -> int | str:
    return str(value) if hasattr(value, "name") and hasattr(value, "value") else int(value)


def decode(message_id: int, payload: bytes) -> Message:
    """Decode one message by the DBC; the id must be known and the length right."""
    message = database().get_message_by_frame_id(message_id + CAN_BASE)
    signals = cast(dict[str, Any], message.decode(payload))
    return Message(message.name, {key: _plain(value) for key, value in signals.items()})


def _unless(value: int, unknown: int, scale: float = 0.01) -> float | None:
    return None if value == unknown else value * scale


class EventDecoder:
    """Turns messages into events; joins the three frames of a ring."""

    def __init__(self) -> None:
        """Start with no ring begun."""
        self._ring: list[Message] = []
        self.rings_lost = 0
        self._last_ring: int | None = None

    def decode(self, message_id: int, payload: bytes) -> Event | None:
        """Return the event that this message completes, if any."""
        m = decode(message_id, payload)
        if m.name.startswith("Ring"):
            return self._join(m)
        if m.name == "WheelState":
            return WheelState(
                phase=Phase(m["phase"]),
                token=m.number("token"),
                servo_on=bool(m["servo_on"]),
                commanded_deg=_unless(m.number("commanded_cdeg"), -32768),
                measured_deg=_unless(m.number("measured_cdeg"), -32768),
                sigma_deg=_unless(m.number("sigma_cdeg"), 65535),
                counter=m.number("counter"),
            )
        if m.name == "WheelTime":
            times = (m.number(s) for s in ("token", "t_phase_us", "age_ms", "counter"))
            return WheelTime(Phase(m["phase"]), *times)
        if m.name == "Fault":
            detail, t_us, counter = (m.number(s) for s in ("detail", "t_us", "counter"))
            return Fault(str(m["fault"]), bool(m["active"]), detail, t_us, counter)
        return m

    def _join(self, m: Message) -> Ring | None:
        part = int(m.name[-1])
        if part == 0:
            self._ring = []
        if len(self._ring) != part or any(r["counter"] != m["counter"] for r in self._ring):
            self._ring = []
            return None
        self._ring.append(m)
        if part < 2:
            return None
        levels = {k: v for r in self._ring for k, v in r.signals.items() if k.startswith("level_")}
        counter = m.number("counter")
        if self._last_ring is not None:
            self.rings_lost += (counter - self._last_ring - 1) & 0xFF
        self._last_ring = counter
        return Ring(
            counter=counter,
            t_us=self._ring[0].number("t_us"),
            levels=tuple(int(levels[f"level_{k}"]) for k in range(9)),
            dead=tuple(bool(m.number("dead") >> k & 1) for k in range(9)),
            supply_v=_unless(m.number("supply_cv"), 0),
        )


# --- conversation ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Param:
    """One parameter with its limits; `name` is the DBC's."""

    number: int
    name: str
    value: int
    minimum: int
    maximum: int


@dataclass(frozen=True)
class ClockReading:
    """One exchange: the MCU's clock at reception against the host's clock around it."""

    t_rx_us: int
    turnaround_us: int
    sent_ns: int
    received_ns: int


@cache
def param_names() -> dict[int, str]:
    """Map parameter number to name."""
    signal = database().get_message_by_name("ParamValue").get_signal_by_name("param")
    return {int(number): str(name) for number, name in (signal.choices or {}).items()}


@cache
def fault_names() -> dict[int, str]:
    """Map fault number to name."""
    signal = database().get_message_by_name("Fault").get_signal_by_name("fault")
    return {int(number): str(name) for number, name in (signal.choices or {}).items()}


def _answer_to(name: str, signals: dict[str, int | str]) -> Callable[[Message], bool]:
    """Tell an answer other than Result; an older request's late answer is not this one's."""
    if name == "HelloRequest":
        return lambda m: m.name == "Hello"
    if name == "TimeRequest":
        return lambda m: m.name == "TimeReply" and m["count"] == signals["count"]
    if name == "WheelRequest":
        return lambda m: m.name == "WheelReply" and m["count"] == signals["count"]
    if name in ("ParamGet", "ParamSet"):
        number = int(signals["param"])
        named = param_names().get(number, number)
        value = signals.get("value")
        return lambda m: (
            m.name == "ParamValue" and m["param"] == named and value in (None, m["value"])
        )
    return lambda m: False


class Mcu:
    """Requests with answers over a carrier; whatever else arrives goes to `on_event`."""

    def __init__(
        self,
        carrier: Carrier,
        on_event: Callable[[Event], None] | None = None,
        now_ns: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Use `carrier`; takes it over and closes it. `now_ns`, `sleep`: of a simulated time."""
        self.carrier = carrier
        self.now_ns, self.sleep = now_ns, sleep
        self._on_event = on_event
        self._decoder = EventDecoder()
        # At random: a command that carries the former program's token would count as repeated.
        self._token = secrets.randbelow(256)
        self._count = 0

    def events(self, timeout_s: float) -> Iterator[Event]:
        """Yield events until none came for `timeout_s`."""
        while (message := self.carrier.receive(timeout_s)) is not None:
            event = self._decoder.decode(*message)
            if event is not None:
                yield event

    def request(
        self, name: str, timeout_s: float = 1.0, repeat: bool = True, **signals: int | str
    ) -> Message:
        """Send a request and return its answer; repeats it until `timeout_s` is over.

        Tries are counted, not only time: a machine that stops for a while loses one of them.
        Raises McuError when no answer came, or when the answer refuses.
        """
        message_id, payload = encode(name, **signals)
        tries = max(1, math.ceil(timeout_s / REPEAT_AFTER_S)) if repeat else 1
        for left in reversed(range(tries)):
            try:
                self.carrier.send(message_id, payload)
            except OSError as error:  # on I2C: nobody there, or starting
                if not left or error.errno not in NO_ACKNOWLEDGE:
                    raise
                self.sleep(timeout_s / tries)
                continue
            answer = self._await(message_id, _answer_to(name, signals), timeout_s / tries)
            if answer is None:
                continue
            if answer.name == "Result" and answer["result"] != "OK":
                detail = answer["detail"]
                step = _REFUSALS.get(str(answer["result"]), "are both of the same release?")
                raise McuError(f"mcu: {name} refused: {answer['result']} (detail {detail}): {step}")
            return answer
        raise McuError(f"mcu: {name}: no answer in {timeout_s:g} s; is this the right device?")

    def _await(
        self, request_id: int, wanted: Callable[[Message], bool], timeout_s: float
    ) -> Message | None:
        end_ns = self.now_ns() + round(1e9 * timeout_s)
        while (left_ns := end_ns - self.now_ns()) > 0:
            for event in self.events(left_ns / 1e9):
                if isinstance(event, Message):
                    if event.name == "Result" and event["request"] == request_id:
                        return event
                    if wanted(event):
                        return event
                if self._on_event:
                    self._on_event(event)
                if self.now_ns() >= end_ns:
                    break
        return None

    def hello(self, timeout_s: float = 1.0) -> Message:
        """Return Hello; raises McuError when the firmware speaks another major version."""
        hello = self.request(
            "HelloRequest",
            timeout_s,
            protocol_major=PROTOCOL_MAJOR,
            protocol_minor=PROTOCOL_MINOR,
        )
        theirs = hello["protocol_major"]
        if theirs != PROTOCOL_MAJOR:
            which = "older" if int(theirs) < PROTOCOL_MAJOR else "newer"
            raise McuError(
                f"mcu: firmware speaks protocol {theirs}, this program {PROTOCOL_MAJOR}: "
                f"the firmware is {which}; flash the one that belongs to this release"
            )
        return hello

    def rates(self, ring_scans: int = 0, wheel_ms: int = 0, counters_ms: int = 0) -> None:
        """Set how often the MCU reports by itself; 0 = not at all."""
        self.request("Rates", ring_scans=ring_scans, wheel_ms=wheel_ms, counters_ms=counters_ms)

    def _next_token(self) -> int:
        self._token = (self._token + 1) & 0xFF
        return self._token

    def home(self) -> int:
        """Start homing; return the token that its states carry."""
        token = self._next_token()
        self.request("WheelAction", token=token, action="HOME")
        return token

    def release(self) -> None:
        """Let the servo go."""
        self.request("WheelAction", token=self._next_token(), action="RELEASE")

    def pulse(self, pulse_us: float) -> None:
        """Put the servo to a pulse, in microseconds, for the parameter hold_max_ds at most.

        The wheel's angle is unknown then. Raises McuError outside servo_min_us…servo_max_us.
        """
        self.request("WheelPulse", pulse_hus=round(2 * pulse_us))

    def move(self, target_deg: float, slew_deg_s: float = 0, hold_s: float = 0) -> int:
        """Start a move; return its token. 0 for slew or hold means the parameter's value."""
        token = self._next_token()
        self.request(
            "WheelMove",
            token=token,
            target_cdeg=round(target_deg * 100),
            slew_ddeg_s=round(slew_deg_s * 10),
            hold_ds=round(hold_s * 10),
        )
        return token

    def clear_faults(self, faults: int = 0xFFFFFFFF) -> None:
        """Forget latched faults (bit = fault number)."""
        self.request("FaultClear", faults=faults)

    def param(self, number: int, value: int | None = None) -> Param:
        """Read a parameter, or set it to `value`; raises McuError when out of range."""
        if value is None:
            m = self.request("ParamGet", param=number)
        else:
            m = self.request("ParamSet", param=number, value=value)
        value, low, high = (m.number(s) for s in ("value", "minimum", "maximum"))
        return Param(number, str(m["param"]), value, low, high)

    def params(self) -> list[Param]:
        """Read all parameters."""
        count = self.request("ParamGet", param=0).number("count")
        return [self.param(number) for number in range(count)]

    def save_params(self) -> None:
        """Write the parameters to EEPROM; returns when they are there."""
        self.request("ParamAction", timeout_s=5.0, repeat=False, action="SAVE")

    def clock(self) -> ClockReading:
        """Exchange times once; raises McuError when the MCU could not stamp the request."""
        self._count = (self._count + 1) & 0xFF
        sent_ns = self.now_ns()
        m = self.request("TimeRequest", repeat=False, count=self._count)
        received_ns = self.now_ns()
        if not m["stamped"]:
            raise McuError("mcu: TimeRequest: reception was not stamped; ask again")
        t_rx_us, turnaround_us = m.number("t_rx_us"), m.number("turnaround_us")
        return ClockReading(t_rx_us, turnaround_us, sent_ns, received_ns)

    def close(self) -> None:
        """Close the carrier."""
        self.carrier.close()
