"""`make seen`: what users see, measured. A real object in a room beside AR pictures of it.

Mitsuba renders the room with the object (the truth) and without it. A simulated camera stands at
the object's place in the empty room, the daemon measures the light from its frames, and its packet
lights the object in an AR picture. Writes the tables of docs/users/seen.md and its pictures.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import composite
import cv2
import flip_evaluator
import in_shadow
import numpy as np
import probe
import room
import shadow
import study
import updates
from composite import Surroundings
from lightprobe.colour import linear_to_srgb
from lightprobe.geometry import Array

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/accuracy"))
from page import put  # noqa: E402

#: Mean of the empty place's picture on the screen, linear.
_GREY = 0.35
NO_SHADOW, PHONE, PACKET = "no shadow", "main light and ambient", "packet: lamps and SH"
AREAS, MAP = "… with area lights", "… with reflection map"
LOCAL, BOTH = "… with local sampling", "… with reflection map and local sampling"
EXACT = "exact light"
METHODS = (NO_SHADOW, PHONE, PACKET, AREAS, MAP, LOCAL, BOTH, EXACT)


@dataclass(frozen=True)
class Quality:
    """Samples per pixel."""

    truth: int = 128
    panorama: int = 24
    drawn: int = 96


@dataclass(frozen=True)
class Figure:
    """How far an AR picture is from the truth, on a screen."""

    place: str
    material: str
    method: str
    rmse: float
    flip: float


class Cache:
    """Renders of the room that a run before has made; a change of samples makes them anew."""

    def __init__(self, folder: Path, quality: Quality) -> None:
        self._folder = folder
        self._samples = f"{quality.truth}-{quality.panorama}-{quality.drawn}"
        folder.mkdir(parents=True, exist_ok=True)

    def get(self, name: str, make: Callable[[], Array]) -> Array:
        """Load it, or make and keep it."""
        file = self._folder / f"{name.replace(' ', '_')}-{self._samples}.npy"
        if not file.exists():
            print(f"seen: {name}", file=sys.stderr, flush=True)
            np.save(file, make().astype(np.float32))
        return np.load(file)


def despeckled(picture: Array) -> Array:
    """Without lone bright pixels: light that few random paths find, as through a ball of glass."""
    median = np.stack([cv2.medianBlur(np.float32(picture[..., c]), 3) for c in range(3)], axis=-1)
    lone = picture.mean(axis=-1) > 2.5 * median.mean(axis=-1) + 1e-3
    return np.where(lone[..., None], median, picture)


def on_screen(picture: Array, empty: Array) -> Array:
    """As sRGB, 0…1, exposed for the empty place."""
    return np.asarray(linear_to_srgb(np.clip(despeckled(picture) * _GREY / empty.mean(), 0, 1)))


def compare(truth: Array, other: Array) -> tuple[float, float]:
    """RMSE and mean FLIP of two pictures of a screen."""
    rmse = float(np.sqrt(((truth - other) ** 2).mean()))
    _, flip, _ = flip_evaluator.evaluate(np.float32(truth), np.float32(other), "LDR")
    return rmse, float(flip)


def lights_of(
    cache: Cache, place: room.Place, quality: Quality, empty: Array
) -> dict[str, Surroundings]:
    """What lights the object, by method."""
    panorama = cache.get(f"{place.name}: panorama", lambda: room.panorama(place, quality.panorama))
    packet = probe.measure(panorama)
    harmonics = composite.by_harmonics(packet.estimate)
    areas = composite.by_harmonics(packet.areas)
    mapped = composite.by_reflection_map(packet.estimate, packet.ambient)
    exact = cv2.resize(panorama, (1024, 512), interpolation=cv2.INTER_AREA)
    print(f"seen: {place.name}: {packet.summary}", file=sys.stderr, flush=True)
    return {
        NO_SHADOW: mapped, PHONE: composite.as_phones_tell(panorama), PACKET: harmonics,
        AREAS: areas, MAP: mapped, LOCAL: composite.with_ground(harmonics, empty, packet.total),
        BOTH: composite.with_ground(mapped, empty, packet.total), EXACT: Surroundings(exact),
    }  # fmt: skip


def pictures_of(
    cache: Cache, place: room.Place, materials: list[str], quality: Quality
) -> dict[tuple[str, str], Array]:
    """Pictures on a screen by material and method; method "truth": of the room with the object."""
    parts = room.room(place)
    empty = cache.get(
        f"{place.name}: empty", lambda: room.render(parts, room.eye(), quality.truth, 1)
    ).astype(float)
    lights = lights_of(cache, place, quality, empty)
    shadows = {
        method: composite.table_ratio(lights[method], quality.drawn)
        for method in (PHONE, PACKET, AREAS, MAP, EXACT)
    }
    # Local sampling is for reflections alone.
    shadows |= {LOCAL: shadows[PACKET], BOTH: shadows[MAP]}
    found = {}
    for material in materials:
        thing = room.thing(room.MATERIALS[material])
        # The same random numbers as without it: where it changes nothing, noise does not either.
        truth = cache.get(
            f"{place.name}: {material}",
            lambda thing=thing: room.render(
                parts | {"object": thing}, room.eye(), quality.truth, 1
            ),
        )
        found[material, "truth"] = on_screen(truth, empty)
        for method in METHODS:
            drawn = composite.draw_object(lights[method], room.MATERIALS[material], quality.drawn)
            ratio = 1.0 if method == NO_SHADOW else shadows[method]
            found[material, method] = on_screen(composite.into_picture(empty, ratio, drawn), empty)
    return found


def sheet(pictures: dict[tuple[str, str], Array], materials: list[str]) -> Array:
    """All pictures of a place: a row for each material, a column for the truth and each method."""
    rows = []
    for material in materials:
        row = [pictures[material, column] for column in ("truth", *METHODS)]
        rows.append(np.hstack([np.pad(one, ((2, 2), (2, 2), (0, 0))) for one in row]))
    return np.vstack(rows)


def table(figures: list[Figure], materials: list[str], what: str) -> str:
    """Markdown: the mean over the places, by method and material."""
    head = ["", *materials, "mean"]
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for method in METHODS:
        means = [
            np.mean([getattr(f, what) for f in figures if (f.method, f.material) == (method, m)])
            for m in materials
        ]
        numbers = [f"{value:.3f}" for value in [*means, np.mean(means)]]
        lines.append(f"| {method} | {' | '.join(numbers)} |")
    return "\n".join(lines)


def measured(
    quality: Quality, places: list[room.Place], materials: list[str], folder: Path
) -> tuple[list[Figure], dict[str, Array]]:
    """All figures, and a sheet of pictures for each place."""
    cache, figures, sheets = Cache(folder, quality), [], {}
    for place in places:
        pictures = pictures_of(cache, place, materials, quality)
        for material in materials:
            for method in METHODS:
                numbers = compare(pictures[material, "truth"], pictures[material, method])
                figures.append(Figure(place.name, material, method, *numbers))
        sheets[place.name] = sheet(pictures, materials)
    return figures, sheets


def answers(figures: list[Figure]) -> str:
    """What the tables say of the two questions."""

    def mean(method: str, *materials: str) -> float:
        chosen = [
            one.flip
            for one in figures
            if one.method == method and (not materials or one.material in materials)
        ]
        return float(np.mean(chosen))

    def lower(method: str) -> str:
        return f"{mean(method):.3f} ({100 * (1 - mean(method) / mean(PHONE)):.0f} % lower)"

    def by_kind(name: str, *materials: str) -> str:
        words = (
            (AREAS, "area lights"), (MAP, "reflection map"), (LOCAL, "local sampling"),
            (BOTH, "both"),
        )  # fmt: skip
        return f"- {name}: " + ", ".join(
            f"{word} {mean(method, *materials):.3f}" for method, word in words
        )

    return "\n".join((
        "- Mean FLIP, five materials, three places: one main light and ambient "
        f"{mean(PHONE):.3f}; the packet, lamps and SH as by default, {lower(PACKET)}; with area "
        f"lights {lower(AREAS)}; with reflection map {lower(MAP)}; with that and local sampling "
        f"{lower(BOTH)}; exact light {lower(EXACT)}.",
        by_kind("Glass", "glass") + ".",
        by_kind("Metal (brushed, chrome)", "brushed metal", "chrome") + ".",
    ))  # fmt: skip


def main() -> None:
    """Measure, and write the page's parts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print all figures; write no page")
    parser.add_argument("--quick", action="store_true", help="few samples; write no page")
    options = parser.parse_args()
    quality = Quality(16, 4, 16) if options.quick else Quality()
    materials = list(room.MATERIALS)
    figures, sheets = measured(quality, list(room.PLACES), materials, ROOT / "build/seen")
    if options.json:
        print(json.dumps([vars(figure) for figure in figures], indent=2))
    parts = {what: table(figures, materials, what) for what in ("flip", "rmse")}
    parts["answers"] = answers(figures)
    parts["shadow"] = shadow.table(shadow.measured())
    parts["updates"] = updates.table(updates.measured())
    print("\n\n".join(parts.values()), file=sys.stderr)
    out = Path(tempfile.mkdtemp()) if options.json or options.quick else ROOT / "docs/users"
    for name, picture in sheets.items():
        file = out / f"seen_{name.replace(' ', '_')}.jpg"
        codes = np.uint8(np.rint(255 * picture))
        cv2.imwrite(str(file), codes[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
        print(f"written: {file}", file=sys.stderr)
    if not (options.json or options.quick):
        put(study.PAGE, parts)
        put(study.PAGE, in_shadow.parts())
        whole = {name: np.uint8(np.rint(255 * picture)) for name, picture in sheets.items()}
        study.write(study.OUT, whole)


if __name__ == "__main__":
    main()
