"""A conversation with the microcontroller for tools: opened, greeted, and with errors in words."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import can

from lightprobe.errors import LightprobeError
from lightprobe.mcu import faults
from lightprobe.mcu import link as mcu_link
from lightprobe.mcu import messages as mcu
from lightprobe.mcu.link import McuError

ENVIRONMENT = "LIGHTPROBE_MCU"
DEFAULT_PORT = "serial:/dev/ttyUSB0"
#: Opening the port resets an Arduino; its boot loader then waits for a while.
HELLO_S = 4.0
HOMING_S = 12.0
_REPORT_MS = 50

_NEXT_STEPS = {
    errno.ENOENT: "is it plugged in? `lightprobe doctor` lists what is there",
    errno.ENODEV: "is it plugged in? for CAN: ip link set can0 up type can bitrate 500000",
    errno.EACCES: "sudo usermod -aG dialout $USER (I2C: group i2c), then log in again",
    errno.EBUSY: "is lightprobed or another program using it? stop that first",
    errno.EAGAIN: "is lightprobed or another program using it? stop that first",
    errno.EIO: "was it unplugged?",
    **dict.fromkeys(
        mcu_link.NO_ACKNOWLEDGE,
        "no acknowledge: check address, pull-ups, and the strap from A3 to ground",
    ),
    errno.ETIMEDOUT: "the bus hangs: is a device holding SCL or SDA?",
    errno.ENETDOWN: "ip link set can0 up type can bitrate 500000",
    errno.ENOBUFS: "no node acknowledges on CAN: check terminators and bit rate; is the device "
    "powered?",
}


@contextmanager
def words(uri: str, stage: str) -> Iterator[None]:
    """Turn the system's errors into McuError that name device, stage and next step."""
    try:
        yield
    except McuError as error:
        text = str(error)
        if uri not in text:
            text = f"mcu: {uri}: {text.removeprefix('mcu: ')}"
        raise McuError(text) from None
    except LightprobeError:  # a time-out of somebody else's is an OSError, too
        raise
    except OSError as error:
        number = error.errno or 0
        reason = errno_words(number) if number else str(error)
        step = _NEXT_STEPS.get(number, "was it unplugged? is it the right device?")
        raise McuError(f"mcu: {uri}: {stage}: {reason}: {step}") from None
    except can.CanError as error:
        step = "ip link set can0 up type can bitrate 500000; check terminators and bit rate"
        raise McuError(f"mcu: {uri}: {stage}: {error}: {step}") from None


def errno_words(number: int) -> str:
    """What the system calls an error; a lock that another program holds is no temporary matter."""
    return "in use" if number == errno.EAGAIN else os.strerror(number)


class Session(mcu.Mcu):
    """An Mcu that has said hello; events are kept in `wheel`, `faults` and given to a listener."""

    def __init__(self, uri: str, listener: Callable[[mcu.Event], None] | None = None) -> None:
        """Open and greet; raises McuError."""
        self.uri = uri
        self.wheel: mcu.WheelState | None = None
        self.faults: dict[str, mcu.Fault] = {}
        self._listener = listener
        with words(uri, "open"):
            carrier = mcu_link.open_carrier(uri)
        super().__init__(carrier, self.note)
        try:
            with words(uri, "hello"):
                self.greeting = self.hello(HELLO_S)
        except McuError:
            self.close()
            raise

    def note(self, event: mcu.Event) -> None:
        """Remember what an event tells."""
        if isinstance(event, mcu.WheelState):
            self.wheel = event
        elif isinstance(event, mcu.Fault):
            if event.active:
                self.faults[event.name] = event
            else:
                self.faults.pop(event.name, None)
        if self._listener:
            self._listener(event)

    def listen(self, seconds: float) -> Iterator[mcu.Event]:
        """Give events, each noted, for so long."""
        end = time.monotonic() + seconds
        while (left_s := end - time.monotonic()) > 0:
            for event in self.events(min(left_s, 0.1)):
                self.note(event)
                yield event
                if time.monotonic() > end:
                    return

    def status(self) -> dict[str, mcu.Event]:
        """Ask for everything: messages by name, WheelState among them."""
        self.request("StatusRequest", HELLO_S, count=0)
        found: dict[str, mcu.Event] = {}
        for event in self.listen(HELLO_S):
            found[event.name if isinstance(event, mcu.Message) else type(event).__name__] = event
            if "CountersWork" in found:
                return found
        raise McuError(
            f"mcu: {self.uri}: StatusRequest: only part of the answer came: is the cable bad?"
        )

    def settle(self, token: int, patience_s: float) -> mcu.WheelState:
        """Wait until the command with this token has come to rest; McuError on a fault."""
        for event in self.listen(patience_s):
            if not isinstance(event, mcu.WheelState) or event.token != token:
                continue
            if event.phase in (mcu.Phase.SETTLED, mcu.Phase.FAULT, mcu.Phase.UNKNOWN):
                return self.settle_or_raise(event, token)
        raise McuError(f"mcu: {self.uri}: wheel: not settled after {patience_s:g} s: {self._why()}")

    def settle_or_raise(self, state: mcu.WheelState, token: int) -> mcu.WheelState:
        """Give a state that is SETTLED by this command; McuError for any other."""
        if state.phase is mcu.Phase.SETTLED and state.token == token:
            return state
        for _ in self.listen(0.1):  # a fault's name may come after the state
            pass
        raise McuError(f"mcu: {self.uri}: wheel: {state.phase.value}: {self._why()}")

    def _why(self) -> str:
        known = [name for name in self.faults if name.startswith(("WHEEL", "INDEX", "FEEDBACK"))]
        lines = [f"{name}: {faults.words(name)}" for name in known]
        if not lines:
            return "no fault was reported: was it reset or released?"
        return "; ".join(lines) + " (then `lightprobe mcu clear` and `home`)"


@contextmanager
def session(uri: str, listener: Callable[[mcu.Event], None] | None = None) -> Iterator[Session]:
    """Open a conversation as long as the block lasts; whatever goes wrong comes as McuError."""
    opened = Session(uri, listener)
    try:
        with words(uri, "talk"):
            yield opened
    finally:
        opened.close()


def home(link: Session) -> mcu.WheelState:
    """Find the marks; the wheel is at its lowest angle then."""
    link.rates(wheel_ms=_REPORT_MS)
    return link.settle(link.home(), HOMING_S)


def move(
    link: Session, target_deg: float, slew_deg_s: float = 0, hold_s: float = 0
) -> mcu.WheelState:
    """Move and wait until the wheel is there."""
    link.rates(wheel_ms=_REPORT_MS)
    patience_s = HOMING_S + (400 / slew_deg_s if slew_deg_s else 0)
    return link.settle(link.move(target_deg, slew_deg_s, hold_s), patience_s)
