"""Answers files that the page writes: read, checked against the study, and whose are left out."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from lightprobe.errors import LightprobeError
from lightprobe.study.trials import HIGHEST, VERSION, Study, Trial

#: Largest answers file, in bytes.
_MOST_BYTES = 8 << 20
_MOST_MS = 1e9


@dataclass(frozen=True)
class Answer:
    """What a participant said in one trial."""

    trial: Trial
    value: int  # the rating; of a choice, 0: the trial's first picture, 1: its second
    swapped: bool  # of a choice: the second picture was left or on top
    ms: float

    @property
    def caught(self) -> bool:
        """Whether this is a catch trial, answered wrongly."""
        if self.trial.role != "catch":
            return False
        if self.trial.kind == "rating":
            return self.value != self.trial.right
        return self.trial.pictures[self.value] != self.trial.right

    @property
    def first_place(self) -> bool:
        """Whether what is left or on top was chosen."""
        return (self.value == 0) != self.swapped


@dataclass(frozen=True)
class Participant:
    """One person, or one that was made up."""

    file: Path
    id: str
    simulated: bool
    answers: tuple[Answer, ...]

    def missed(self) -> int:
        """Count the catch trials answered wrongly."""
        return sum(one.caught for one in self.answers)

    def median_s(self) -> float:
        """Give the median time of an answer."""
        return median(one.ms for one in self.answers) / 1e3


@dataclass(frozen=True)
class LeftOut:
    """Whose answers do not count, and why."""

    participant: Participant
    reason: str


def load(study: Study, files: Sequence[Path]) -> list[Participant]:
    """Read answers files of a study.

    Raises LightprobeError for a file that is broken, of another study or incomplete, for a
    participant who is there twice, and for people and simulated ones together.
    """
    found: list[Participant] = []
    for file in files:
        one = _read(study, file)
        for other in found:
            if other.id == one.id:
                raise LightprobeError(
                    f"study: {file}: of participant {one.id}, as is {other.file}: give one of them"
                )
            if other.simulated != one.simulated:
                made_up, person = (one, other) if one.simulated else (other, one)
                raise LightprobeError(
                    f"study: {made_up.file}: simulated, and {person.file} is of a person: analyse "
                    "them apart"
                )
        found.append(one)
    if not found:
        raise LightprobeError("study: no answers file: name those that participants sent")
    return found


def sort_out(
    study: Study, participants: Sequence[Participant]
) -> tuple[list[Participant], list[LeftOut]]:
    """Apply the rules of the study file; gives who stays, and who is left out."""
    rules, staying, left_out = study.exclude, [], []
    for one in participants:
        reasons = []
        if one.missed() > rules.missed:
            catches = sum(answer.trial.role == "catch" for answer in one.answers)
            reasons.append(
                f"missed {one.missed()} of {catches} catch trials (most: {rules.missed})"
            )
        if one.median_s() < rules.fastest_s:
            reasons.append(
                f"median answer after {one.median_s():.2f} s (least: {rules.fastest_s:g} s)"
            )
        if reasons:
            left_out.append(LeftOut(one, ", ".join(reasons)))
        else:
            staying.append(one)
    return staying, left_out


def _read(study: Study, file: Path) -> Participant:
    try:
        if file.stat().st_size > _MOST_BYTES:
            raise LightprobeError(f"study: {file}: too large for an answers file: name another")
        table = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise LightprobeError(f"study: {file}: {error.strerror}: name an answers file") from None
    except (ValueError, RecursionError) as error:
        raise LightprobeError(
            f"study: {file}: broken JSON ({error}): ask the participant for the file once more"
        ) from None
    _check_head(study, file, table)
    answers = table.get("answers")
    if not isinstance(answers, list):
        raise _broken(file, "it has no list of answers")
    trials = {one.id: one for one in study.trials}
    read = tuple(_answer(file, k, row, trials) for k, row in enumerate(answers, 1))
    twice = [key for key, count in Counter(one.trial.id for one in read).items() if count > 1]
    if twice:
        raise _broken(file, f"trial {twice[0]} is answered twice")
    if len(read) < len(trials):
        raise LightprobeError(
            f"study: {file}: {len(read)} of {len(trials)} trials answered: leave it out, or let "
            "the participant finish"
        )
    return Participant(file, table["participant"], table["simulated"], read)


def _check_head(study: Study, file: Path, table: Any) -> None:
    if not isinstance(table, dict) or table.get("kind") != "lightprobe study answers":
        raise LightprobeError(f"study: {file}: not an answers file: name what the page downloaded")
    if table.get("version") != VERSION:
        raise LightprobeError(
            f"study: {file}: version {table.get('version')}, and this lightprobe reads {VERSION}: "
            "use the lightprobe that made the page"
        )
    if table.get("study") != study.hash:
        raise LightprobeError(
            f"study: {file}: answers of another study, or of another version of this one: name "
            "the study file of its page"
        )
    who = table.get("participant")
    if not isinstance(who, str) or not who or len(who) > 100 or not who.isprintable():
        raise _broken(file, "participant: expected a short text")
    if not isinstance(table.get("simulated"), bool):
        raise _broken(file, "simulated: expected true or false")


def _answer(file: Path, number: int, row: Any, trials: dict[str, Trial]) -> Answer:
    if not isinstance(row, dict) or not isinstance(row.get("trial"), str):
        raise _broken(file, f"answer {number} names no trial")
    trial = trials.get(row["trial"])
    if trial is None:
        raise _broken(file, f"answer {number} is to a trial that the study does not have")
    value, swapped, ms = row.get("value"), row.get("swapped"), row.get("ms")
    high = HIGHEST if trial.kind == "rating" else 1
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= high:
        raise _broken(file, f"answer {number}: value: expected a whole number from 0 to {high}")
    if not isinstance(swapped, bool):
        raise _broken(file, f"answer {number}: swapped: expected true or false")
    # Comparisons with NaN are false.
    if isinstance(ms, bool) or not isinstance(ms, int | float) or not 0 <= ms <= _MOST_MS:
        raise _broken(file, f"answer {number}: ms: expected milliseconds")
    return Answer(trial, value, swapped, float(ms))


def _broken(file: Path, reason: str) -> LightprobeError:
    return LightprobeError(
        f"study: {file}: {reason}: it is not as the page wrote it: ask for the file once more"
    )
