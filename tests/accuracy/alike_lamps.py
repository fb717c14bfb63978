"""Lamps that look the same: how often `lightprobe field` gives one a wrong distance.

`python tests/accuracy/alike_lamps.py` prints the table of docs/users/places.md. Probes 1 m apart,
in the simulated room with other lamps; some lamps are listed by one of the two probes alone.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
from lightprobe import geometry
from lightprobe.estimate import Estimate
from lightprobe.field import Station, join
from lightprobe.geometry import Array
from lightprobe.sim.room import Bulb, Room
from page import put
from places import PAGE, estimate, seen_by

_GRID_X_M, _GRID_Z_M, _CEILING_M = (-1.5, -0.3, 0.9, 1.8), (-2.6, -1.0, 0.6), 1.3


_FREE_M = 1.3  # around the first probe, in which the second one stands


@dataclass(frozen=True)
class Kind:
    """Lamps of one kind of room."""

    words: str
    in_grid: bool = False  # eight under the ceiling, else six anywhere
    is_aligned: bool = False  # the probes stand along a row of the grid
    has_colours: bool = False
    listed: float = 0.85  # share of the lamps that each probe lists


KINDS = (
    Kind("six coloured lamps anywhere", has_colours=True),
    Kind("six equal lamps anywhere"),
    Kind("eight equal lamps in a grid", in_grid=True),
    Kind("the same, probes along a row", in_grid=True, is_aligned=True),
    Kind("the same, each lists 60 %", in_grid=True, is_aligned=True, listed=0.6),
)


def room_of(kind: Kind, rng: np.random.Generator) -> Room:
    """Make a room."""
    if kind.in_grid:
        grid = np.array([(x, _CEILING_M, z) for x in _GRID_X_M for z in _GRID_Z_M])
        hung_m = grid[rng.permutation(len(grid))[:8]]
    else:
        anywhere_m = rng.uniform([-2.4, -0.2, -3.2], [2.0, 1.3, 2.4], size=(50, 3))
        # Neither probe stands within a lamp.
        hung_m = anywhere_m[np.linalg.norm(anywhere_m, axis=1) > _FREE_M][:6]
    colours = rng.uniform(2, 20, size=(len(hung_m), 3)) if kind.has_colours else 0 * hung_m + 9
    return Room("alike", tuple(
        Bulb(tuple(place_m), 0.06, tuple(colour))
        for place_m, colour in zip(hung_m.tolist(), colours.tolist(), strict=True)
    ))  # fmt: skip


def _second_m(kind: Kind, rng: np.random.Generator) -> Array:
    towards = [1.0, 0, 0] if kind.is_aligned else rng.normal(size=3) * [1, 0.1, 1]
    return geometry.normalize(towards)


def tried(kind: Kind, here: Estimate, rng: np.random.Generator) -> tuple[int, int, int]:
    """Lamps listed, lamps that were given a distance, and wrong ones (by more than 3 sigma).

    `here` gives all but the lamps.
    """
    room = room_of(kind, rng)
    stations = [Station("a", np.zeros(3), 0.0, 0.0), Station("b", _second_m(kind, rng), 70.0)]
    base, other = (
        replace(here, lights=tuple(
            light for light in seen_by(station, room, rng) if rng.random() < kind.listed
        ))
        for station in stations
    )  # fmt: skip
    placed = wrong = 0
    for light in join(stations, base, [other]).estimate.lights:
        true_per_m = 1 / float(np.linalg.norm(room.bulbs[light.id - 1].position_m))
        if light.distance_m is not None and light.distance_sigma is not None:
            placed += 1
            off = abs(1 / light.distance_m - true_per_m) * light.distance_m
            wrong += off > 3 * light.distance_sigma
        elif light.nearest_m is not None:
            wrong += 1 / light.nearest_m < true_per_m
    return len(base.lights), placed, wrong


def table(trials: int) -> str:
    """Measure: Markdown."""
    here, rng = estimate(Room()), np.random.default_rng(2)
    lines = ["| lamps | listed | given a distance | of them wrong by more than 3 sigma |",
             "|---|---|---|---|"]  # fmt: skip
    for kind in KINDS:
        listed, placed, wrong = np.sum([tried(kind, here, rng) for _ in range(trials)], axis=0)
        lines.append(f"| {kind.words} | {listed} | {placed} | {wrong} |")
    return "\n".join(lines)


def main() -> None:
    """Print the table, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=150, help="rooms of each kind (150)")
    parser.add_argument("--page", action="store_true", help="write docs/users/places.md")
    options = parser.parse_args()
    measured = table(options.trials)
    print(measured)
    if options.page:
        put(PAGE, {"alike": measured + "\n"})


if __name__ == "__main__":
    main()
