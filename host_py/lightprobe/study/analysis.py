"""What the answers of a study say, as numbers. Each participant counts once in each test."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.errors import LightprobeError
from lightprobe.geometry import Array
from lightprobe.study import answers as answer_files
from lightprobe.study import statistics
from lightprobe.study.answers import Answer, LeftOut, Participant
from lightprobe.study.statistics import Interval
from lightprobe.study.trials import HIGHEST, Kind, Role, Shown, Study

ALL = "all"
#: Participants of the study that lightprobe's research made.
RESEARCH_PEOPLE = 33


@dataclass(frozen=True)
class Rating:
    """How real objects by a method look."""

    method: str
    object: str  # ALL: mean over objects and scenes
    rating: Interval
    virtual: Interval  # share of ratings in the lower half


@dataclass(frozen=True)
class Comparison:
    """Two methods, by the same people. Of ratings: first − second; of choices: share of first."""

    kind: Kind
    first: str
    second: str
    value: Interval
    effect: float | None  # Cohen's d_z
    p: float | None  # paired permutation test
    p_holm: float | None  # corrected for all comparisons of this kind
    p_wilcoxon: float | None
    detectable: float | None  # what as many people tell from no difference, in the value's unit
    objects: dict[str, Interval]  # the value for each object alone


@dataclass(frozen=True)
class Consistency:
    """How alike people answer when they are asked again, and whether a side attracts them."""

    rating_change: Interval | None  # mean absolute difference of two ratings of a picture
    same_choice: Interval | None
    first_place: Interval | None  # left or on top, of two identical pictures
    first_place_all: Interval | None  # of all choices that have no right answer


@dataclass(frozen=True)
class Findings:
    """All of it."""

    title: str
    study: str  # hash
    simulated: bool
    people: int
    left_out: tuple[LeftOut, ...]
    ratings: tuple[Rating, ...]
    comparisons: tuple[Comparison, ...]
    consistency: Consistency
    detectable_effect: float | None  # d_z that as many people find with a power of 80 %
    reference: str

    def table(self) -> dict[str, Any]:
        """Give it for JSON."""
        return asdict(self) | {
            "left_out": [
                {"file": str(one.participant.file), "participant": one.participant.id,
                 "reason": one.reason}
                for one in self.left_out
            ],
        }  # fmt: skip


def analyse(study: Study, files: Sequence[Path]) -> Findings:
    """Analyse answers files; raises LightprobeError for those that cannot be used."""
    everybody = answer_files.load(study, files)
    people, left_out = answer_files.sort_out(study, everybody)
    if not people:
        raise LightprobeError(
            f"study: {left_out[0].participant.file}: {left_out[0].reason}: all of {len(left_out)} "
            "participants are left out, and none is left to analyse: ask more"
        )
    data = _Data(study, people)
    comparisons = [
        *_holm([_compare_ratings(data, *pair) for pair in study.compared if data.has("rating")]),
        *_holm([_compare_choices(data, *pair) for pair in study.compared if data.has("choice")]),
    ]
    return Findings(
        study.title, study.hash, people[0].simulated, len(people), tuple(left_out),
        tuple(_ratings(data)) if data.has("rating") else (), tuple(comparisons),
        _consistency(data), statistics.detectable(len(people)), study.reference,
    )  # fmt: skip


class _Data:
    """Answers by participant."""

    def __init__(self, study: Study, people: Sequence[Participant]) -> None:
        self.study, self.people = study, people
        self._pictures = {one.id: one for one in study.pictures}
        self.objects = list(dict.fromkeys(sorted(one.object for one in study.pictures)))

    def has(self, kind: Kind) -> bool:
        return any(one.kind == kind for one in self.study.trials)

    def of(self, answer: Answer, index: int = 0) -> Shown:
        """Give what a trial's picture shows."""
        return self._pictures[answer.trial.pictures[index]]

    def matrix(
        self, kind: Kind, role: Role, keep: Callable[[Answer], bool], value: Callable[[Answer], Any]
    ) -> Array:
        """Give values (participants, trials): each has answered all trials, in some order."""
        rows = []
        for person in self.people:
            chosen = [
                one for one in person.answers
                if (one.trial.kind, one.trial.role) == (kind, role) and keep(one)
            ]  # fmt: skip
            rows.append([value(one) for one in sorted(chosen, key=lambda one: one.trial.id)])
        return np.array(rows, float)


def _ratings(data: _Data) -> list[Rating]:
    found = []
    for method in data.study.methods:
        for thing in (ALL, *data.objects):

            def keep(one: Answer, method: str = method, thing: str = thing) -> bool:
                shown = data.of(one)
                return shown.method == method and thing in (ALL, shown.object)

            values = data.matrix("rating", "main", keep, lambda one: one.value)
            lower = (values < HIGHEST / 2).sum(axis=1)
            found.append(
                Rating(
                    method, thing, statistics.mean(values.mean(axis=1)),
                    statistics.clustered_wilson([int(n) for n in lower], values.shape[1]),
                )
            )  # fmt: skip
    return found


def _compare_ratings(data: _Data, first: str, second: str) -> Comparison:
    def differences(thing: str) -> Array:
        def means(method: str) -> Array:
            def keep(one: Answer) -> bool:
                shown = data.of(one)
                return shown.method == method and thing in (ALL, shown.object)

            values = data.matrix("rating", "main", keep, lambda one: one.value)
            return np.asarray(values.mean(axis=1))

        return means(first) - means(second)

    objects = {thing: statistics.mean(differences(thing)) for thing in data.objects}
    d = differences(ALL)
    return _comparison("rating", first, second, statistics.mean(d), d, objects)


def _compare_choices(data: _Data, first: str, second: str) -> Comparison:
    def chosen(thing: str) -> Array:
        def keep(one: Answer) -> bool:
            methods = (data.of(one, 0).method, data.of(one, 1).method)
            return methods == (first, second) and thing in (ALL, data.of(one).object)

        return data.matrix("choice", "main", keep, lambda one: one.value == 0)

    def share(values: Array) -> Interval:
        counts = [int(n) for n in values.sum(axis=1)]
        return statistics.clustered_wilson(counts, values.shape[1])

    whole = chosen(ALL)
    objects = {thing: share(chosen(thing)) for thing in data.objects}
    from_half = whole.mean(axis=1) - 0.5
    return _comparison("choice", first, second, share(whole), from_half, objects)


def _comparison(
    kind: Kind, first: str, second: str, value: Interval, differences: Array,
    objects: dict[str, Interval],
) -> Comparison:  # fmt: skip
    several = len(differences) > 1
    smallest = statistics.detectable(len(differences))
    spread = float(differences.std(ddof=1)) if several else 0.0
    return Comparison(
        kind, first, second, value, statistics.effect_size(differences),
        statistics.permutation(differences) if several else None, None,
        statistics.wilcoxon(differences) if several else None,
        smallest * spread if smallest is not None and spread > 0 else None, objects,
    )  # fmt: skip


def _holm(comparisons: list[Comparison]) -> list[Comparison]:
    """Correct the tests of one kind for their number."""
    tested = [one.p for one in comparisons if one.p is not None]
    if len(tested) < len(comparisons):
        return comparisons
    return [
        Comparison(**(vars(one) | {"p_holm": p}))
        for one, p in zip(comparisons, statistics.holm(tested), strict=True)
    ]


def _consistency(data: _Data) -> Consistency:
    def again(kind: Kind) -> Array:
        """Give the first answers and those of repeats (2, participants, trials)."""
        repeated = {
            one.pictures for one in data.study.trials if (one.kind, one.role) == (kind, "repeat")
        }
        pairs = [
            [
                sorted(
                    (one.trial.pictures, one.value) for one in person.answers
                     if (one.trial.kind, one.trial.role) == (kind, role)
                     and one.trial.pictures in repeated
                )
                for person in data.people
            ]
            for role in ("main", "repeat")
        ]  # fmt: skip
        return np.array([[[v for _, v in row] for row in rows] for rows in pairs], float)

    def count(values: Array) -> Interval | None:
        if values.size == 0:
            return None
        return statistics.clustered_wilson([int(n) for n in values.sum(axis=1)], values.shape[1])

    ratings, choices = again("rating"), again("choice")
    sides = [
        data.matrix("choice", role, lambda one: True, lambda one: one.first_place)
        for role in ("identical", "main")
    ]
    change = np.abs(ratings[0] - ratings[1])
    return Consistency(
        statistics.mean(change.mean(axis=1)) if change.size else None,
        count(choices[0] == choices[1]), count(sides[0]), count(np.hstack(sides)),
    )  # fmt: skip
