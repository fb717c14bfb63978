"""Answers to the questions of `lightprobe check-camera`, and the verdict of them all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

#: Questions without whose answers nobody knows whether a camera is fit.
ESSENTIAL = ("exposure", "tone mapping", "response")


class Outcome(StrEnum):
    """What was found out about one question."""

    FINE = "fine"
    DEFECT = "defect"  # something that the daemon can live with, once it is told or known
    UNFIT = "unfit"  # the light of this camera is wrong, and nothing makes it right
    UNKNOWN = "cannot tell"
    SKIPPED = "skipped"


@dataclass(frozen=True)
class Answer:
    """One question, what was found, and what to do about it.

    `words`: of a defect, what it is, as a noun; else a part of a sentence.
    """

    question: str
    outcome: Outcome
    words: str
    next_step: str = ""
    numbers: dict[str, float] = field(default_factory=dict)

    @property
    def is_found(self) -> bool:
        """Tell whether it names a defect."""
        return self.outcome in (Outcome.DEFECT, Outcome.UNFIT)


@dataclass(frozen=True)
class Verdict:
    """All answers, in the order in which they were asked."""

    source: str
    answers: tuple[Answer, ...]

    def of(self, outcome: Outcome) -> list[Answer]:
        """Answers with this outcome."""
        return [one for one in self.answers if one.outcome is outcome]

    @property
    def defects(self) -> tuple[str, ...]:
        """Questions whose answers name a defect."""
        return tuple(one.question for one in self.answers if one.is_found)

    @property
    def words(self) -> str:
        """The verdict in a line."""
        unfit, defects = self.of(Outcome.UNFIT), self.of(Outcome.DEFECT)
        unknown = self.of(Outcome.UNKNOWN)
        asked = len(self.answers) - len(self.of(Outcome.SKIPPED))
        if unfit:
            return f"unfit because of {_joined(one.words for one in unfit)}"
        if not asked or any(one.question in ESSENTIAL for one in unknown):
            also = f"; it has {_joined(one.words for one in defects)}" if defects else ""
            return f"cannot tell whether it is fit{also}"
        told = f"fit with {_joined(one.words for one in defects)}" if defects else "fit"
        if unknown:
            told += f"; cannot tell: {', '.join(one.question for one in unknown)}"
        return told

    @property
    def status(self) -> int:
        """Exit status: 0 fit, 1 unfit, 3 something could not be told."""
        if self.of(Outcome.UNFIT):
            return 1
        asked = [one for one in self.answers if one.outcome is not Outcome.SKIPPED]
        return 3 if not asked or self.of(Outcome.UNKNOWN) else 0

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "source": self.source,
            "verdict": self.words,
            "defects": list(self.defects),
            "answers": [asdict(one) for one in self.answers],
        }


def _joined(parts: Iterable[str]) -> str:
    return ", and ".join(parts)


def cannot_tell(questions: Sequence[str], why: str, next_step: str = "") -> list[Answer]:
    """Give the same reason for several questions."""
    return [Answer(one, Outcome.UNKNOWN, f"because {why}", next_step) for one in questions]
