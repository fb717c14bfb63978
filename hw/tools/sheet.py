# SPDX-License-Identifier: Apache-2.0
"""A schematic that knows what it connects: drawn parts, wires and names of nets, by schemdraw.

What is drawn is compared with the circuit file: two pins are connected where wires, or names of
nets, join them on the paper. A wire joins what touches its ends, and what ends on it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import schemdraw
import schemdraw.elements
from circuit import Circuit

Point = tuple[float, float]
e: Any = schemdraw.elements  # typed in part only
NEAR = 1e-3
STUB = 0.5
INSIDE = {"left": -0.1, "right": 0.25}  # of a frame, where the names of pins begin
RAILS_UP = {"+5V": "+5 V", "+3V3": "+3.3 V", "SUPPLY": "SUPPLY"}
FONT = {"fontsize": 11}


@dataclass
class Sheet:
    """A drawing under way. Points in schemdraw's units, y upwards."""

    circuit: Circuit
    drawing: schemdraw.Drawing
    pins: list[tuple[Point, str, str]] = field(default_factory=list)
    names: list[tuple[Point, str]] = field(default_factory=list)
    wires: list[tuple[Point, Point]] = field(default_factory=list)

    def part(
        self,
        ref: str,
        element: Any,
        pins: dict[str, str],
        *,
        label: bool = True,
        **where: Any,
    ) -> dict[str, Point]:
        """Place a part; `pins` maps its pins to anchors of the element. Returns where the pins are.

        where: label's place ("loc", "ofst", "halign") as schemdraw's label() takes it.
        """
        if label:
            part = self.circuit.parts[ref]
            element.label(f"{ref}\n{part.label()}", **{**FONT, **where})
        placed = self.drawing.add(element)
        found = {pin: _point(placed.absanchors[anchor]) for pin, anchor in pins.items()}
        self.pins += [(at, ref, pin) for pin, at in found.items()]
        return found

    def chip(
        self,
        ref: str,
        left: Iterable[str],
        right: Iterable[str],
        at: Point,
        width: float = 4,
        pitch: float = 1.0,
    ) -> dict[str, Point]:
        """A box with its pins in two columns from above, `at` its upper left corner; "" is a gap.

        Numbers of the pins stand outside, on their stubs. pitch: from row to row.
        """
        columns = (
            (list(left), 0.0, -STUB, "left"),
            (list(right), width, STUB, "right"),
        )
        rows = max(len(names) for names, *_ in columns)
        x, y = at
        self.frame((x, y), width, rows * pitch)
        part = self.circuit.parts[ref]
        self.text((x, y + 0.25), f"{ref}: {part.what}", 11)
        found = {}
        for names, offset, stub, align in columns:
            for row, name in enumerate(names):
                if not name:
                    continue
                edge = (x + offset, y - (row + 0.5) * pitch)
                found[name] = (edge[0] + stub, edge[1])
                self.drawing.add(e.Line().endpoints(edge, found[name]))
                self.text((edge[0] - INSIDE[align], edge[1] - 0.02), name, 10, align, "center")
                if name in part.numbers:
                    self.text(
                        (edge[0] + stub / 2, edge[1] + 0.04),
                        str(part.numbers[name]),
                        8,
                        "center",
                    )
        self.pins += [(at, ref, pin) for pin, at in found.items()]
        return found

    def wire(self, *points: Point) -> Point:
        """A line from point to point. Returns the last one."""
        for a, b in pairwise(points):
            if _near(a, b):
                continue
            self.drawing.add(e.Line().endpoints(a, b))
            self.wires.append((a, b))
        return points[-1]

    def net(self, name: str, at: Point, side: str = "right") -> None:
        """Name of a net at a point: a rail's symbol, or a flag to one side."""
        self.names.append((at, name))
        if name == "GND":
            self.drawing.add(e.Ground().at(at))
        elif name in RAILS_UP:
            self.drawing.add(e.Vdd(lblofst=0.05).at(at).label(RAILS_UP[name], fontsize=10))
        else:
            turn = {"right": 0, "left": 180, "up": 90, "down": 270}[side]
            width = 0.5 + 0.19 * len(name)
            self.drawing.add(
                e.Tag(width=width, height=0.6).at(at).theta(turn).label(name, fontsize=9)
            )

    def named(self, name: str, at: Point, by: Point = (0.12, 0.08), halign: str = "left") -> None:
        """Name of a net written beside a wire, `by` from the point that it names."""
        self.names.append((at, name))
        self.text((at[0] + by[0], at[1] + by[1]), name, 9, halign, colour="#1f4e9c")

    def frame(self, at: Point, width: float, height: float, line: str = "-") -> None:
        """A rectangle, `at` its upper left corner."""
        box = e.Rect(corner1=(0, 0), corner2=(width, -height), ls=line)
        self.drawing.add(box.at(at).theta(0))

    def text(
        self,
        at: Point,
        text: str,
        size: float = 13,
        halign: str = "left",
        valign: str = "bottom",
        colour: str = "black",
    ) -> None:
        """A title or a note."""
        place = {
            "halign": halign,
            "valign": valign,
            "loc": "center",
            "ofst": (0, 0),
            "color": colour,
        }
        self.drawing.add(e.Label().at(at).theta(0).label(text, fontsize=size, **place))

    def save(self, *paths: Path) -> None:
        """Dots where wires meet; then the files."""
        for at in self.joints():
            self.drawing.add(e.Dot().at(at))
        for path in paths:
            self.drawing.save(str(path), transparent=False, dpi=110)

    def joints(self) -> list[Point]:
        """Points at which three or more pieces of wire or pins come together."""
        ends = [p for wire in self.wires for p in wire] + [at for at, *_ in self.pins]
        found = []
        for at in {_rounded(p) for p in ends}:
            through = sum(_within(at, *wire) for wire in self.wires)
            if sum(_near(at, p) for p in ends) + 2 * through >= 3:
                found.append(at)
        return found

    def connected(self) -> list[tuple[frozenset[tuple[str, str]], frozenset[str]]]:
        """Every set of pins that the drawing connects, with the names that are written there."""
        points = [at for at, *_ in self.pins] + [at for at, _ in self.names]
        points += [p for wire in self.wires for p in wire]
        group = list(range(len(points)))

        def root(i: int) -> int:
            while group[i] != i:
                i = group[i]
            return i

        def join(i: int, j: int) -> None:
            group[root(i)] = root(j)

        for i, p in enumerate(points):
            for j in range(i):
                if _near(p, points[j]):
                    join(i, j)
        first = len(self.pins) + len(self.names)
        for w, wire in enumerate(self.wires):
            join(first + 2 * w, first + 2 * w + 1)
            for i, p in enumerate(points):
                if _within(p, *wire):
                    join(i, first + 2 * w)
        by_name: dict[str, int] = {}
        for i, (_, name) in enumerate(self.names, len(self.pins)):
            join(i, by_name.setdefault(name, i))
        sets: dict[int, tuple[set[tuple[str, str]], set[str]]] = {}
        for i, (_, ref, pin) in enumerate(self.pins):
            sets.setdefault(root(i), (set(), set()))[0].add((ref, pin))
        for i, (_, name) in enumerate(self.names, len(self.pins)):
            sets.setdefault(root(i), (set(), set()))[1].add(name)
        return [(frozenset(pins), frozenset(names)) for pins, names in sets.values()]


def _point(p: tuple[float, float]) -> Point:
    return (float(p[0]), float(p[1]))


def _rounded(p: Point) -> Point:
    return (round(p[0], 3), round(p[1], 3))


def _near(p: Point, q: Point) -> bool:
    return abs(p[0] - q[0]) < NEAR and abs(p[1] - q[1]) < NEAR


def _within(p: Point, a: Point, b: Point) -> bool:
    """Whether a point lies on a wire, its ends left out."""
    if _near(p, a) or _near(p, b):
        return False
    (px, py), (dx, dy) = (p[0] - a[0], p[1] - a[1]), (b[0] - a[0], b[1] - a[1])
    length = math.hypot(dx, dy)
    beside = abs(px * dy - py * dx) / length
    return beside < NEAR and 0 < px * dx + py * dy < length * length
