# SPDX-License-Identifier: Apache-2.0
"""Bill of materials, power budget and the servo's force, as Markdown, from hw/bom.yml."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, field
from typing import Any

import circuit
import yaml
from dimensions import HW, dimensions


@dataclass
class Part:
    """One line of the bill. Prices in euro, currents in mA at 5 V, masses in g, all for one."""

    id: str
    what: str
    count: int
    price_eur: tuple[float, float]
    instead: list[dict[str, Any]]
    option: str = ""
    rail: str = ""
    typical_ma: float = 0
    peak_ma: float = 0
    headset_g: float = 0
    torque_nm: float = 0
    travel_deg: int = 0


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
        part.what = part.what.replace("{small_parts}", circuit.small_parts())
        for low, high in [
            part.price_eur,
            *(other["price_eur"] for other in part.instead),
        ]:
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
        [
            *lines,
            f"| **all that is needed** | | **{span(round(low), round(high))}** | |",
        ]
    )


def power_table(parts: list[Part], rails: list[Rail]) -> str:
    """Markdown."""
    lines = [
        "| from | typical, mA | all peaks at once, mA | limit, mA | left |",
        "|---|---|---|---|---|",
    ]
    for rail in budget(parts, rails):
        left = 100 * (1 - rail.peak_ma / rail.limit_ma)
        row = (
            rail.what,
            *(f"{ma:.0f}" for ma in (rail.typical_ma, rail.peak_ma, rail.limit_ma)),
        )
        lines.append(f"| {' | '.join(row)} | {left:.0f} % |")
    return "\n".join(lines)


def drive_table() -> str:
    """Markdown: what servos push with at the teeth of their gear, and what the wheel needs."""
    lines = ["| servo | N at the teeth |", "|---|---|"]
    servo = next(part for part in load()[0] if part.id == "servo")
    choices = [(servo.what, servo.torque_nm, servo.travel_deg)]
    choices += [(o["what"], o["torque_nm"], o["travel_deg"]) for o in servo.instead]
    for what, torque_nm, travel_deg in choices:
        radius_m = dimensions(servo_travel_deg=travel_deg)["servo_gear_radius"] / 1000
        lines.append(f"| {what}, stalled | {torque_nm / radius_m:.1f} |")
    return "\n".join([*lines, f"| *needed by the wheel* | {needed_n():.1f} |"])


def needed_n() -> float:
    """Force at the wheel's teeth, in N: to turn a disc to full speed in 50 ms, and friction."""
    wheel_kg, friction_n = 0.06, 0.3
    speed_rad_s, within_s = math.radians(240), 0.05
    dim = dimensions()
    inertia_kg_m2 = 0.5 * wheel_kg * (dim["comb_radius"] / 1000) ** 2
    radius_m = dim["wheel_gear_radius"] / 1000
    return inertia_kg_m2 * speed_rad_s / within_s / radius_m + friction_n


def main() -> None:
    """Prints the tables."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    parts, rails = load()
    print(bom_table(parts))
    print()
    print(power_table(parts, rails))
    print()
    print(drive_table())


if __name__ == "__main__":
    main()
