"""What a mirror ball shows beside a probe that moves, in furnished rooms by a renderer: FLIP.

The rooms and the head's way are those of tests/accuracy/furnished.py, with fewer samples (kept in
build/furnished). The ball mirrors the reflection map of AMBIENT and the packet's lamps as discs:
unchanged, and `at(position)` of both. Truth is rendered 0.5 and 1 m beside. All of it is simulated.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product

import beside_rooms
import cv2
import flip_evaluator
import furnished
import furnished_rooms
import numpy as np
import recording
from beside_rooms import ROOT, Seen
from furnished import Case, FurnishedRoom
from furnished_rooms import COARSE, KINDS, TRUTH_M, TRUTH_PX
from lightprobe import geometry
from lightprobe.colour import linear_to_srgb, luminance
from lightprobe.geometry import Array
from lightprobe.sim.world import Behaviour
from page import put
from recording import ORIENTATIONS, SETTLE_S, Run, record

#: Of one room of each kind.
SEED = 11
#: Mean of the room on the screen, linear.
_GREY = 0.35
_BALL_PX = 160
_JUDGED_AT_S, _JUDGED_S, _EVERY = 30.0, 0.6, 4
_WISHES = {
    "raw": beside_rooms.WISH, "areas": replace(beside_rooms.WISH, area_lights=True),
}  # fmt: skip
_LISTS = {"raw": "lamps listed", "areas": "lamps and area lights listed"}


@dataclass(frozen=True)
class Mirrored:
    """FLIP of one packet at one place."""

    wish: str
    distance_m: float
    unchanged: float
    at_place: float


@dataclass(frozen=True)
class Balls:
    """What came of a case."""

    case: Case
    found: list[Mirrored]


def ball(radiance: Array) -> Array:
    """A mirror ball (P, 2 P, 3) in an equirectangular map, from behind (+Z) and from ahead."""
    place = (np.arange(_BALL_PX) + 0.5) / _BALL_PX * 2 - 1
    x, y = np.meshgrid(place, -place)
    depth = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    height, width = radiance.shape[:2]
    views = []
    for side in (1, -1):
        normal = np.stack([side * x, y, side * depth], axis=-1)
        mirrored = 2 * side * normal[..., 2:] * normal - [0, 0, side]
        column, row = geometry.equirect_pixel(mirrored, width, height)
        wide = np.pad(np.float32(radiance), ((1, 1), (1, 1), (0, 0)), mode="wrap")
        wide[0], wide[-1] = wide[1], wide[-2]
        views.append(cv2.remap(wide, np.float32(column + 1), np.float32(row + 1), cv2.INTER_LINEAR))
    return np.asarray(np.hstack(views))


def inside() -> Array:
    """Tell which pixels of ball() show it."""
    place = (np.arange(_BALL_PX) + 0.5) / _BALL_PX * 2 - 1
    disc = place[None] ** 2 + place[:, None] ** 2 < 1
    return np.hstack([disc, disc])


def on_screen(radiance: Array, mean: float) -> Array:
    """A ball as sRGB, 0…1, exposed for the room's mean radiance."""
    shown = linear_to_srgb(np.clip(ball(radiance) * _GREY / mean, 0, 1))
    return np.where(inside()[..., None], shown, 0)


def flip(truth: Array, other: Array) -> float:
    """Mean FLIP over the ball's pixels."""
    error, _, _ = flip_evaluator.evaluate(
        np.float32(truth), np.float32(other), "LDR", applyMagma=False
    )
    return float(np.asarray(error).reshape(*truth.shape[:2], -1)[..., 0][inside()].mean())


def map_of(seen: Seen) -> Array:
    """Lamps and reflection map, as sharp as the truth."""
    radiance = np.float32(seen.surroundings().radiance)
    return cv2.resize(radiance, TRUTH_PX, interpolation=cv2.INTER_AREA)


def judge(case: Case) -> list[Balls]:
    """Run the daemon, and compare what balls show with the renders from their places."""
    cv2.setNumThreads(1)
    rendered = furnished_rooms.renders(case.kind, case.seed, COARSE)
    got = record(Run(
        FurnishedRoom(f"{case.kind} {case.seed}", rendered.nodes),
        Behaviour(act_s=0, path=furnished.head_path()), orientation=case.teller,
        size_px=beside_rooms.NODE_PX, rate_hz=beside_rooms.RATE_HZ,
        judged_s=_JUDGED_AT_S + _JUDGED_S - SETTLE_S,
        daemon_arguments=("--reflection-map=64",), wishes=_WISHES,
    ))  # fmt: skip
    distances_m = np.repeat(list(TRUTH_M), list(TRUTH_M.values()))
    means = [float(luminance(one).mean()) for one in rendered.unlit]
    truths = [on_screen(lit, mean) for lit, mean in zip(rendered.lit, means, strict=True)]
    found = []
    for wish, pairs in got.maps.items():
        newest = [p for p in pairs if abs(p[0].captured_s - _JUDGED_AT_S) < _JUDGED_S / 2]
        for pair in newest[::_EVERY]:
            seen = beside_rooms.seen_of(got, *pair)
            unchanged = map_of(seen)
            for k, place_m in enumerate(rendered.places_m):
                both = (unchanged, map_of(seen.at(place_m)))
                errors = [flip(truths[k], on_screen(one, means[k])) for one in both]
                found.append(Mirrored(wish, float(distances_m[k]), *errors))
    return [Balls(case, found)]


def table(some: Sequence[Balls]) -> str:
    """Markdown: a row for each room and app; medians, and in brackets the worst."""
    beside = [d for d in TRUTH_M if d]
    head = [
        "room", "the app sends", "the packet", "at the probe",
        *(f"{d:g} m away: {what}" for d in beside
          for what in ("unchanged", "at the place", "median over that of unchanged")),
    ]  # fmt: skip
    rows = []
    for one, wish in product(some, _WISHES):
        of = {d: [m for m in one.found if (m.wish, m.distance_m) == (wish, d)] for d in TRUTH_M}
        cells = [_cell([m.unchanged for m in of[0.0]])]
        for d in beside:
            unchanged, moved = [m.unchanged for m in of[d]], [m.at_place for m in of[d]]
            share = f"{np.median(moved) / np.median(unchanged):.2f}"
            cells += [_cell(unchanged), _cell(moved), share]
        words = (
            furnished.WORDS[one.case.kind],
            ORIENTATIONS[one.case.teller].words,
            _LISTS[wish],
        )
        rows.append([*words, *cells])
    return recording.markdown(head, rows)


def _cell(values: Sequence[float]) -> str:
    return f"{np.median(values):.3f} ({np.max(values):.3f})"


def main() -> None:
    """Print the table, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kinds", type=recording.listed(KINDS, "kind"), default=list(KINDS),
                        help=f"of rooms, by comma ({','.join(KINDS)})")  # fmt: skip
    parser.add_argument("--tellers", type=recording.listed(tuple(ORIENTATIONS), "teller"),
                        default=list(furnished.TELLERS), help="of apps, by comma")  # fmt: skip
    parser.add_argument("--processes", type=int, default=2, help="runs at a time (2)")
    parser.add_argument("--json", action="store_true", help="figures of each case instead")
    parser.add_argument("--page", action="store_true", help="write docs/users/seen.md")
    options = parser.parse_args()
    for kind in options.kinds:
        furnished_rooms.renders(kind, SEED, COARSE)
    cases = [Case(kind, SEED, teller) for kind, teller in product(options.kinds, options.tellers)]
    some = recording.all_figures(
        "mirror_ball",
        judge,
        cases,
        lambda one: str(asdict(one.case)),
        options.processes,
    )
    some.sort(key=lambda one: cases.index(one.case))
    measured = table(some)
    print(json.dumps([asdict(one) for one in some]) if options.json else measured)
    if options.page:
        put(ROOT / "docs/users/seen.md", {"mirror-ball": measured + "\n"})


if __name__ == "__main__":
    main()
