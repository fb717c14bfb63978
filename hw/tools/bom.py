# SPDX-License-Identifier: Apache-2.0
"""Bill of materials and power budget, as Markdown, from hw/bom.yml."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from typing import Any

import yaml
from dimensions import HW


@dataclass
class Part:
    """One line of the bill. Prices in euro for one, currents in mA at 5 V for one."""

    id: str
    what: str
    count: int
    price_eur: tuple[float, float]
    instead: list[dict[str, Any]]
    option: str = ""
    rail: str = ""
    typical_ma: float = 0
    peak_ma: float = 0


@dataclass
class Rail:
    """What supplies parts; `by` is the rail that it hangs on itself."""

    id: str
    what: str
    limit_ma: float
    by: str = ""
    typical_ma: float = field(default=0, init=False)
    peak_ma: float = field(default=0, init=False)


def load() -> tuple[list[Part], list[Rail]]:
    """The file; TypeError for a key that is not known, ValueError for numbers that cannot be."""
    data = yaml.safe_load((HW / "bom.yml").read_text())
    parts = [Part(**{**part, "price_eur": tuple(part["price_eur"])}) for part in data["parts"]]
    rails = [Rail(id=name, **rail) for name, rail in data["rails"].items()]
    for part in parts:
        for low, high in [part.price_eur, *(other["price_eur"] for other in part.instead)]:
            if not 0 <= low <= high:
                raise ValueError(f"bom.yml: {part.id}: price {low}…{high}")
        if part.rail and part.rail not in {rail.id for rail in rails}:
            raise ValueError(f"bom.yml: {part.id}: rail {part.rail} is unknown")
        if part.typical_ma > part.peak_ma:
            raise ValueError(f"bom.yml: {part.id}: typical current above its peak")
    return parts, rails


def budget(parts: list[Part], rails: list[Rail]) -> list[Rail]:
    """Rails with the currents of what is not optional, and of the rails that hang on them."""
    by_id = {rail.id: rail for rail in rails}
    for rail in rails:
        rail.typical_ma = rail.peak_ma = 0
    for part in parts:
        name = "" if part.option else part.rail
        while name:
            rail = by_id[name]
            rail.typical_ma += part.count * part.typical_ma
            rail.peak_ma += part.count * part.peak_ma
            name = rail.by
    return rails


def total_eur(parts: list[Part]) -> tuple[float, float]:
    """Sum of the lowest and of the highest prices of what is needed."""
    needed = [part for part in parts if not part.option]
    return sum(p.count * p.price_eur[0] for p in needed), sum(
        p.count * p.price_eur[1] for p in needed
    )


def span(low: float, high: float) -> str:
    """A range of prices."""
    return f"{low:g}…{high:g}"


def bom_table(parts: list[Part]) -> str:
    """Markdown."""
    lines = ["| part | count | € each | instead |", "|---|---|---|---|"]
    for part in sorted(parts, key=lambda p: bool(p.option)):
        instead = "; ".join(
            f"{o['what']} (€ {span(*o['price_eur'])}: {o['note']})" for o in part.instead
        )
        only = f"*only for {part.option}:* " if part.option else ""
        lines.append(f"| {only}{part.what} | {part.count} | {span(*part.price_eur)} | {instead} |")
    low, high = total_eur(parts)
    return "\n".join(
        [*lines, f"| **all that is needed** | | **{span(round(low), round(high))}** | |"]
    )


def power_table(parts: list[Part], rails: list[Rail]) -> str:
    """Markdown."""
    lines = [
        "| from | typical, mA | all peaks at once, mA | limit, mA | left |",
        "|---|---|---|---|---|",
    ]
    for rail in budget(parts, rails):
        left = 100 * (1 - rail.peak_ma / rail.limit_ma)
        row = (rail.what, *(f"{ma:.0f}" for ma in (rail.typical_ma, rail.peak_ma, rail.limit_ma)))
        lines.append(f"| {' | '.join(row)} | {left:.0f} % |")
    return "\n".join(lines)


def main() -> None:
    """Prints both tables."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    parts, rails = load()
    print(bom_table(parts))
    print()
    print(power_table(parts, rails))


if __name__ == "__main__":
    main()
