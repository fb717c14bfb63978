"""Mirror images among lamps: without a polarizer, through films, and told by it.

Rooms are varnished (a floor that mirrors all that is far away, lightprobe.sim.polarized) or glossy
(panes, screens, windows, things at a distance: lightprobe.sim.glossy_rooms). Each reaches the
daemon as floats, or as 8-bit frames of the simulated camera in three exposures (noise, saturation,
JPEG). The tables of docs/users/accuracy.md, or one of other rooms:

    build/venv/bin/python tests/accuracy/polarization.py --page
    build/venv/bin/python tests/accuracy/polarization.py --rooms glossy --first 200 --scenes 10
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path

import glossy
import numpy as np
from lightprobe import geometry
from lightprobe.estimate import Estimate, EstimateFlag, LightFlag
from lightprobe.evaluate import offline
from lightprobe.imaging import camera, image
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.polarizer import Polarizer
from lightprobe.sim.exposure import bracket_us, median_luminance
from lightprobe.sim.glossy_rooms import glossy_room
from lightprobe.sim.polarized import PolishedFloor
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.scene import Scene
from lightprobe.sim.sensor import Sensor, encode_jpeg
from numpy.typing import NDArray
from page import ACCURACY, put
from recording import markdown

SIZE_PX = (960, 480)
ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
EXPOSURES = 3
Radiance = NDArray[np.float32]


@dataclass(frozen=True)
class Count:
    """Lamps and lights of some scenes."""

    lamps: int = 0
    found: int = 0  # lamps listed, and not as reflections
    lost: int = 0  # lamps not listed, or as reflections
    false: int = 0  # lights listed that are no lamps, and not called reflections
    reflections: int = 0  # lights that are no lamps, called reflections
    denied: int = 0  # false ones of known polarization that are surely no reflections, as it says
    total_error: float = 0.0  # relative L2 of the SH of all light, sum over the scenes

    def __add__(self, other: Count) -> Count:
        """Sum of both."""
        names = [field.name for field in fields(Count)]
        return Count(*(getattr(self, name) + getattr(other, name) for name in names))


def count(scene: Scene, estimate: Estimate, truth: Estimate) -> Count:
    """Judge an estimate; `truth`: of the same scene in floats without a film."""
    lamps = [lamp.direction for lamp in scene.lamps]
    pairs = geometry.match_directions(lamps, [light.direction for light in estimate.lights])
    matched = {index for _, index, _ in pairs}
    called = {
        index for index, light in enumerate(estimate.lights) if light.flags & LightFlag.REFLECTION
    }
    others = set(range(len(estimate.lights))) - matched
    lights = [estimate.lights[index] for index in others - called]
    denied = sum(glossy.verdict(light) == glossy.NONE for light in lights)
    found = len(matched - called)
    total, expected = estimate.total().coefficients, truth.total().coefficients
    error = float(np.linalg.norm(total - expected) / np.linalg.norm(expected))
    return Count(
        len(lamps),
        found,
        len(lamps) - found,
        len(others - called),
        len(others & called),
        denied,
        error,
    )


class Studio:
    """Views of a scene through films, as files."""

    def __init__(self, scene: Scene, kind: str) -> None:
        """`kind`: float or 8-bit."""
        size_px = SIZE_PX
        lens = camera.load("equirect")
        self.sheet = Sheet()
        self._film = Polarizer(self.sheet, lens, size_px)
        self._ideal = Polarizer(Sheet(1.0, 1e9, index=1.0), lens, size_px)
        layers, powers = scene.render(*size_px), np.ones(len(scene.lamps))
        self._radiance = layers.compose(powers)
        self._polarized = layers.compose_polarized(powers)
        self._sensor = Sensor(*size_px) if kind == "8-bit" else None

    def bare(self) -> list[Radiance]:
        """No film."""
        return [self._radiance]

    def sheet_at(self, *angles_deg: float) -> list[Radiance]:
        """Behind one real sheet, at each angle."""
        return [
            self._film.through(self._radiance, self._polarized, (angle,)) for angle in angles_deg
        ]

    def films(self) -> list[Radiance]:
        """The published stack: vertical, 45°, horizontal; one polarizer and two stops less."""
        behind = self._ideal.through(self._radiance, self._polarized, (90,))
        return [np.asarray(behind / 4, np.float32)]

    def estimate(self, views: Sequence[Radiance], settings: offline.Settings) -> Estimate:
        """Light by the daemon; each view in three exposures where they are 8-bit."""
        with tempfile.TemporaryDirectory(prefix="lightprobe-") as name:
            exposures_us = self._write(views, Path(name))
            repeated = EXPOSURES if exposures_us else 1
            angles = tuple(np.repeat(settings.wheel_deg, repeated).tolist())
            chosen = replace(settings, preset="balanced", wheel_deg=angles, area_lights=True)
            return offline.estimate_folder(Path(name), exposures_us, chosen)

    def _write(self, views: Sequence[Radiance], folder: Path) -> list[float]:
        if self._sensor is None:
            for index, view in enumerate(views):
                image.write_pfm(folder / f"{index:04}.pfm", np.ascontiguousarray(view))
            return []
        exposures_us = bracket_us(median_luminance(views[0]), EXPOSURES)
        for index, view in enumerate(views):
            for step, exposure_us in enumerate(exposures_us):
                number = index * EXPOSURES + step
                codes = self._sensor.capture(view, exposure_us, frame=number)
                (folder / f"{number:04}.jpg").write_bytes(encode_jpeg(codes))
        return exposures_us * len(views)


Way = Callable[[Studio], tuple[list[Radiance], offline.Settings]]
_PLAIN = offline.Settings()
SWEPT, TURNED = "0°, 45°, 90°, 135°", "film put in 90° wrong"
#: How a scene is looked at.
WAYS: dict[str, Way] = {
    "no film": lambda studio: (studio.bare(), _PLAIN),
    "three films (published)": lambda studio: (studio.films(), _PLAIN),
    "one film at 90°": lambda studio: (studio.sheet_at(90), _PLAIN),
    SWEPT: lambda studio: (
        studio.sheet_at(*ANGLES_DEG), offline.Settings(wheel_deg=ANGLES_DEG)
    ),
    "0°, 60°, 120°": lambda studio: (
        studio.sheet_at(0, 60, 120), offline.Settings(wheel_deg=(0, 60, 120))
    ),
    TURNED: lambda studio: (
        studio.sheet_at(90, 135, 0, 45), offline.Settings(wheel_deg=ANGLES_DEG)
    ),
}  # fmt: skip


def ways_of(kind: str) -> list[str]:
    """Frames of a camera take longer: of them only what matters most."""
    return list(WAYS) if kind == "float" else [list(WAYS)[index] for index in (0, 1, 3)]


@dataclass(frozen=True)
class Named:
    """In how many rooms FILM_TURNED was said."""

    turned: int = 0  # of the film put in 90° wrong
    right: int = 0

    def __add__(self, other: Named) -> Named:
        """Sum of both."""
        return Named(self.turned + other.turned, self.right + other.right)


Figures = tuple[dict[str, Count], Named]


def judge(kind: str, seed: int) -> Figures:
    """Every way for one varnished room."""
    scene = PolishedFloor(random_scene(seed))
    truth_studio = Studio(scene, "float")
    truth = truth_studio.estimate(truth_studio.bare(), _PLAIN)
    studio = truth_studio if kind == "float" else Studio(scene, kind)
    counts, named = {}, Named()
    for name in ways_of(kind):
        estimate = studio.estimate(*WAYS[name](studio))
        counts[name] = count(scene, estimate, truth)
        if estimate.flags & EstimateFlag.FILM_TURNED:
            named += Named(1, 0) if name == TURNED else Named(0, 1)
    print(f"polarization: {scene.name} {kind}: done", file=sys.stderr)
    return counts, named


def figures(kind: str, seeds: Sequence[int], processes: int) -> Figures:
    """Sum over varnished rooms."""
    with ProcessPoolExecutor(processes) as pool:
        found = list(pool.map(partial(judge, kind), seeds))
    sums = {name: sum((counts[name] for counts, _ in found), Count()) for name in ways_of(kind)}
    return sums, sum((named for _, named in found), Named())


HEAD = [
    "input", "film", "lamps listed", "false lamps listed", "reflections named",
    "reflections called none", "TOTAL off by, mean",
]  # fmt: skip


def table(found: dict[str, Figures], rooms: int) -> str:
    """Rows of Markdown by kind of input, and what was said of the film."""
    rows, words = [], []
    for kind, (sums, named) in found.items():
        rows += [
            [kind, name, f"{one.found} of {one.lamps}", f"{one.false}", f"{one.reflections}",
             f"{one.denied}", f"{one.total_error / rooms:.3f}"]
            for name, one in sums.items()
        ]  # fmt: skip
        if TURNED in sums:
            words.append(
                f"The film put in 90° wrong was named in {named.turned} of {rooms} rooms ({kind}); "
                f"where it was right, in {named.right}."
            )
        else:
            words.append(f"Where the film was right, FILM_TURNED was said in {named.right} rooms "
                         f"({kind}).")  # fmt: skip
    return "\n\n".join([markdown(HEAD, rows), " ".join(words)])


def judge_glossy(kind: str, seed: int) -> glossy.Found:
    """One glossy room, from four angles."""
    room = glossy_room(seed)
    studio = Studio(room, kind)
    estimate = studio.estimate(*WAYS[SWEPT](studio))
    print(f"polarization: {room.name} {kind}: done", file=sys.stderr)
    return glossy.found(room, [estimate])


def glossy_figures(kind: str, seeds: Sequence[int], processes: int) -> glossy.Found:
    """Sum over glossy rooms."""
    with ProcessPoolExecutor(processes) as pool:
        return sum(pool.map(partial(judge_glossy, kind), seeds), glossy.Found(Counter()))


def measure(rooms: str, kinds: Sequence[str], seeds: Sequence[int], processes: int) -> str:
    """Give the table of one set of rooms."""
    if rooms == "glossy":
        return glossy.table({kind: glossy_figures(kind, seeds, processes) for kind in kinds})
    return table({kind: figures(kind, seeds, processes) for kind in kinds}, len(seeds))


#: What the page shows, by mark. Constants were chosen on the first rooms; the others are unseen.
PARTS = {
    "polarization": ("varnished", range(40)),
    "polarization-unseen": ("varnished", range(100, 140)),
    "polarization-glossy": ("glossy", range(200, 240)),
}


def main() -> None:
    """Measure, and print or write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rooms", choices=("varnished", "glossy"), default="varnished")
    parser.add_argument("--first", type=int, default=0, help="number of the first room")
    parser.add_argument("--scenes", type=int, default=40, help="how many rooms")
    parser.add_argument("--inputs", default="float,8-bit", help="float, 8-bit or both")
    parser.add_argument("--processes", type=int, default=2, help="rooms at a time")
    parser.add_argument("--page", action="store_true", help="write docs/users/accuracy.md")
    options = parser.parse_args()
    kinds = options.inputs.split(",")
    if options.page:
        for name, (rooms, seeds) in PARTS.items():
            put(ACCURACY, {name: measure(rooms, kinds, seeds, options.processes)})
        return
    seeds = range(options.first, options.first + options.scenes)
    print(measure(options.rooms, kinds, seeds, options.processes))


if __name__ == "__main__":
    main()
