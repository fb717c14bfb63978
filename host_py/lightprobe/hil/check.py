"""What a check of the box is: data, and a small function that measures."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from lightprobe.mcu import faults

if TYPE_CHECKING:
    from lightprobe.hil.bench import Bench


class Group(enum.Enum):
    """What a check does to the box, and so which option asks for it."""

    READ = "read"  # only asks; always
    MOVES = "moves"  # turns the wheel and changes a parameter; --moves
    COVER = "cover"  # the user covers sensors; --cover


class Verdict(enum.Enum):
    """What a check came to."""

    PASS = "pass"
    FAIL = "fail"
    SKIPPED = "skipped"


@dataclass(frozen=True)
class Source:
    """Where a bound is written: a file of the project, and words that stand in it."""

    file: str
    words: str


@dataclass(frozen=True)
class Finding:
    """What one check measured."""

    verdict: Verdict
    measured: str  # with units; the reason, where the check was skipped
    next_step: str = ""  # what to look at next, where it failed
    numbers: dict[str, float] = field(default_factory=dict)


def judged(passed: bool, measured: str, next_step: str, **numbers: float) -> Finding:
    """Give a finding that passed or failed; the next step stays away where it passed."""
    verdict = Verdict.PASS if passed else Verdict.FAIL
    return Finding(verdict, measured, "" if passed else next_step, numbers)


def skipped(reason: str) -> Finding:
    """Give a finding that tells why nothing was measured."""
    return Finding(Verdict.SKIPPED, reason)


@dataclass(frozen=True)
class Check:
    """One question to the box."""

    name: str
    asks: str
    bound: str
    source: Source
    measure: Callable[[Bench], Finding]
    group: Group = Group.READ
    needs: tuple[str, ...] = ()  # checks without which this one has no meaning
    #: Faults of the firmware that this check judges, whichever check meets them.
    faults: tuple[str, ...] = ()


class CannotTellError(Exception):
    """The box is as it should be, but this cannot be measured here."""


class FaultError(Exception):
    """The firmware stopped a command by a fault: the check that owns it fails."""

    def __init__(self, name: str, detail: int = 0) -> None:
        """`name`: as in the DBC."""
        super().__init__(name)
        self.name, self.detail = name, detail

    def finding(self) -> Finding:
        """Give what the owner of the fault says."""
        measured = f"the firmware reports {self.name} (detail {self.detail})"
        return Finding(Verdict.FAIL, measured, faults.words(self.name))


class RestartError(Exception):
    """The microcontroller has started again while a check ran."""

    def __init__(self, cause: str) -> None:
        """`cause`: Hello's reset_cause."""
        super().__init__(cause)
        self.cause = cause
