"""Reflections in a varnished floor, told by daemon and wheel: still, and while the head turns.

Firmware, wheel, film, a camera that is told its exposures, and the daemon, in simulated time. Rows
of the table in docs/users/accuracy.md (an hour on two cores):

    build/venv/bin/python tests/accuracy/polarization_live.py --scenes 40
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial

import cv2
from lightprobe import geometry
from lightprobe.estimate import Estimate, LightFlag
from lightprobe.imaging import camera as lenses
from lightprobe.imaging.film import Sheet
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.live_box import LiveBox
from lightprobe.sim.polarized import PolishedFloor
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription

SIZE_PX, RATE_HZ = (1920, 960), 10.0
#: The wheel homes and sweeps once in the first ones (14 s); the last ones are judged.
SETTLE_S, JUDGED_S = 18.0, 4.0
MEDIAN_RADIANCE = 30.0
#: What may stand before the lens, and the published stack, the outermost first.
FILMS = {
    "none": "no film", "films": "three films (published)", "swept": "0°, 45°, 90°, 135°, swept",
}  # fmt: skip
STACK_DEG = (90.0, 45.0, 0.0)


@dataclass(frozen=True)
class Count:
    """Of some rooms: the newest estimate, and all that were judged."""

    lamps: int = 0
    lost: int = 0  # not listed, or called a reflection
    false: int = 0  # listed, no lamp, and not called a reflection
    reflections: int = 0  # no lamps, called reflections
    packets: int = 0
    wrong_packets: int = 0  # with a lamp lost or a false one

    def __add__(self, other: Count) -> Count:
        """Sum of both."""
        names = [field.name for field in fields(Count)]
        return Count(*(getattr(self, name) + getattr(other, name) for name in names))


def count(lamps: Sequence[geometry.Array], estimate: Estimate) -> Count:
    """Judge one estimate; `lamps`: directions in the camera's frame."""
    pairs = geometry.match_directions(lamps, [light.direction for light in estimate.lights])
    matched = {index for _, index, _ in pairs}
    called = {
        index for index, light in enumerate(estimate.lights) if light.flags & LightFlag.REFLECTION
    }
    others = set(range(len(estimate.lights))) - matched
    lost, false = len(lamps) - len(matched - called), len(others - called)
    return Count(len(lamps), lost, false, len(others & called), 1, int(bool(lost or false)))


def judge(turn_deg_s: float, film: str, seed: int) -> Count:
    """One room; `film`: of FILMS."""
    cv2.setNumThreads(1)
    scene = PolishedFloor(random_scene(seed))
    world = World([scene], Behaviour(act_s=0, turn_deg_s=turn_deg_s), MEDIAN_RADIANCE)
    camera = SimulatedCamera(
        world, lenses.load("equirect"), SIZE_PX, rate_hz=RATE_HZ, seed=seed,
        sheet=None if film == "none" else Sheet(), stack_deg=STACK_DEG if film == "films" else (),
    )  # fmt: skip
    wish = Subscription(max_lights=8, smoothing="RAW", area_lights=True)

    def seen_by(probe: LiveProbe) -> Count:
        client = probe.client(wish)
        probe.run(SETTLE_S if film == "swept" else 2.0)
        before = len(client.estimates)
        probe.run(JUDGED_S)
        some = client.estimates[before:]
        counts = [count(_lamps(world, camera, probe.captured_s(one)), one) for one in some]
        wrong = sum(one.wrong_packets for one in counts)
        newest = asdict(counts[-1]) | {"packets": len(counts), "wrong_packets": wrong}
        return Count(**newest)

    if film != "swept":
        with LiveProbe(camera, ["--polarizer=films"] if film == "films" else []) as probe:
            return seen_by(probe)
    with LiveBox(seed=seed) as box, LiveProbe(camera, box.arguments, box=box) as probe:
        return seen_by(probe)


def _lamps(world: World, camera: SimulatedCamera, t_s: float) -> list[geometry.Array]:
    yaw_deg = camera.true_yaw_deg(world.at(t_s))
    turn = geometry.rotation_matrix(geometry.quaternion([0, 1, 0], yaw_deg))
    return [turn.T @ lamp.direction for lamp in world.scenes[0].lamps]


def figures(rate: float, film: str, seeds: Sequence[int], processes: int) -> Count:
    """Sum over rooms; what went wrong where on stderr."""
    total = Count()
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for seed, one in zip(
            seeds, pool.imap(partial(judge, rate, film), seeds), strict=True
        ):  # fmt: skip
            total += one
            print(f"polarization: room {seed}, {rate:g} °/s: {one}", file=sys.stderr, flush=True)
    return total


HEAD = [
    "the camera turns", "film", "lamps listed", "false lamps listed", "reflections named",
    "packets with any of it wrong",
]  # fmt: skip


def row(rate: float, film: str, one: Count) -> str:
    """Row of Markdown."""
    cells = [
        f"{rate:g} °/s", FILMS[film],
        f"{one.lamps - one.lost} of {one.lamps}", f"{one.false}", f"{one.reflections}",
        f"{100 * one.wrong_packets / max(one.packets, 1):.1f} %",
    ]  # fmt: skip
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=40, help="rooms with a varnished floor")
    parser.add_argument("--first", type=int, default=0, help="number of the first room")
    parser.add_argument("--rates", default="0,30", help="°/s, like 0,30")
    parser.add_argument("--films", default=",".join(FILMS), help=f"some of {','.join(FILMS)}")
    parser.add_argument("--processes", type=int, default=2, help="rooms at a time")
    parser.add_argument("--json", action="store_true", help="print JSON in the place of a table")
    options = parser.parse_args()
    if not set(options.films.split(",")) <= set(FILMS):
        parser.error(f"--films={options.films}: expected some of {','.join(FILMS)}")
    seeds = range(options.first, options.first + options.scenes)
    rows = ["| " + " | ".join(HEAD) + " |", "|" + " --- |" * len(HEAD)]
    everything = []
    for film in options.films.split(","):
        for rate in (float(word) for word in options.rates.split(",")):
            one = figures(rate, film, seeds, options.processes)
            rows.append(row(rate, film, one))
            everything.append({"turn_deg_s": rate, "film": film, **asdict(one)})
    print(json.dumps(everything, indent=2) if options.json else "\n".join(rows))


if __name__ == "__main__":
    main()
