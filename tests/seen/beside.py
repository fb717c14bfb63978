"""`make seen-beside`: AR pictures of an object that stands beside a probe that moves.

As seen.py, but the object stands 0.3, 0.5 and 1 m beside the middle of a head's way. Its light is
the packet unchanged, or `at(position)` of packet and reflection map; beside these, the packet of a
probe that stands at the object's place, and the exact light there. Writes a part of
docs/users/seen.md and its pictures.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import beside_rooms as rooms
import composite
import cv2
import numpy as np
import room
from ambient import NORMALS, irradiance
from beside_rooms import DISTANCES_M, SPOTS, TELLERS, Seen, Spot
from composite import Surroundings
from lightprobe.geometry import Array
from page import put
from recording import ORIENTATIONS, listed, markdown
from seen import ROOT, Cache, Figure, Quality, compare, on_screen

STILL, EXACT = "a probe at the object's place", "exact light"
UNCHANGED, AT = "a probe beside it: unchanged", "a probe beside it: at the place"
#: FLIP at the place is to be at most so many times that of a probe there, 0.5 m beside.
BOUND = 1.1
#: Of room.MATERIALS: the dullest, one between, and a mirror.
MATERIALS = ["chalk", "brushed metal", "chrome"]
_DEFAULT = Quality(64, 12, 48)
_EXACT_SAMPLES = 16


def _method(what: str, teller: str) -> str:
    return f"{what} ({ORIENTATIONS[teller].words.split(', ', 1)[1]})"


def _alone(method: str) -> str:
    return f"{method}; lamps and SH alone"


MAPPED = (
    STILL, _method(UNCHANGED, TELLERS[0]), *(_method(AT, teller) for teller in TELLERS),
)  # fmt: skip
#: Those that are drawn by lamps and SH alone, too.
PLAIN = MAPPED[:3]
METHODS = (*MAPPED, EXACT, *map(_alone, PLAIN))


@dataclass(frozen=True, eq=False)
class Case:
    """One run of the daemon: before the panoramas of a head's way, or before a single one."""

    spot: Spot
    panoramas: Array
    teller: str | None = None  # None: it stands still


def run(case: Case) -> Seen:
    """What the probe says."""
    if case.teller is None:
        return rooms.still(case.panoramas)
    return rooms.moving(case.spot, case.panoramas, case.teller)


def packets(cache: Cache, spot: Spot, quality: Quality) -> dict[str | float, Seen]:
    """By what the app sends, the probe that moves; by distance, one that stands there."""
    way = cache.get(f"{spot.name}: nodes", lambda: rooms.nodes(spot, quality.panorama))
    cases: dict[str | float, Case] = {teller: Case(spot, way, teller) for teller in TELLERS}
    cases |= {distance_m: Case(spot, exact(cache, spot, distance_m)) for distance_m in DISTANCES_M}
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        found = dict(zip(cases, pool.map(run, cases.values(), chunksize=1), strict=True))
    for name, one in found.items():
        lamps = ", ".join(
            f"{light.angular_radius_deg:.1f}° {light.distance_m or np.nan:.2f} m"
            for light in one.estimate.lights
        )
        print(
            f"seen-beside: {spot.name}: {name}: {lamps}; {_room_words(one)}",
            file=sys.stderr,
        )
    return found


def _room_words(one: Seen) -> str:
    around = one.estimate.room
    if around is None:
        return "no box"
    return f"walls {np.round(around.walls_m, 2)} m, error {around.error_per_m:g} for each metre"


def exact(cache: Cache, spot: Spot, distance_m: float) -> Array:
    """The panorama at the object's place."""
    return cache.get(
        f"{spot.name}: exact {distance_m:g} m",
        lambda: rooms.exact(spot, distance_m, _EXACT_SAMPLES),
    )


def lights_of(
    cache: Cache, spot: Spot, distance_m: float, said: dict[str | float, Seen]
) -> dict[str, Surroundings]:
    """What lights the object, by method."""
    object_m = spot.object_m(distance_m)
    seen = {STILL: said[distance_m], _method(UNCHANGED, TELLERS[0]): said[TELLERS[0]]}
    seen |= {_method(AT, teller): said[teller].at(object_m) for teller in TELLERS}
    small = cv2.resize(exact(cache, spot, distance_m), (1024, 512), interpolation=cv2.INTER_LINEAR)
    lights = {method: one.surroundings() for method, one in seen.items()}
    lights |= {_alone(name): composite.by_harmonics(seen[name].estimate) for name in PLAIN}
    return lights | {EXACT: Surroundings(small)}


def pictures_of(
    cache: Cache, spot: Spot, distance_m: float, said: dict[str | float, Seen],
    materials: Sequence[str], quality: Quality,
) -> dict[tuple[str, str], Array]:  # fmt: skip
    """Pictures on a screen by material and method; method "truth": of the room with the object."""
    parts, name = room.room(spot.place(distance_m)), f"{spot.name}: {distance_m:g} m"
    empty = cache.get(
        f"{name}: empty", lambda: room.render(parts, room.eye(), quality.truth, 1)
    ).astype(float)
    lights = lights_of(cache, spot, distance_m, said)
    shadows = {method: composite.table_ratio(one, quality.drawn) for method, one in lights.items()}
    found = {}
    for material in materials:
        thing = room.thing(room.MATERIALS[material])
        truth = cache.get(
            f"{name}: {material}",
            lambda thing=thing: room.render(
                parts | {"object": thing}, room.eye(), quality.truth, 1
            ),
        )
        found[material, "truth"] = on_screen(truth, empty)
        for method, one in lights.items():
            drawn = composite.draw_object(one, room.MATERIALS[material], quality.drawn)
            picture = composite.into_picture(empty, shadows[method], drawn)
            found[material, method] = on_screen(picture, empty)
    return found


def irradiance_errors(
    cache: Cache, spot: Spot, distance_m: float, said: dict[str | float, Seen]
) -> dict[str, float]:
    """Mean error over all normals, of the largest true irradiance, where exact() was rendered."""
    true = irradiance(exact(cache, spot, distance_m))
    there_m = spot.object_m(distance_m, room.PROBE_M[1])
    seen = {STILL: said[distance_m], _method(UNCHANGED, TELLERS[0]): said[TELLERS[0]]}
    seen |= {_method(AT, teller): said[teller].at(there_m) for teller in TELLERS}
    return {
        f"{method}: {what}": float(np.abs(found - true).mean() / true.max())
        for method, one in seen.items() for what, found in one.irradiance(NORMALS).items()
    }  # fmt: skip


def irradiance_table(errors: dict[tuple[str, float], dict[str, float]]) -> str:
    """Markdown: mean over the spots, and in brackets the worst."""
    rows = []
    for method in next(iter(errors.values())):
        cells = []
        for distance_m in DISTANCES_M:
            each = [one[method] for (_, d), one in errors.items() if d == distance_m]
            cells.append(f"{np.mean(each):.3f} ({np.max(each):.3f})")
        rows.append([method, *cells])
    head = ["error of irradiance (worst spot)", *(f"{d:g} m beside the probe" for d in DISTANCES_M)]
    return markdown(head, rows)


@dataclass
class Measured:
    """What came of all spots."""

    figures: list[tuple[float, Figure]]  # with the object's distance
    sheets: dict[str, Array]  # pictures
    errors: dict[tuple[str, float], dict[str, float]]  # of irradiance, by spot and distance


def measured(
    quality: Quality, spots: Sequence[Spot], materials: Sequence[str], folder: Path
) -> Measured:
    """All figures, and a sheet of pictures for each spot and distance."""
    cache, found = Cache(folder, quality), Measured([], {}, {})
    for spot in spots:
        rooms.furnished_rooms.mitsuba()
        said = packets(cache, spot, quality)
        for distance_m in DISTANCES_M:
            print(
                f"seen-beside: {spot.name}: {distance_m:g} m",
                file=sys.stderr,
                flush=True,
            )
            pictures = pictures_of(cache, spot, distance_m, said, materials, quality)
            for material in materials:
                for method in METHODS:
                    numbers = compare(pictures[material, "truth"], pictures[material, method])
                    one = Figure(spot.name, material, method, *numbers)
                    found.figures.append((distance_m, one))
            found.sheets[f"{spot.name} {distance_m:g} m"] = sheet(pictures, materials)
            found.errors[spot.name, distance_m] = irradiance_errors(cache, spot, distance_m, said)
    return found


def sheet(pictures: dict[tuple[str, str], Array], materials: Sequence[str]) -> Array:
    """All pictures of an object's place: a row for each material, a column for each method."""
    rows = []
    for material in materials:
        row = [pictures[material, column] for column in ("truth", *MAPPED, EXACT)]
        rows.append(np.hstack([np.pad(one, ((2, 2), (2, 2), (0, 0))) for one in row]))
    return np.vstack(rows)


def mean_flip(
    figures: Sequence[tuple[float, Figure]],
    method: str,
    distance_m: float,
    spot: str | None = None,
) -> float:
    """Mean over materials, and over the spots unless one is named."""
    return float(np.mean([
        one.flip for d, one in figures
        if (d, one.method) == (distance_m, method) and spot in (None, one.place)
    ]))  # fmt: skip


def table(figures: Sequence[tuple[float, Figure]]) -> str:
    """Markdown: mean FLIP, and in brackets that of the worst spot; then against a probe there."""
    spots = list(dict.fromkeys(one.place for _, one in figures))
    rows = []
    for method in METHODS:
        cells = []
        for distance_m in DISTANCES_M:
            worst = max(mean_flip(figures, method, distance_m, spot) for spot in spots)
            cells.append(f"{mean_flip(figures, method, distance_m):.3f} ({worst:.3f})")
        rows.append([method, *cells])
    for method in MAPPED[1:]:
        rows.append([f"{method}: over that of a probe there", *_over(figures, method, STILL)])
    rows += [
        [f"{_alone(method)}: over that of a probe there",
         *_over(figures, _alone(method), _alone(STILL))]
        for method in PLAIN[1:]
    ]  # fmt: skip
    rows.append(["aimed at", "", f"{BOUND:.2f}", ""])
    head = [
        "mean FLIP (worst spot)",
        *(f"object {d:g} m beside the probe" for d in DISTANCES_M),
    ]
    return markdown(head, rows)


def _over(figures: Sequence[tuple[float, Figure]], method: str, other: str) -> list[str]:
    spots = list(dict.fromkeys(one.place for _, one in figures))
    cells = []
    for d in DISTANCES_M:
        mean, *each = (
            mean_flip(figures, method, d, spot) / mean_flip(figures, other, d, spot)
            for spot in (None, *spots)
        )
        cells.append(f"{mean:.2f} ({max(each):.2f})")
    return cells


def main() -> None:
    """Measure, and write the page's part."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print all figures; write no page")
    parser.add_argument("--quick", action="store_true", help="few samples; write no page")
    parser.add_argument("--spots", type=listed([one.name for one in SPOTS], "spot"),
                        default=[one.name for one in SPOTS], help="by comma")  # fmt: skip
    parser.add_argument("--materials", type=listed(tuple(room.MATERIALS), "material"),
                        default=MATERIALS, help="by comma")  # fmt: skip
    options = parser.parse_args()
    quality = Quality(16, 4, 16) if options.quick else _DEFAULT
    spots = [one for one in SPOTS if one.name in options.spots]
    got = measured(quality, spots, options.materials, ROOT / "build/seen")
    if options.json:
        print(json.dumps([{"distance_m": d} | vars(one) for d, one in got.figures], indent=2))
    names = ", ".join(spot.name for spot in spots)
    text = f"{table(got.figures)}\n\n{irradiance_table(got.errors)}\n\nSpots: {names}.\n"
    print(text, file=sys.stderr)
    shown = options.json or options.quick
    out = Path(tempfile.mkdtemp()) if shown else ROOT / "docs/users"
    for name, picture in got.sheets.items():
        if shown or name.endswith(" 0.5 m"):
            file = out / f"seen_beside_{name.removesuffix(' 0.5 m').replace(' ', '_')}.jpg"
            codes = np.uint8(np.rint(255 * picture[..., ::-1]))
            cv2.imwrite(str(file), codes, [cv2.IMWRITE_JPEG_QUALITY, 88])
            print(f"written: {file}", file=sys.stderr)
    if not shown:
        put(ROOT / "docs/users/seen.md", {"beside": text})


if __name__ == "__main__":
    main()
