"""What each participant of a study is shown, and the study file that fixes it all.

The file is written before anybody answers. Its hash is in the page and in each answers file, so
that answers of another study, or of rules that were changed afterwards, are told.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import cycle, islice
from pathlib import Path
from typing import Any, Literal

from lightprobe.errors import LightprobeError
from lightprobe.study.plan import Exclude, Plan

VERSION = 1
NAME = "study.json"
Kind = Literal["rating", "choice"]
Role = Literal["main", "repeat", "catch", "identical"]
#: Highest rating.
HIGHEST = 10
#: What catch trials of ratings ask for, in turn: no answer that many give anyway.
_ASKED = (2, 9, 4, 7, 1)
_SECONDS = {"rating": 6.0, "choice": 5.0}


@dataclass(frozen=True)
class Shown:
    """A picture as the page has it: its name tells nothing."""

    id: str
    scene: str
    object: str
    method: str
    sha256: str
    turned: bool = False  # upside down: the obviously wrong one of a catch trial


@dataclass(frozen=True)
class Trial:
    """One question. Of a choice, the first picture is left or on top in half of the trials."""

    id: str
    kind: Kind
    role: Role
    pictures: tuple[str, ...]  # ids
    right: str | int | None = None  # of a catch trial: picture, or rating that is asked for


@dataclass(frozen=True)
class Study:
    """All that analysis needs to know; never shown to participants."""

    title: str
    reference: str
    methods: tuple[str, ...]
    compared: tuple[tuple[str, str], ...]
    pictures: tuple[Shown, ...]
    trials: tuple[Trial, ...]
    exclude: Exclude
    texts: dict[str, Any]
    size_px: tuple[int, int]

    def content(self) -> dict[str, Any]:
        """Give what is hashed."""
        return {"version": VERSION} | asdict(self)

    @property
    def hash(self) -> str:
        """Give SHA-256 of all that the study is."""
        text = json.dumps(self.content(), sort_keys=True, separators=(",", ":"), ensure_ascii=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def encode(self) -> bytes:
        """Write the study file."""
        return (json.dumps({"hash": self.hash} | self.content(), indent=1) + "\n").encode()

    def minutes(self) -> float:
        """Guess how long a participant takes, at some seconds for each trial."""
        return sum(_SECONDS[one.kind] for one in self.trials) / 60


def name(*parts: object) -> str:
    """Give a name that tells nothing, the same for the same parts."""
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:12]


def design(plan: Plan, sums: dict[str, str], size_px: tuple[int, int]) -> Study:
    """Make a study of a plan; `sums`: SHA-256 of each picture's pixels, by its file."""
    shown = {
        (one.scene, one.object, one.method): Shown(
            name(plan.title, one.scene, one.object, one.method, sums[one.file]),
            one.scene, one.object, one.method, sums[one.file],
        )
        for one in plan.shown()
    }  # fmt: skip
    trials: list[Trial] = []
    turned: list[Shown] = []
    places = list(dict.fromkeys((scene, thing) for scene, thing, _ in shown))
    references = [shown[(*place, plan.reference)] for place in places]
    if plan.ratings:
        main = [_trial("rating", "main", one.id) for one in shown.values()]
        trials += [*main, *_repeats(main, plan.repeats), *_told(plan, list(shown.values()))]
    if plan.choices:
        main = [
            _trial("choice", "main", shown[(*place, first)].id, shown[(*place, second)].id)
            for place in places
            for first, second in plan.compared()
        ]
        turned = [_turned(one) for one in islice(references, plan.catches)]
        trials += [*main, *_repeats(main, plan.repeats), *_obvious(plan, references, turned)]
        trials += [
            _trial("choice", "identical", one.id, one.id, extra=k)
            for k, one in enumerate(islice(cycle(reversed(references)), plan.identical))
        ]
    pictures = sorted([*shown.values(), *turned], key=lambda one: one.id)
    # Otherwise nobody's answers could be read.
    assert len({one.id for one in trials}) == len(trials), "trials of the same id"
    return Study(
        plan.title, plan.reference, tuple(dict.fromkeys(one.method for one in plan.shown())),
        plan.compared(), tuple(pictures), tuple(sorted(trials, key=lambda one: one.id)),
        plan.exclude, _texts(plan), size_px,
    )  # fmt: skip


def _trial(
    kind: Kind, role: Role, *pictures: str, right: str | int | None = None, extra: int = 0
) -> Trial:
    return Trial(name(kind, role, pictures, right, extra), kind, role, pictures, right)


def _repeats(main: list[Trial], count: int) -> Iterator[Trial]:
    """Spread over the trials, so that not one method alone is repeated."""
    count = min(count, len(main))
    for k in range(count):
        one = main[(2 * k + 1) * len(main) // (2 * count)]
        yield _trial(one.kind, "repeat", *one.pictures)


def _told(plan: Plan, pictures: list[Shown]) -> Iterator[Trial]:
    """Catch trials of ratings: a picture, and words that ask for a certain rating."""
    for k in range(plan.catches):
        picture = pictures[(2 * k + 1) * len(pictures) // (2 * plan.catches)]
        right = _ASKED[k % len(_ASKED)]
        yield _trial("rating", "catch", picture.id, right=right, extra=k)


def _turned(one: Shown) -> Shown:
    return Shown(name("turned", one.id), one.scene, one.object, one.method, one.sha256, turned=True)


def _obvious(plan: Plan, references: list[Shown], turned: list[Shown]) -> Iterator[Trial]:
    """Catch trials of choices: a real picture against itself upside down."""
    pairs = islice(cycle(zip(references, turned, strict=False)), plan.catches)
    for k, (good, wrong) in enumerate(pairs):
        yield _trial("choice", "catch", good.id, wrong.id, right=good.id, extra=k)


def _texts(plan: Plan) -> dict[str, Any]:
    """Give what the page says in the researcher's words."""
    return {
        "title": plan.title, "contact": plan.contact, "consent": plan.consent,
        "rating_question": plan.rating_question, "rating_ends": list(plan.rating_ends),
        "choice_question": plan.choice_question,
    }  # fmt: skip


def load(path: Path) -> Study:
    """Read a study file, or that of a folder; LightprobeError says what is wrong with it."""
    file = path / NAME if path.is_dir() else path
    try:
        table = json.loads(file.read_text(encoding="utf-8"))
        if table["version"] != VERSION:
            raise LightprobeError(
                f"study: {file}: version {table['version']}, and this lightprobe reads {VERSION}: "
                "use the lightprobe that made it"
            )
        study = _of(table)
        stated = table["hash"]
    except OSError as error:
        raise LightprobeError(
            f"study: {file}: {error.strerror}: name the folder that `lightprobe study make` wrote"
        ) from None
    except (ValueError, KeyError, TypeError, RecursionError):
        raise LightprobeError(
            f"study: {file}: not a study file: name the {NAME} that `lightprobe study make` wrote"
        ) from None
    if study.hash != stated:
        raise LightprobeError(
            f"study: {file}: it was changed after it was made: bring back the former file, or make "
            "the study anew"
        )
    return study


def _of(table: dict[str, Any]) -> Study:
    return Study(
        table["title"], table["reference"], tuple(table["methods"]),
        tuple((a, b) for a, b in table["compared"]),
        tuple(Shown(**one) for one in table["pictures"]),
        tuple(
            Trial(one["id"], one["kind"], one["role"], tuple(one["pictures"]), one["right"])
            for one in table["trials"]
        ),
        Exclude(**table["exclude"]), table["texts"], (table["size_px"][0], table["size_px"][1]),
    )  # fmt: skip
