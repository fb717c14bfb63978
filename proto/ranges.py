# SPDX-License-Identifier: Apache-2.0
"""Read ranges.toml, which says what numbers a probe may send, and make the checks of it.

Python reads the table itself: this file and the table are packed with it. The others' are made:

    ranges.py --typescript OUT    the table, for clients/js/src/ranges.ts
    ranges.py --csharp OUT        clients/csharp/Runtime/Ranges.cs
    ranges.py --header OUT        C, of the daemon (app/codec.c)

All say the same sentence of the same field.
"""

from __future__ import annotations

import argparse
import json
import re
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
            return f" above {self.above}"
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


# ---------------------------------------------------------------- TypeScript


def camel(name: str) -> str:
    """Give snake_case as JavaScript has it."""
    return re.sub(r"_(\w)", lambda match: match[1].upper(), name)


def typescript() -> str:
    """Give the table as a module, in JavaScript's names."""

    def factors(count: tuple[int | str, ...]) -> list[Any]:
        split = (factor(one) for one in count)
        return [{"plus": plus, "of": camel(of)} if of else plus for plus, of in split]

    def row(field: str, one: Range) -> dict[str, Any]:
        told = {"field": camel(field), "least": one.least, "most": one.most, "above": one.above,
                "count": factors(one.count or one.bytes) or None, "unit": one.unit or None,
                "absent": one.absent or None, "nan": one.nan or None,
                "oneOf": one.one_of or None, "required": one.required or None,
                "refusal": one.refusal}  # fmt: skip
        return {key: value for key, value in told.items() if value is not None}

    rows = {
        f"lightprobe.v1.{message}": [row(field, one) for field, one in fields.items()]
        for message, fields in load().items()
    }
    table = json.dumps(rows, indent=1, ensure_ascii=False)
    return (
        "// Generated from proto/ranges.toml by proto/ranges.py.\n"
        'import type { Range } from "../ranges.js";\n\n'
        f"export const UNIT_TOLERANCE = {UNIT_TOLERANCE};\n"
        f"export const RANGES: Record<string, Range[]> = {table};\n"
    )


def main() -> None:
    """Write what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--typescript", type=Path)
    arguments = parser.parse_args()
    if arguments.typescript:
        arguments.typescript.write_text(typescript(), encoding="utf-8")


if __name__ == "__main__":
    main()
