"""What the published stack of three films is good for, by the research's own measures.

Rooms over a varnished floor, bare and behind ideal films at 90°, 45° and 0° (one eighth of the
light), and the daemon's way beside it. Threshold: how many stops wide the range of static
thresholds is that marks every lamp and nothing else, of pixels. Colour: the published sum of
differences between bare and filtered codes, a mean over the lamps' pixels; and the angle between
the RGB of found lamps and of the true ones. The published recipe runs as the daemon's detector
`research`: at the histogram's median, and behind films at a static code. The research names none;
200 is taken here. The tables of docs/users/accuracy.md:

    build/venv/bin/python tests/accuracy/films.py --page
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.evaluate import offline
from lightprobe.geometry import Array
from lightprobe.imaging import camera
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.polarizer import Polarizer
from lightprobe.sim.exposure import bracket_us, median_luminance
from lightprobe.sim.polarized import PolishedFloor
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.scene import Scene
from lightprobe.sim.sensor import Sensor, encode_jpeg
from numpy.typing import NDArray
from page import ACCURACY, put

SIZE_PX = (960, 480)
STACK_DEG = (90.0, 45.0, 0.0)
IDEAL = Sheet(1.0, 1e9, index=1.0)
_TOP_CODE = 255
_STATIC_CODE = 200
#: Beyond its rim a lamp's light leaks by JPEG and interpolation.
_RIM_DEG = 1.0
Radiance = NDArray[np.float32]


@dataclass(frozen=True)
class Look:
    """One way to look at one room."""

    stops: float | None  # of thresholds that find all lamps and nothing else; None: there is none
    colour_deg: tuple[float, ...]  # of the lamps that were found
    lamps: int
    false: int


def stops(scene: Scene, light: Array) -> float | None:
    """Range of thresholds on luminance (H, W), or on codes, that marks all lamps and no more."""
    directions = geometry.equirect_directions(*SIZE_PX)
    elsewhere = np.ones(light.shape, bool)
    dimmest = np.inf
    for lamp in scene.lamps:
        off_deg = np.degrees(np.arccos(np.clip(directions @ lamp.direction, -1, 1)))
        dimmest = min(dimmest, light[off_deg <= max(lamp.radius_deg, 0.3)].max())
        elsewhere &= off_deg > lamp.radius_deg + _RIM_DEG
    brightest = light[elsewhere].max()
    return float(np.log2(dimmest / brightest)) if dimmest > brightest else None


def look(
    scene: Scene, views: Sequence[Radiance], exposures_us: Sequence[float], detector: str = ""
) -> Look:
    """By the daemon, and by thresholds on the first exposure's codes; no exposures: as floats."""
    if not exposures_us:
        return Look(stops(scene, luminance(views[0].astype(np.float64))), (), len(scene.lamps), 0)
    sensor = Sensor(*SIZE_PX)
    with tempfile.TemporaryDirectory(prefix="lightprobe-") as name:
        codes = [sensor.capture(views[0], us, frame=k) for k, us in enumerate(exposures_us)]
        for index, one in enumerate(codes):
            (Path(name) / f"{index:04}.jpg").write_bytes(encode_jpeg(one))
        settings = offline.Settings(preset="balanced", detector=detector or None)
        estimate = offline.estimate_folder(Path(name), exposures_us, settings)
    pairs = geometry.match_directions(
        [lamp.direction for lamp in scene.lamps], [light.direction for light in estimate.lights]
    )
    table = camera.load("equirect").response_table()[:, 0]
    range_stops = stops(scene, table[codes[0].max(axis=-1)])
    angles = tuple(
        float(geometry.angle_deg(scene.lamps[i].irradiance, estimate.lights[j].irradiance))
        for i, j, _ in pairs
    )
    return Look(range_stops, angles, len(scene.lamps), len(estimate.lights) - len(pairs))


def difference(scene: Scene, bare: Radiance, filtered: Radiance, exposure_us: float) -> float:
    """Give the published |(R, G, B) basic - (R, G, B) polarized|, a mean over the lamps' pixels."""
    sensor = Sensor(*SIZE_PX)
    one, other = (
        sensor.capture(view, exposure_us, frame=0).astype(np.float64) for view in (bare, filtered)
    )
    directions = geometry.equirect_directions(*SIZE_PX)
    inside = np.zeros(one.shape[:2], bool)
    for lamp in scene.lamps:
        inside |= directions @ lamp.direction >= np.cos(np.radians(max(lamp.radius_deg, 0.3)))
    return float(np.abs(one - other)[inside].sum(axis=-1).mean() / _TOP_CODE)


def judge(seed: int) -> tuple[dict[str, Look], float]:
    """Every way to look at one room; and the published difference."""
    scene = PolishedFloor(random_scene(seed))
    layers, powers = scene.render(*SIZE_PX), np.ones(len(scene.lamps))
    s0, s12 = layers.compose(powers), layers.compose_polarized(powers)
    stack = Polarizer(IDEAL, camera.load("equirect"), SIZE_PX)
    behind = stack.through_stack(s0, s12, STACK_DEG)
    median = median_luminance(s0)
    one_us, three_us = bracket_us(median, 1), bracket_us(median, 3)
    # radiance 1 is full scale at one second
    light = camera.load("equirect").response_table()[_STATIC_CODE, 1]
    static = f"research:{1e6 * light / one_us[0]:.6g}"
    found = {
        "bare, exact": look(scene, [s0], []),
        "films, exact": look(scene, [behind], []),
        "bare, one exposure": look(scene, [s0], one_us),
        "films, the same exposure": look(scene, [behind], one_us),
        "bare, three exposures": look(scene, [s0], three_us),
        "bare, one exposure, published recipe at the median": look(scene, [s0], one_us, "research"),
        "films, the same exposure, published recipe at code 200": look(
            scene, [behind], one_us, static
        ),
    }
    print(f"films: {scene.name}: done", file=sys.stderr, flush=True)
    return found, difference(scene, s0, behind, one_us[0])


def summary(looks: Sequence[Look]) -> dict[str, float | int | None]:
    """Figures over rooms."""
    ranges = [one.stops for one in looks if one.stops is not None]
    angles = [angle for one in looks for angle in one.colour_deg]
    return {
        "rooms_with_a_threshold": len(ranges),
        "stops_median": float(np.median(ranges)) if ranges else None,
        "lamps": sum(one.lamps for one in looks),
        "found": len(angles),
        "false": sum(one.false for one in looks),
        "colour_median_deg": float(np.median(angles)) if angles else None,
        "colour_worst_deg": max(angles) if angles else None,
    }


def table(sums: dict[str, dict[str, float | int | None]], rooms: int) -> list[str]:
    """Rows of Markdown."""

    def shown(value: float | int | None, form: str) -> str:
        return "–" if value is None else format(value, form)

    head = ["input", f"rooms of {rooms} with such a threshold", "stops, median", "lamps found",
            "false lamps", "colour off by, median", "worst"]  # fmt: skip
    lines = [head, ["---"] * len(head)]
    for name, one in sums.items():
        judged = one["colour_median_deg"] is not None
        lines.append([
            name, f"{one['rooms_with_a_threshold']}", shown(one["stops_median"], ".2f"),
            f"{one['found']} of {one['lamps']}" if judged else "–",
            f"{one['false']}" if judged else "–",
            f"{shown(one['colour_median_deg'], '.1f')}°" if judged else "–",
            f"{shown(one['colour_worst_deg'], '.0f')}°" if judged else "–",
        ])  # fmt: skip
    return ["| " + " | ".join(line) + " |" for line in lines]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=30, help="rooms with a varnished floor")
    parser.add_argument("--processes", type=int, default=2, help="rooms at a time")
    parser.add_argument("--page", action="store_true", help="write docs/users/accuracy.md")
    parser.add_argument("--json", action="store_true", help="print JSON in the place of a table")
    options = parser.parse_args()
    with ProcessPoolExecutor(options.processes) as pool:
        found = list(pool.map(judge, range(options.scenes)))
    sums = {name: summary([looks[name] for looks, _ in found]) for name in found[0][0]}
    published = float(np.mean([one for _, one in found]))
    if options.json:
        everything = {"ways": sums, "published_difference": published, "rooms": len(found)}
        print(json.dumps(everything, indent=2))
        return
    words = f"Published sum of differences: {published:.2f} of 3, mean over the lamps' pixels."
    part = "\n".join([*table(sums, len(found)), "", words])
    if options.page:
        put(ACCURACY, {"films": part})
    else:
        print(part)


if __name__ == "__main__":
    main()
