"""What the LED shows: one table, in the order in which states count, and a player of patterns."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class State(StrEnum):
    """How the probe is."""

    STOPPING = "stopping"
    PAIRING = "pairing"
    FAULT = "fault"
    STARTING = "starting"
    ACCESS_POINT = "access-point"
    NO_NETWORK = "no-network"
    WAITING = "waiting"
    MEASURING = "measuring"


@dataclass(frozen=True)
class Pattern:
    """Seconds lit, dark, lit, dark, …; then again from the beginning."""

    steps: tuple[float, ...]
    looks: str  # in words

    @property
    def cycle_s(self) -> float:
        """Seconds until it begins again."""
        return sum(self.steps)

    def at(self, phase_s: float) -> tuple[bool, float]:
        """Whether it is lit, and for how many seconds more, so long after its beginning."""
        left_s = phase_s % self.cycle_s
        for index, step_s in enumerate(self.steps):
            if left_s < step_s:
                return index % 2 == 0, step_s - left_s
            left_s -= step_s
        return True, self.steps[0]  # rounding: the cycle has just ended


@dataclass(frozen=True)
class Meaning:
    """What a state looks like, what it means, and what to do."""

    pattern: Pattern
    means: str
    next_step: str


def _flashes(count: int, word: str) -> Pattern:
    return Pattern((0.2, 0.3) * (count - 1) + (0.2, 1.5), f"{word} flashes, a pause")


LIT = Pattern((1.0, 0.0), "lit")
DARK = Pattern((0.0, 1.0), "dark")
SLOW = Pattern((0.5, 0.5), "slow even blinking")
FAST = Pattern((0.1, 0.1), "fast blinking")

#: The first that holds is shown.
STATES: dict[State, Meaning] = {
    State.STOPPING: Meaning(LIT, "it shuts down", "wait until it is dark, and ten seconds more"),
    State.PAIRING: Meaning(
        Pattern((1.5, 0.2), "lit, with short breaks"),
        "the next client that asks gets the address",
        "open `https://probe.local:7704` on the phone",
    ),
    State.FAULT: Meaning(FAST, "something is wrong", "`lightprobe doctor` says what"),
    State.STARTING: Meaning(SLOW, "it starts", "wait: after a minute it is a fault"),
    State.ACCESS_POINT: Meaning(
        _flashes(4, "four"), "it is an access point itself", "join its network"
    ),
    State.NO_NETWORK: Meaning(
        _flashes(3, "three"), "it has no network", "check the cable, or make it an access point"
    ),
    State.WAITING: Meaning(
        _flashes(2, "two"), "no camera, no picture, or a black one", "camera, its cable, lens cap"
    ),
    State.MEASURING: Meaning(
        Pattern((0.1, 2.9), "one short flash every 3 s"), "all is well", "–"
    ),
}  # fmt: skip


class Player:
    """Shows one pattern after the other, each to the end of its cycle: so it can be counted."""

    def __init__(self, pattern: Pattern, now_s: float) -> None:
        """Begin with this one."""
        self._pattern, self._began_s = pattern, now_s
        self._next: Pattern | None = None

    def show(self, pattern: Pattern, now_s: float, at_once: bool = False) -> None:
        """Change to this one: at the end of the present cycle, or at once."""
        if pattern == self._pattern and not (at_once and self._next):
            self._next = None
        elif at_once:
            self._pattern, self._began_s, self._next = pattern, now_s, None
        else:
            self._forward(now_s)
            self._next = pattern if pattern != self._pattern else None

    def level(self, now_s: float) -> tuple[bool, float]:
        """Whether the LED is lit now, and the seconds until this may change."""
        self._forward(now_s)
        return self._pattern.at(now_s - self._began_s)

    def _forward(self, now_s: float) -> None:
        cycle_s = self._pattern.cycle_s
        cycles = int((now_s - self._began_s + 1e-9) / cycle_s)
        if cycles <= 0:
            return
        if self._next is None:
            self._began_s += cycles * cycle_s
        else:  # it was to begin at the end of the cycle that has ended first
            self._pattern, self._next = self._next, None
            self._began_s += cycle_s
            self._forward(now_s)
