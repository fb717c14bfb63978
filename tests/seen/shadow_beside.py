"""The six elevations of shadow.py once more, with rods beside a probe that moves: end to end.

In each scene one lamp hangs in a room with pictures on its walls, as high as the research's, 2.5 m
from the middle of a head's way. The head goes half a metre and looks around; an app sends its poses
with errors that last. Rods stand towards the lamp and away from it, where unchanged light is most
wrong. All of it is simulated, in simulated time: no load changes a figure.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/accuracy"))
import recording  # noqa: E402
from judge import Packet  # noqa: E402
from lightprobe import geometry  # noqa: E402
from lightprobe.estimate import Estimate, Light  # noqa: E402
from lightprobe.geometry import Array  # noqa: E402
from lightprobe.sim.motion import Track  # noqa: E402
from lightprobe.sim.room import Bulb, Room  # noqa: E402
from lightprobe.sim.world import Behaviour  # noqa: E402
from moving import head_path  # noqa: E402
from page import put  # noqa: E402
from recording import ORIENTATIONS, Run, record  # noqa: E402
from shadow import AZIMUTHS_DEG, ELEVATIONS_DEG, LAMP_M, RADIUS_DEG, RODS_M  # noqa: E402

PAGE = ROOT / "docs/users/seen.md"
TELLERS = ("place", "place-bad")
#: Largest error, RMS in degrees, by the rod's distance and by TELLERS: what is aimed at.
BOUNDS_DEG = {0.3: (0.4, 0.8), 0.5: (0.5, 1.0), 1.0: (0.7, 1.4)}
#: Number of head_path(): it turns at 42° a second (RMS) while it is judged; 0 does at 21°.
WAY = 100
#: The middle of the head's way in the simulated room: low, so that the highest lamp has room.
_MIDDLE_M = np.array([-0.2, -0.95, -0.4])
_RADIANCE = (130.0, 115.0, 90.0)
_NEAR_DEG = 5.0
_JUDGED_S, _NEWEST_S, _EVERY = 10.0, 1.0, 5
_SIZE_PX, _RATE_HZ = (640, 320), 15.0


@dataclass(frozen=True)
class Case:
    """Which lamp, which way of the head, and what the app sends."""

    scene: int
    path: int  # of head_path()
    teller: str


@dataclass(frozen=True)
class Beside:
    """Errors of a case's shadows, degrees: a row for each packet, a column for each of RODS_M."""

    case: Case
    unchanged_deg: list[list[float]]
    at_place_deg: list[list[float]]


def _lamp_m(scene: int) -> Array:
    """Where the lamp hangs, from the middle of the way."""
    return LAMP_M * geometry.direction_from_angles(AZIMUTHS_DEG[scene], ELEVATIONS_DEG[scene])


def _room(case: Case) -> Room:
    x, y, z = (_lamp_m(case.scene) + _MIDDLE_M).tolist()
    radius_m = LAMP_M * float(np.sin(np.radians(RADIUS_DEG)))
    return Room(bulbs=(Bulb((x, y, z), radius_m, _RADIANCE),), pictures=1 + case.scene)


def _path(number: int) -> Track:
    """Give a head's way around the middle, which begins there."""
    found = head_path(number)
    return replace(found, places_m=found.places_m + _MIDDLE_M)


def judge(case: Case) -> list[Beside]:
    """Run the daemon, and compare shadows of its newest packets with the truth."""
    got = record(Run(
        _room(case), Behaviour(act_s=0, path=_path(case.path)), judged_s=_JUDGED_S,
        orientation=case.teller, size_px=_SIZE_PX, rate_hz=_RATE_HZ,
    ))  # fmt: skip
    packets = got.packets["raw"]
    newest = [one for one in packets if one.captured_s > packets[-1].captured_s - _NEWEST_S]
    found = Beside(case, [], [])
    for packet in newest[::_EVERY]:
        here_m = np.array(got.world.at(packet.captured_s).place_m) - _MIDDLE_M
        unchanged, moved = _errors(packet, _lamp_m(case.scene) - here_m)
        found.unchanged_deg.append(unchanged)
        found.at_place_deg.append(moved)
    return [found]


def _errors(packet: Packet, lamp_m: Array) -> tuple[list[float], list[float]]:
    """Errors by RODS_M, the larger one of both sides: unchanged, and at the place."""
    light = _listed(packet.estimate, lamp_m)
    level = geometry.normalize(lamp_m * [1, 0, 1])
    unchanged, moved = [], []
    for rod_m in RODS_M:
        of_sides = []
        for place_m in (rod_m * level, -rod_m * level):
            x, height, z = lamp_m - place_m
            true = float(np.degrees(np.arctan2(height, np.hypot(x, z))))
            there = next(o for o in packet.estimate.at(place_m).lights if o.id == light.id)
            of_sides.append([abs(o.elevation_deg - true) for o in (light, there)])
        first, second = np.max(of_sides, axis=0)
        unchanged.append(float(first))
        moved.append(float(second))
    return unchanged, moved


def _listed(estimate: Estimate, lamp_m: Array) -> Light:
    """Give the light that is the lamp; packets are in the room's axes."""
    off_deg = [float(geometry.angle_deg(one.direction, lamp_m)) for one in estimate.lights]
    nearest = int(np.argmin(off_deg))
    assert off_deg[nearest] < _NEAR_DEG, f"the lamp is not listed: {off_deg}"
    return estimate.lights[nearest]


def _rms(rows: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(np.square(rows), axis=0)))


def table(some: Sequence[Beside], tellers: Sequence[str]) -> str:
    """Markdown: root mean squares, in brackets the worst of a case; then each scene's."""
    head = ["light of the rod", *(f"rod {d:g} m from the probe" for d in RODS_M)]
    rows = []
    for teller in tellers:
        group = [one for one in some if one.case.teller == teller]
        words = ORIENTATIONS[teller].words
        for what, name in (
            ("unchanged", "unchanged_deg"),
            ("at the place", "at_place_deg"),
        ):
            each = np.array([_rms(np.array(getattr(one, name))) for one in group])
            cells = zip(_rms(each), each.max(axis=0), strict=True)
            rows.append([f"{words}: {what}", *(f"{a:.2f}° ({b:.2f}°)" for a, b in cells)])
        for scene, elevation in enumerate(ELEVATIONS_DEG):
            of_scene = [one.at_place_deg for one in group if one.case.scene == scene]
            cells = [f"{value:.2f}°" for value in _rms(np.concatenate(of_scene))]
            rows.append([f"{words}: at the place, lamp {elevation:.2f}° high", *cells])
    for number, teller in enumerate(TELLERS):
        bounds = [f"{BOUNDS_DEG[d][number]:g}°" if d else "" for d in RODS_M]
        rows.append([f"aimed at, {ORIENTATIONS[teller].words}", *bounds])
    return recording.markdown(head, rows)


def main() -> None:
    """Print the table, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--paths",
        type=lambda text: [int(one) for one in text.split(",")],
        default=[WAY],
        help=f"of the head, by comma ({WAY})",
    )
    parser.add_argument("--tellers", type=recording.listed(tuple(ORIENTATIONS), "teller"),
                        default=list(TELLERS), help="what apps send, by comma")  # fmt: skip
    parser.add_argument("--scenes", type=int, default=len(ELEVATIONS_DEG), help="lamps (6)")
    parser.add_argument("--processes", type=int, default=2, help="runs at a time (2)")
    parser.add_argument("--json", action="store_true", help="the errors of each case instead")
    parser.add_argument("--page", action="store_true", help="write docs/users/seen.md")
    options = parser.parse_args()
    cases = [Case(*one) for one in product(range(options.scenes), options.paths, options.tellers)]
    some = recording.all_figures(
        "shadow_beside",
        judge,
        cases,
        lambda one: str(asdict(one.case)),
        options.processes,
    )
    some.sort(key=lambda one: cases.index(one.case))
    if options.json:
        print(json.dumps([asdict(one) for one in some], indent=1))
    measured = table(some, options.tellers)
    print(measured, file=sys.stderr if options.json else sys.stdout)
    if options.page:
        put(PAGE, {"shadow-beside": measured + "\n"})


if __name__ == "__main__":
    main()
