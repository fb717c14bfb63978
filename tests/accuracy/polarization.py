"""False lamps in rooms with a varnished floor: without a polarizer, through films, and told by it.

Each scene is rendered with its mirror images (lightprobe.sim.polarized) and reaches the daemon as
floats, or as 8-bit frames of the simulated camera in three exposures (noise, saturation, JPEG). The
table of docs/users/accuracy.md:

    build/venv/bin/python tests/accuracy/polarization.py --scenes 40
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path

import numpy as np
from lightprobe import geometry
from lightprobe.estimate import Estimate, EstimateFlag, LightFlag
from lightprobe.evaluate import offline
from lightprobe.imaging import camera, image
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.polarizer import Polarizer
from lightprobe.sim.exposure import bracket_us, median_luminance
from lightprobe.sim.polarized import PolishedFloor
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.scene import Scene
from lightprobe.sim.sensor import Sensor, encode_jpeg
from numpy.typing import NDArray

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
    found = len(matched - called)
    total, expected = estimate.total().coefficients, truth.total().coefficients
    error = float(np.linalg.norm(total - expected) / np.linalg.norm(expected))
    return Count(
        len(lamps),
        found,
        len(lamps) - found,
        len(others - called),
        len(others & called),
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
        self._ideal = Polarizer(Sheet(1.0, 1e9), lens, size_px)
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
#: How a scene is looked at.
WAYS: dict[str, Way] = {
    "no film": lambda studio: (studio.bare(), _PLAIN),
    "three films (published)": lambda studio: (studio.films(), _PLAIN),
    "one film at 90°": lambda studio: (studio.sheet_at(90), _PLAIN),
    "0°, 45°, 90°, 135°": lambda studio: (
        studio.sheet_at(*ANGLES_DEG), offline.Settings(wheel_deg=ANGLES_DEG)
    ),
    "0°, 60°, 120°": lambda studio: (
        studio.sheet_at(0, 60, 120), offline.Settings(wheel_deg=(0, 60, 120))
    ),
    "film put in 90° wrong": lambda studio: (
        studio.sheet_at(90, 135, 0, 45), offline.Settings(wheel_deg=ANGLES_DEG)
    ),
}  # fmt: skip


def ways_of(kind: str) -> list[str]:
    """Frames of a camera take longer: of them only what matters most."""
    return list(WAYS) if kind == "float" else [list(WAYS)[index] for index in (0, 1, 3)]


def judge(kind: str, seed: int) -> tuple[dict[str, Count], int]:
    """Every way for one scene; also whether a film put in wrong was found."""
    scene = PolishedFloor(random_scene(seed))
    truth_studio = Studio(scene, "float")
    truth = truth_studio.estimate(truth_studio.bare(), _PLAIN)
    studio = truth_studio if kind == "float" else Studio(scene, kind)
    counts, turned = {}, 0
    for name in ways_of(kind):
        way = WAYS[name]
        estimate = studio.estimate(*way(studio))
        counts[name] = count(scene, estimate, truth)
        turned += name.startswith("film put") and bool(estimate.flags & EstimateFlag.FILM_TURNED)
        if name.startswith("0°, 45°") and estimate.flags & EstimateFlag.FILM_TURNED:
            turned -= 1000  # a false alarm
    print(f"polarization: {scene.name} {kind}: done", file=sys.stderr)
    return counts, turned


def figures(kind: str, scenes: int, processes: int = 2) -> tuple[dict[str, Count], int]:
    """Sum over scenes; and in how many of them the film put in wrong was found."""
    with ProcessPoolExecutor(processes) as pool:
        found = list(pool.map(partial(judge, kind), range(scenes)))
    sums = {name: sum((counts[name] for counts, _ in found), Count()) for name in ways_of(kind)}
    return sums, sum(turned for _, turned in found)


def table(sums: dict[str, Count], kind: str, scenes: int) -> list[str]:
    """Rows of Markdown."""
    return [
        f"| {kind} | {name} | {one.found} of {one.lamps} | {one.false} | {one.reflections} "
        f"| {one.total_error / scenes:.3f} |"
        for name, one in sums.items()
    ]


HEAD = [
    "| input | film | lamps listed | false lamps listed | reflections named | TOTAL off by, mean |",
    "| --- | --- | --- | --- | --- | --- |",
]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=40, help="rooms with a varnished floor")
    parser.add_argument("--inputs", default="float,8-bit", help="float, 8-bit or both")
    parser.add_argument("--json", action="store_true", help="print JSON in the place of a table")
    options = parser.parse_args()
    rows, everything = list(HEAD), {}
    for kind in options.inputs.split(","):
        sums, turned = figures(kind, options.scenes)
        rows += table(sums, kind, options.scenes)
        everything[kind] = {
            "ways": {name: asdict(one) for name, one in sums.items()},
            "film_turned_found": turned,
        }
    print(json.dumps(everything, indent=2) if options.json else "\n".join(rows))
    if not options.json:
        for kind, one in everything.items():
            if len(ways_of(kind)) == len(WAYS):
                print(f"\n{kind}: a film put in 90° wrong was found in "
                      f"{one['film_turned_found']} of {options.scenes} rooms")  # fmt: skip


if __name__ == "__main__":
    main()
