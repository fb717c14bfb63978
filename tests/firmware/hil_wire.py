"""The firmware in lock-step as a wire of `lightprobe.hil`: its time passes while the host waits.

What a wire does wrong is a function that stands between the firmware and the host.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable

from lightprobe.hil.bench import Bench
from lightprobe.hil.box import Box
from lightprobe.hil.check import Verdict
from lightprobe.hil.run import choose, run
from lightprobe.mcu import link as mcu_link
from lightprobe.mcu import messages as mcu
from lightprobe.mcu.link import CanFrame, Raw
from rig import Rig

STEP_US = 500
Message = tuple[int, bytes]


class RigWire:
    """A chip of tests/firmware/rig.py on its carrier, and what goes wrong on the way."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.kind = rig.carrier.upper()
        self.bad = 0
        self.seats = list(range(9))  # which sensor lies under which place
        self.noise = 0.0  # share of the serial line's bytes that are changed, both ways
        self.lost = 0.0  # share of the box's messages that never come
        self.late_us = 0  # so much later comes every message
        self.drift = 0.0  # the host's clock runs slower by this share
        self.change: Callable[[Message], Message | None] = lambda message: message
        self.repair: Callable[[Raw], Raw | None] = lambda raw: raw  # on the way to the box
        self.meanwhile: Callable[[int], None] = lambda us: None  # with the box's time
        self._rng = random.Random(7)
        self._decoder = mcu_link.SerialDecoder()
        self._coming: deque[tuple[int, Message]] = deque()

    def now_us(self) -> int:
        """The box's time."""
        return int(self.rig.command("time"))

    def now_ns(self) -> int:
        """The host's clock."""
        return round(1000 * self.now_us() * (1 - self.drift))

    def send(self, message_id: int, payload: bytes) -> None:
        """As Carrier says."""
        if self.kind == "SERIAL":
            self.send_raw(mcu_link.serial_frame(message_id, payload))
        elif self.kind == "I2C":
            self.send_raw(mcu_link.i2c_mail(message_id, payload))
        else:
            self.send_raw(CanFrame(mcu_link.CAN_BASE + message_id, payload))

    def send_raw(self, raw: Raw) -> None:
        """As RawCarrier says."""
        repaired = self.repair(raw)
        if repaired is None:
            return
        if isinstance(repaired, CanFrame):
            kind = "ext" if repaired.extended else "rtr" if repaired.remote else ""
            data = repaired.data.hex() or "-"
            self.rig.command(f"can send {repaired.identifier:x} {data} {kind}")
        elif self.kind == "I2C":
            if self.rig.write_mail(repaired) < len(repaired):
                raise OSError(mcu_link.NO_ACKNOWLEDGE[0], "no acknowledge")
        else:
            self.rig.send_bytes(self._damaged(repaired))

    def receive(self, timeout_s: float) -> Message | None:
        """As Carrier says; time goes on in steps until something has come."""
        end_us = self.now_us() + max(0, round(1e6 * timeout_s / (1 - self.drift)))
        while True:
            now_us = self.now_us()
            if self._coming and self._coming[0][0] <= now_us:
                return self._coming.popleft()[1]
            if now_us >= end_us:
                return None
            self.meanwhile(now_us)
            self.rig.command(f"run {min(STEP_US, end_us - now_us)}")
            self._take()

    def sleep(self, seconds: float) -> None:
        """The host's sleep: time goes on."""
        self.rig.command(f"run {round(1e6 * seconds)}")

    def close(self) -> None:
        """The rig is the test's."""

    def _damaged(self, data: bytes) -> bytes:
        if not self.noise:
            return data
        rng = self._rng
        return bytes(b ^ rng.randrange(1, 256) if rng.random() < self.noise else b for b in data)

    def _take(self) -> None:
        for t_us, message in self._arrived():
            changed = self.change(message)
            if changed is not None and self._rng.random() >= self.lost:
                self._coming.append((t_us + self.late_us, changed))

    def _arrived(self) -> list[tuple[int, Message]]:
        if self.kind == "SERIAL":
            found = []
            for t_us, _, _, text in self.rig._lines("frames"):
                frame = self._damaged(bytes.fromhex(text))
                found += [(t_us, message) for message in self._decoder.feed(frame)]
            self.bad = self._decoder.bad
            return found
        try:
            taken = list(self.rig._can_frames() if self.kind == "CAN" else self.rig._mails())
        except AssertionError:  # in the boot loader nobody acknowledges
            raise OSError(mcu_link.NO_ACKNOWLEDGE[0], "no acknowledge") from None
        return [(t_us, message) for t_us, _, _, message in taken if message is not None]


def greeted(wire: RigWire) -> Box:
    """A box that has said hello over this wire."""
    wire.rig.command("run 30000")
    return Box(f"rig:{wire.kind.lower()}", wire, wire.now_ns, wire.sleep)


def passes(rig: Rig, *names: str, seconds: float = 2.0) -> None:
    """Let these checks of `lightprobe hil` judge a chip; AssertionError with what they found."""
    bench = Bench(greeted(RigWire(rig)), seconds)
    findings = run(bench, choose((), names), lambda check, finding: None)
    assert set(names) == set(findings)
    wrong = {name: one for name, one in findings.items() if one.verdict is not Verdict.PASS}
    assert not wrong


def replaced(name: str, **signals: int | str) -> Callable[[Message], Message]:
    """Give a change of the wire: one kind of message comes with other signals."""

    def change(message: Message) -> Message:
        found = mcu.decode(*message)
        return mcu.encode(name, **(found.signals | signals)) if found.name == name else message

    return change
