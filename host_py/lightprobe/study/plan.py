"""What a researcher writes of a study: a TOML file beside the pictures."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from lightprobe.errors import LightprobeError

#: Most pictures of one study.
MOST_PICTURES = 2000
_MOST_TEXT = 5000
_CONSENT = (
    "Taking part is voluntary. You can stop at any time, and your answers are then deleted. The "
    "page asks for no name and no address, and sends nothing: your answers stay on this device "
    "until you give the file to whoever runs the study."
)


@dataclass(frozen=True)
class Picture:
    """One picture of an object in a scene, by a method (or the real one)."""

    file: str  # beside the TOML file
    scene: str
    object: str
    method: str

    @property
    def words(self) -> str:
        """Name it in a message."""
        return f"{self.object!r} in scene {self.scene!r} by {self.method!r}"


@dataclass(frozen=True)
class Exclude:
    """Whose answers are left out: written down before anybody has answered."""

    missed: int = 1  # left out: who misses more catch trials than this
    fastest_s: float = 0.5  # left out: whose median answer took less


@dataclass(frozen=True)
class Plan:
    """A study as the researcher has it in mind."""

    title: str
    reference: str  # the method whose pictures are the real ones
    pictures: tuple[Picture, ...]
    contact: str = ""
    consent: str = _CONSENT
    rating_question: str = "How real does this object look?"
    rating_ends: tuple[str, str] = ("very virtual", "very realistic")
    choice_question: str = "Which object belongs in the picture?"
    ratings: bool = True
    choices: bool = True
    methods: tuple[str, ...] = ()  # that take part; none: all
    scenes: tuple[str, ...] = ()
    objects: tuple[str, ...] = ()
    pairs: tuple[tuple[str, str], ...] = ()  # of methods; none: each with the reference
    repeats: int = 3  # trials of each kind that are shown twice
    catches: int = 3  # catch trials of each kind
    identical: int = 2  # choices between a picture and itself
    exclude: Exclude = field(default_factory=Exclude)

    def shown(self) -> tuple[Picture, ...]:
        """Give the pictures that take part."""

        def wanted(name: str, chosen: Sequence[str]) -> bool:
            return not chosen or name in chosen

        return tuple(
            one
            for one in self.pictures
            if (wanted(one.method, self.methods) or one.method == self.reference)
            and wanted(one.scene, self.scenes)
            and wanted(one.object, self.objects)
        )

    def compared(self) -> tuple[tuple[str, str], ...]:
        """Give the pairs of methods that are compared, in ratings and in choices."""
        if self.pairs:
            return self.pairs
        others = dict.fromkeys(one.method for one in self.shown())
        return tuple((method, self.reference) for method in others if method != self.reference)


def load(path: Path) -> Plan:
    """Read a study's TOML file; LightprobeError names file and key of what is wrong."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise LightprobeError(
            f"study: {path}: {error.strerror}: name a study's TOML file"
        ) from None
    except ValueError as error:  # UnicodeDecodeError is one
        raise LightprobeError(f"study: {path}: not TOML: {error}") from None
    reader = _Reader(path)
    rows = table.pop("pictures", None)
    if not isinstance(rows, list) or not rows:
        raise reader.wrong("pictures", "there are none: add a [[pictures]] table for each")
    if len(rows) > MOST_PICTURES:
        raise reader.wrong("pictures", f"{len(rows)}; a study has at most {MOST_PICTURES}")
    pictures = tuple(reader.picture(k, row) for k, row in enumerate(rows, 1))
    plan = reader.plan(table, pictures)
    _check(plan, reader)
    return plan


class _Reader:
    """Takes values of the right kind from a table; names file and key of those that are none."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def wrong(self, key: str, reason: str) -> LightprobeError:
        return LightprobeError(f"study: {self._path}: {key}: {reason}")

    def text(self, key: str, value: Any) -> str:
        if not isinstance(value, str) or not value.strip():
            raise self.wrong(key, "expected a text in quotes")
        if len(value) > _MOST_TEXT:
            raise self.wrong(key, f"longer than {_MOST_TEXT} characters")
        return value

    def texts(self, key: str, value: Any) -> tuple[str, ...]:
        if not isinstance(value, list):
            raise self.wrong(key, "expected a list of texts")
        return tuple(self.text(key, one) for one in value)

    def two(self, key: str, value: Any) -> tuple[str, str]:
        found = self.texts(key, value)
        if len(found) != 2:
            raise self.wrong(key, "expected two texts")
        return found[0], found[1]

    def number(self, key: str, value: Any, kind: type, high: float) -> Any:
        known = (int, float) if kind is float else int
        if isinstance(value, bool) or not isinstance(value, known) or not 0 <= value <= high:
            words = "a whole number" if kind is int else "a number"
            raise self.wrong(key, f"expected {words} from 0 to {high:g}")
        return kind(value)

    def table(self, key: str, value: Any) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise self.wrong(key, "expected a table")
        return value

    def only(self, key: str, table: dict[str, Any], known: Sequence[str]) -> None:
        for name in table:
            if name not in known:
                raise self.wrong(f"{key}{name}", f"no such key: there are {', '.join(known)}")

    def picture(self, index: int, row: Any) -> Picture:
        names = [one.name for one in fields(Picture)]
        key = f"pictures, number {index}"
        self.only(f"{key}: ", self.table(key, row), names)
        return Picture(**{name: self.text(f"{key}: {name}", row.get(name)) for name in names})

    def exclude(self, value: Any) -> Exclude:
        table = self.table("exclude", value)
        self.only("exclude.", table, [one.name for one in fields(Exclude)])
        return Exclude(
            self.number("exclude.missed", table.get("missed", Exclude.missed), int, 100),
            self.number("exclude.fastest_s", table.get("fastest_s", Exclude.fastest_s), float, 60),
        )

    def plan(self, table: dict[str, Any], pictures: tuple[Picture, ...]) -> Plan:
        self.only("", table, [one.name for one in fields(Plan)])
        for key in ("title", "reference"):
            if key not in table:
                raise self.wrong(key, "missing")
        found: dict[str, Any] = {}
        for key, value in table.items():
            if key in ("ratings", "choices"):
                if not isinstance(value, bool):
                    raise self.wrong(key, "expected true or false")
                found[key] = value
            elif key in ("repeats", "catches", "identical"):
                found[key] = self.number(key, value, int, 50)
            elif key in ("methods", "scenes", "objects"):
                found[key] = self.texts(key, value)
            elif key == "rating_ends":
                found[key] = self.two(key, value)
            elif key == "pairs":
                if not isinstance(value, list):
                    raise self.wrong(key, "expected a list of pairs of methods")
                found[key] = tuple(self.two(key, pair) for pair in value)
            elif key == "exclude":
                found[key] = self.exclude(value)
            else:
                found[key] = self.text(key, value)
        return Plan(pictures=pictures, **found)


def _check(plan: Plan, reader: _Reader) -> None:
    """Refuse a plan that cannot be shown, or that nobody could learn from."""
    if not plan.ratings and not plan.choices:
        raise reader.wrong("ratings, choices", "both are off: nothing would be asked")
    if plan.catches == 0:
        raise reader.wrong("catches", "0: without catch trials nobody knows who looked: at least 1")
    asked = plan.catches * (plan.ratings + plan.choices)
    if plan.exclude.missed >= asked:
        raise reader.wrong(
            "exclude.missed", f"{plan.exclude.missed} of {asked} catch trials: nobody would be "
            "left out: a smaller number, or more catches"
        )  # fmt: skip
    known = {
        "method": dict.fromkeys(one.method for one in plan.pictures),
        "scene": dict.fromkeys(one.scene for one in plan.pictures),
        "object": dict.fromkeys(one.object for one in plan.pictures),
    }
    named: list[tuple[str, str, tuple[str, ...]]] = [("reference", "method", (plan.reference,))]
    named += [(f"{kind}s", kind, getattr(plan, f"{kind}s")) for kind in known]
    named += [("pairs", "method", pair) for pair in plan.pairs]
    for key, kind, names in named:
        for name in names:
            if name not in known[kind]:
                raise reader.wrong(key, f"no picture has the {kind} {name!r}")
    _check_pictures(plan, reader)


def _check_pictures(plan: Plan, reader: _Reader) -> None:
    shown = plan.shown()
    seen: dict[tuple[str, str, str], str] = {}
    for one in shown:
        place = (one.scene, one.object, one.method)
        if place in seen:
            raise reader.wrong("pictures", f"{one.words}: two: {seen[place]} and {one.file}")
        seen[place] = one.file
    methods = dict.fromkeys(one.method for one in shown)
    for first, second in plan.compared():
        if first == second or not {first, second} <= set(methods):
            raise reader.wrong("pairs", f"{first!r}, {second!r}: two methods that take part")
    named: set[frozenset[str]] = set()
    for first, second in plan.compared():
        if frozenset((first, second)) in named:
            raise reader.wrong(
                "pairs", f"{first!r}, {second!r}: named twice, and which of the two comes first is "
                "no difference: name each pair once"
            )  # fmt: skip
        named.add(frozenset((first, second)))
    if not plan.compared():
        raise reader.wrong("pictures", f"no method takes part beside {plan.reference!r}")
    for one in shown:
        for method in methods:
            if (one.scene, one.object, method) not in seen:
                raise reader.wrong(
                    "pictures", f"{one.object!r} in scene {one.scene!r}: none by {method!r}: each "
                    "method needs the same scenes and objects"
                )  # fmt: skip
