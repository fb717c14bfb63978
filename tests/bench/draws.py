"""Subscriptions that say what they draw: what is chosen, its bytes, stated and seen errors.

A simulated camera shows rooms to a daemon (simulated time) with one client for each of NEEDS. Of
the packets of the last second the one is judged that states the least; seen errors are those of
what an app draws by it (drawn.py). A need is met where what is seen is no more than was asked; it
is told where the packet states more than was asked; else it is missed.

`make draws` writes the table of docs/users/clients.md.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from dataclasses import dataclass
from pathlib import Path

import drawn
import numpy as np
from lightprobe.estimate import Estimate
from lightprobe.imaging import camera as lenses
from lightprobe.reflection_map import ReflectionMap
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.exposure import ExposureLimits
from lightprobe.sim.live import LiveClient, LiveProbe
from lightprobe.sim.scene import Scene
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription

ROOT = Path(__file__).resolve().parents[2]
#: What six apps draw, and the most error of each.
NEEDS = {
    "a colour": {"diffuse": 0.1},
    "matt things": {"diffuse": 0.03, "shadows": 0.05},
    "brushed metal": {"diffuse": 0.05, "glossy": 0.05},
    "fine metal": {"glossy": 0.01},
    "chrome": {"diffuse": 0.05, "mirrors": 0.02},
    "all of it": {"diffuse": 0.02, "shadows": 0.02, "glossy": 0.02, "mirrors": 0.15},
}
#: What sees the light: a camera of any exposure, and a webcam, by which many lamps clip.
SIGHTS = {"any exposure": ExposureLimits(0.05, 33000.0, 0.0), "webcam": ExposureLimits()}
SIZE_PX, RATE_HZ, SETTLE_S, JUDGED_S = (960, 480), 10.0, 6.0, 2.0
DAEMON = ("--reflection-map=64", "--brackets=4")
Errors = dict[str, float]


@dataclass(frozen=True)
class Got:
    """What one client got in one room."""

    sh_order: int
    lights: int
    map_size: int  # texels; 0: none
    bytes_per_s: float
    asked: Errors
    stated: Errors
    seen: Errors

    @property
    def met(self) -> bool:
        """Whether all that is drawn is as exact as was asked."""
        return all(self.seen[name] <= error for name, error in self.asked.items())

    @property
    def told(self) -> bool:
        """Whether the packet states, of what is not as exact, that it is not."""
        return all(
            self.seen[name] <= error or self.stated.get(name, 2.0) > error
            for name, error in self.asked.items()
        )

    @property
    def claimed(self) -> bool:
        """Whether the packet states that everything is as exact as was asked."""
        return all(self.stated.get(name, 2.0) <= error for name, error in self.asked.items())


def truth_of(scene: Scene) -> drawn.Truth:
    """Take what the true light of a scene draws."""
    powers = np.ones(len(scene.lamps))
    picture = scene.render(drawn.WIDTH_PX, drawn.WIDTH_PX // 2).compose(powers)
    return drawn.Truth.of(scene.truth(powers).irradiance(drawn.NORMALS), picture)


def _surest(client: LiveClient, since_s: float) -> Estimate:
    """Give the estimate since then that states the least."""
    recent = [
        one.message
        for one in client.received
        if isinstance(one.message, Estimate) and one.t_s > since_s
    ]
    return min(recent, key=lambda one: sum((one.drawn or {}).values()))


def _newest_map(client: LiveClient, since_s: float) -> ReflectionMap | None:
    found = [
        one.message
        for one in client.received
        if isinstance(one.message, ReflectionMap) and one.t_s > since_s
    ]
    return found[-1] if found else None


def look(
    scene: Scene, wishes: dict[str, Subscription], limits: ExposureLimits = SIGHTS["any exposure"]
) -> dict[str, Got]:
    """Show a room to a daemon, and judge what each client gets."""
    world = World([scene], Behaviour(act_s=0), median_radiance=30.0)
    camera = SimulatedCamera(
        world, lenses.load("equirect"), SIZE_PX, rate_hz=RATE_HZ, limits=limits
    )
    truth = truth_of(world.scenes[0])
    found = {}
    with LiveProbe(camera, DAEMON) as probe:
        clients = {name: probe.client(wish) for name, wish in wishes.items()}
        probe.run(SETTLE_S)
        before = {name: client.bytes_received for name, client in clients.items()}
        probe.run(JUDGED_S)
        for name, client in clients.items():
            estimate = _surest(client, probe.t_s - JUDGED_S / 2)
            mirrored = _newest_map(client, probe.t_s - JUDGED_S)
            seen = truth.errors(estimate, mirrored)
            asked = dict(wishes[name].draws or {})
            found[name] = Got(
                estimate.sh.order, len(estimate.lights), mirrored.size if mirrored else 0,
                (client.bytes_received - before[name]) / JUDGED_S, asked, estimate.drawn or {},
                {name: seen[name] for name in asked},
            )  # fmt: skip
    return found


def subscriptions() -> dict[str, Subscription]:
    """Give the six."""
    return {name: Subscription(draws=draws, health_period_ms=0) for name, draws in NEEDS.items()}


def _case(case: tuple[Scene, str]) -> dict[str, Got]:
    scene, sight = case
    return look(scene, subscriptions(), SIGHTS[sight])


def _percent(errors: Errors) -> str:
    return ", ".join(f"{name} {100 * error:.2g}" for name, error in errors.items())


def row(name: str, some: list[Got]) -> str:
    """Put what one need got in all rooms into a row."""
    orders, lights, maps = (
        sorted({getattr(one, field) for one in some})
        for field in ("sh_order", "lights", "map_size")
    )
    asked = some[0].asked
    medians = [
        {thing: float(np.median([getattr(one, part)[thing] for one in some])) for thing in asked}
        for part in ("stated", "seen")
    ]
    counts = (
        sum(one.claimed for one in some),
        sum(one.met for one in some),
        sum(not one.told for one in some),
    )
    return (
        f"| {name} | {_percent(some[0].asked)} | {'…'.join(map(str, (orders[0], orders[-1])))} | "
        f"{lights[0]}…{lights[-1]} | {', '.join(str(size or 'none') for size in maps)} | "
        f"{np.median([one.bytes_per_s for one in some]) / 1e3:.1f} | {_percent(medians[0])} | "
        f"{_percent(medians[1])} | {counts[0]} | {counts[1]} | {counts[2]} |"
    )


def table(sight: str, found: list[dict[str, Got]]) -> str:
    """Put what all rooms got into a table."""
    lines = [
        f"{sight.capitalize()}, {len(found)} rooms:",
        "",
        "| draws | asked, % | SH order | lights | map, texels | kB/s | stated, % | seen, % | "
        "stated as met | met | missed |",
        "|" + " --- |" * 11,
        *(row(name, [one[name] for one in found]) for name in NEEDS),
    ]
    every = [got for one in found for got in one.values()]
    share = sum(got.told for got in every) / len(every)
    lines += ["", f"Met, or told that it is not: {100 * share:.1f} %."]
    return "\n".join(lines)


def main() -> None:
    """Print a table for each sight."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", type=int, default=20, help="the room and procedural ones (20)")
    parser.add_argument("--processes", type=int, default=2, help="daemons at a time (2)")
    parser.add_argument("--page", action="store_true", help="write docs/users/clients.md")
    options = parser.parse_args()
    rooms = scenes.load(("room", f"procedural:{options.rooms - 1}"))
    tables = []
    with multiprocessing.get_context("spawn").Pool(options.processes) as pool:
        for sight in SIGHTS:
            found = pool.map(_case, [(scene, sight) for scene in rooms], chunksize=1)
            tables.append(table(sight, found))
            print(f"{tables[-1]}\n")
            for room, one in enumerate(found):
                for name, got in one.items():
                    if not got.told:
                        print(f"room {room}, {name}: {_percent(got.seen)} seen, "
                              f"{_percent(got.stated)} stated")  # fmt: skip
            print(flush=True)
    if options.page:
        sys.path.insert(0, str(ROOT / "docs"))
        from generated import put

        put(ROOT / "docs" / "users" / "clients.md", {"draws": "\n\n".join(tables)})


if __name__ == "__main__":
    main()
