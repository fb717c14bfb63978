"""For how long a list lacks a strong lamp though it has a place free, while lamps are switched.

Lamps go off and on one after the other; all is in simulated time:

    build/venv/bin/python tests/accuracy/missing.py --seeds 1-20 --periods 4,1 --widths 960,1920
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from lightprobe.estimate import Estimate
from lightprobe.imaging import camera as lenses
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.scene import Truth
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription

#: Share of all lamps' light that makes a lamp a strong one; wider ones are area lights.
STRONG, MOST_RADIUS_DEG = 0.1, 6.5
#: A listed lamp so near is the one that is meant.
SAME_DEG = 3.0
BEGIN_S, SECONDS = 2.0, 24.0
LISTS = {"raw": Subscription(smoothing="RAW", max_lights=8), "default": Subscription()}


@dataclass
class Missing:
    """Of one list."""

    packets: int = 0
    lacking: int = 0
    longest_s: float = 0.0
    births: int = 0


def lacks(truth: Truth, estimate: Estimate, places: int) -> bool:
    """Whether a strong lamp is not listed, while a place is free."""
    if len(estimate.lights) >= places:
        return False
    listed = np.array([light.direction for light in estimate.lights]).reshape(-1, 3)
    total = sum(lamp.irradiance.mean() for lamp in truth.lamps)
    return any(
        lamp.radius_deg < MOST_RADIUS_DEG
        and lamp.irradiance.mean() > STRONG * total
        and not np.any(listed @ lamp.direction > np.cos(np.radians(SAME_DEG)))
        for lamp in truth.lamps
    )


def measured(seed: int, period_s: float, width_px: int) -> Iterator[tuple[str, Missing]]:
    """Each list's, in a procedural room in which a lamp is switched off every `period_s`."""
    scene = random_scene(seed)
    world = World([scene], Behaviour(act_s=0, switch_s=period_s), median_radiance=4.0)
    size_px = (width_px, width_px // 2)
    camera = SimulatedCamera(world, lenses.load("equirect"), size_px, rate_hz=15.0)
    with LiveProbe(camera) as probe:
        clients = {name: probe.client(wanted) for name, wanted in LISTS.items()}
        probe.run(BEGIN_S + SECONDS)
        for name, client in clients.items():
            found, since_s, known = Missing(), None, set[int]()
            for estimate in client.estimates:
                t_s = probe.captured_s(estimate)
                ids = {light.id for light in estimate.lights}
                if t_s >= BEGIN_S:
                    found.packets += 1
                    found.births += len(ids - known)  # what the packet before did not list
                    truth = scene.truth(world.at(t_s).powers)
                    if lacks(truth, estimate, LISTS[name].max_lights):
                        found.lacking += 1
                        since_s = t_s if since_s is None else since_s
                        found.longest_s = max(found.longest_s, t_s - since_s)
                    else:
                        since_s = None
                known = ids
            yield name, found


def main() -> None:
    """Print a line for each run and list."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1-20", help="of rooms, FIRST-LAST")
    parser.add_argument("--periods", default="4,1", help="seconds that each lamp is off")
    parser.add_argument("--widths", default="960", help="of pictures, pixels")
    options = parser.parse_args()
    first, last = map(int, options.seeds.split("-"))
    print(f"{'seed':>4} {'s':>4} {'px':>5} {'list':8} {'missing':>8} {'longest':>8} {'births':>8}")
    for width in map(int, options.widths.split(",")):
        for period in map(float, options.periods.split(",")):
            for seed in range(first, last + 1):
                for name, one in measured(seed, period, width):
                    print(
                        f"{seed:4} {period:4g} {width:5} {name:8} "
                        f"{100 * one.lacking / one.packets:6.1f} % {one.longest_s:6.2f} s "
                        f"{one.births / SECONDS:6.2f}/s",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
