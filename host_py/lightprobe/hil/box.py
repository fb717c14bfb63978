"""A conversation with a box that may be broken: it notes what goes wrong instead of stopping."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress

from lightprobe.hil.check import FaultError, RestartError
from lightprobe.mcu import messages as mcu
from lightprobe.mcu.link import NO_ACKNOWLEDGE, McuError, RawCarrier, open_carrier
from lightprobe.mcu.session import HELLO_S, words

_STATUS = (
    "Result", "FaultState", "Capabilities", "WheelServo", "WheelState", "WheelTime",
    "CountersLink", "CountersWork",
)  # fmt: skip
_STATUS_S = 0.3
_TRIES = 5
_PAUSE_S = 0.005


class Box(mcu.Mcu):
    """One box. Whatever it says is noted; a start that nobody asked for ends what is going on."""

    def __init__(
        self,
        uri: str,
        carrier: RawCarrier,
        now_ns: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Greet the box on this carrier; McuError when nobody answers."""
        super().__init__(carrier, self._note, now_ns, sleep)
        self.uri = uri
        self.wire = carrier
        self.wheel: mcu.WheelState | None = None
        self.active: dict[str, mcu.Fault] = {}  # faults by name
        self.greeting: mcu.Message | None = None
        self.starts: list[str] = []  # causes of those that nobody asked for
        self.greeting = self._greet()
        self.quiet()

    def quiet(self) -> None:
        """Let it send nothing unasked: a box that has just started says Hello once a second."""
        with suppress(McuError):
            self.rates()

    def _greet(self) -> mcu.Message:
        """Opening the line may reset the box; its first words count when it says them twice."""
        hello = self._hello(HELLO_S)
        for _ in self.listen(0.3):
            pass
        again = self._hello(HELLO_S)
        return again if again["boot_count"] != hello["boot_count"] else hello

    def _hello(self, timeout_s: float) -> mcu.Message:
        return self.request(
            "HelloRequest", timeout_s, protocol_major=mcu.PROTOCOL_MAJOR,
            protocol_minor=mcu.PROTOCOL_MINOR,
        )  # fmt: skip

    @property
    def rings_lost(self) -> int:
        """Rings that the numbers of those received show to be missing, since the start."""
        return self._decoder.rings_lost

    def answers(self) -> bool:
        """Tell whether it still says anything, or does again after a boot loader's time."""
        end_ns = self.now_ns() + round(1e9 * HELLO_S)
        while self.now_ns() < end_ns:
            try:
                self._hello(1.0)
            except McuError:
                pass
            except OSError as error:
                if error.errno not in NO_ACKNOWLEDGE:
                    raise
                self.sleep(0.01)  # on I2C nobody is there while it starts
            else:
                return True
        return False

    def events(self, timeout_s: float) -> Iterator[mcu.Event]:
        """Yield events; RestartError when one shows that the box has started again."""
        for event in super().events(timeout_s):
            self._note(event)
            yield event

    def _note(self, event: mcu.Event) -> None:
        if isinstance(event, mcu.WheelState):
            self.wheel = event
        elif isinstance(event, mcu.Fault):
            if event.active:
                self.active[event.name] = event
            else:
                self.active.pop(event.name, None)
        elif isinstance(event, mcu.Message) and event.name == "Hello":
            self._note_hello(event)

    def _note_hello(self, hello: mcu.Message) -> None:
        if self.greeting is None or hello["boot_count"] == self.greeting["boot_count"]:
            return
        self.greeting = hello
        self.active.clear()
        self.starts.append(str(hello["reset_cause"]))
        raise RestartError(self.starts[-1])

    def listen(self, seconds: float) -> Iterator[mcu.Event]:
        """Give events for so long."""
        end_ns = self.now_ns() + round(1e9 * seconds)
        while (left_ns := end_ns - self.now_ns()) > 0:
            for event in self.events(left_ns / 1e9):
                yield event
                if self.now_ns() >= end_ns:
                    return

    def send(self, name: str, **signals: int | str) -> None:
        """Send one message, and do not wait for what it says."""
        self.put(*mcu.encode(name, **signals))

    def put(self, message_id: int, payload: bytes) -> None:
        """Send one message, known or not; again where a slave had no room for it as yet."""
        for left in reversed(range(_TRIES)):
            try:
                self.carrier.send(message_id, payload)
            except OSError as error:
                if not left or error.errno not in NO_ACKNOWLEDGE:
                    raise
                self.sleep(_PAUSE_S)
            else:
                return

    def status(self) -> dict[str, mcu.Event]:
        """Ask for everything: the messages by name; McuError when parts stay away."""
        found: dict[str, mcu.Event] = {}
        for _ in range(_TRIES):
            self.send("StatusRequest", count=0)
            for event in self.listen(_STATUS_S):
                name = event.name if isinstance(event, mcu.Message) else type(event).__name__
                found[name] = event
                if name == _STATUS[-1] and set(_STATUS) <= set(found):
                    return found
        missing = [name for name in _STATUS if name not in found]
        raise McuError(f"mcu: {self.uri}: StatusRequest: no answer in full: without {missing}")

    def message(self, name: str) -> mcu.Message:
        """Ask for everything and give one message of it."""
        event = self.status()[name]
        assert isinstance(event, mcu.Message)
        return event

    def latched(self) -> list[str]:
        """Names of all faults that are latched."""
        names, bits = mcu.fault_names(), self.message("FaultState").number("latched")
        return [names.get(k, f"fault {k}") for k in range(32) if bits >> k & 1]

    def settle(self, token: int, patience_s: float) -> list[mcu.Event]:
        """Wait until a command has come to rest; give what came on the way. FaultError if not."""
        seen: list[mcu.Event] = []
        for event in self.listen(patience_s):
            seen.append(event)
            if not isinstance(event, mcu.WheelTime) or event.token != token:
                continue
            if event.phase is mcu.Phase.SETTLED:
                return seen
            if event.phase is mcu.Phase.FAULT:
                self.raise_fault()
        self.raise_fault()
        raise McuError(f"mcu: {self.uri}: the wheel has not settled within {patience_s:g} s")

    def raise_fault(self) -> None:
        """Raise FaultError where a fault has stopped the wheel."""
        for _ in self.listen(0.1):  # its name may come after the state
            pass
        for name in self.latched():
            if name.startswith(("WHEEL", "INDEX", "FEEDBACK", "SUPPLY")):
                fault = self.active.get(name)
                raise FaultError(name, fault.detail if fault else 0)


def open_box(uri: str) -> Box:
    """Open and greet the box that a URI names; McuError in words."""
    with words(uri, "open"):
        carrier = open_carrier(uri)
    try:
        with words(uri, "hello"):
            return Box(uri, carrier)
    except BaseException:
        carrier.close()
        raise
