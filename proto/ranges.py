# SPDX-License-Identifier: Apache-2.0
"""Read ranges.toml, which says what numbers a probe may send.

This file and the table are packed with the Python package, whose check reads them. The checks of
the others are made by ranges_code.py. All say the same sentence of the same field.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
#: How far the length of a unit vector may be from 1.
UNIT_TOLERANCE = 2e-3


@dataclass(frozen=True)
class Range:
    """One line of the table; its keys are explained there."""

    name: str  # MESSAGE.field
    least: float | None = None
    most: float | None = None
    above: float | None = None
    count: tuple[int | str, ...] = ()
    bytes: tuple[int | str, ...] = ()
    unit: bool = False
    absent: bool = False
    nan: bool = False
    one_of: tuple[int, ...] = ()
    names: tuple[str, ...] = ()  # of one_of
    required: bool = False

    @property
    def refusal(self) -> str:
        """Say what is wrong with a number that is not in it."""
        return f"{self.name}: expected {self._expected()}"

    def _expected(self) -> str:
        if self.required:
            return "it to be there"
        if self.one_of:
            return " or ".join(", ".join(self.names).rsplit(", ", 1))
        if self.unit:
            return f"a unit vector of {self.count[0]} numbers"
        if self.bytes:
            return f"{product(self.bytes)} bytes"
        if self.count:
            return f"{product(self.count)} {self._finite()}numbers{self._bounds()}"
        return f"a {self._finite()}number{self._bounds()}"

    def _finite(self) -> str:
        return "" if self.nan or self.most is not None else "finite "

    def _bounds(self) -> str:
        if self.above is not None:
            return f" above {self.above}" + ("" if self.most is None else f", {self.most} at most")
        if self.most is not None:
            return f", {self.least or 0} to {self.most}"
        return "" if self.least is None else f", {self.least} or more{' or NaN' * self.nan}"


def product(factors: tuple[int | str, ...]) -> str:
    """Give a count in words."""
    return " × ".join(f"({one})" if " " in str(one) else str(one) for one in factors)


def load() -> dict[str, dict[str, Range]]:
    """Give the ranges by message and field; raises TypeError for a key that is none."""
    table = tomllib.loads((HERE / "ranges.toml").read_text(encoding="utf-8"))
    return {
        message: {field: _range(f"{message}.{field}", row) for field, row in fields.items()}
        for message, fields in table.items()
    }


def _range(name: str, row: dict[str, Any]) -> Range:
    known = row.get("one_of", [])
    if not isinstance(known, dict):
        known = {str(value): value for value in known}
    lists = {key: tuple(row.get(key, ())) for key in ("count", "bytes")}
    lists |= {"one_of": tuple(known.values()), "names": tuple(known)}
    return Range(name, **row | lists)


def factor(one: int | str) -> tuple[int, str]:
    """Split a factor of `count`: a number, or a number to add and a field."""
    if isinstance(one, int):
        return one, ""
    field, _, plus = one.partition(" + ")
    return int(plus or 0), field
