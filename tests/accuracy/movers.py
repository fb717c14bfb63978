"""How good estimates are while people walk by and things move: by itself, for any daemon.

    build/venv/bin/python tests/accuracy/movers.py --scene room --what walkers,near --motion still

What moves in front of the map is a change of those cells alone: AMBIENT may step by what it truly
steps, lamps that are not hidden stay listed, and how the camera turns is not pulled along.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any

import judge
import motions
import numpy as np
import recording
from judge import Figures, Light, Packet
from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.errors import LightprobeError
from lightprobe.geometry import Array
from lightprobe.sim.moved import Change, change
from lightprobe.sim.movers import Movers
from lightprobe.sim.scene import Scene
from recording import (
    Run,
    add_cameras,
    add_options,
    find,
    listed,
    markdown,
    record,
    to_json,
    use_daemon,
)

WHAT = {
    "nobody": Movers(),
    "walkers": Movers(walkers=2, walker_deg=34),
    "near": Movers(walkers=1, walker_m=0.7, walker_deg=34),
    "stands": Movers(walkers=1, walker_m=1.2, walker_m_s=2, walker_deg=34, walker_stand_s=5),
    "quarter": Movers(walkers=1, walker_m=0.28, walker_m_s=2, walker_deg=34, walker_stand_s=2),
    "door": Movers(door_s=4),
    "leaves": Movers(leaves_deg=30),
    "screen": Movers(screen_deg=25),
}
MOTIONS = {"still": motions.MOTIONS["0"], "head": motions.MOTIONS["head"]}
SIZES = {"960": (960, 480), "1920": (1920, 960)}
HEAD = [
    "what moves", "camera", "picture", "scene", "relighting error, median", "of 90 %",
    "births per second", "AMBIENT's step", "its true step", "relighting within 1σ, 3σ",
    "lamps off, 95 %", "wrong and healthy", "flags, share of the packets",
]  # fmt: skip


@dataclass(frozen=True)
class Case:
    """What moves before a camera."""

    what: str
    motion: str
    run: Run


@dataclass(frozen=True)
class Moving:
    """Figures of a default subscription."""

    what: str
    motion: str
    picture: str
    scene: str
    subscription: str
    figures: Figures
    true_step: float  # of AMBIENT, as judge.ambient_step has it
    lamps_off_deg: float | None  # 95 % of the lamps that were found; None: no closed forms


class Truth:
    """Light of a scene with movers before it, by the time."""

    def __init__(self, run: Run, world: Any) -> None:
        """Of the world of a recording."""
        self._world, self._still = world, Light.of(world.scenes[0])
        self.change: Callable[[float], Change] = cache(self._change)
        self.light: Callable[[float], Light] = cache(self._light)
        self.ambient: Callable[[float], Array] = cache(self._ambient)

    def _change(self, t_s: float) -> Change:
        state = self._world.at(t_s)
        return change(state.movers, state.scene, state.powers)

    def _light(self, t_s: float) -> Light:
        more, still = self.change(t_s), self._still
        lamps = still.lamps and more.dimmed(still.lamps, np.ones(len(still.lamps)))
        irradiance = still.irradiance + more.irradiance(still.normals)
        return replace(still, irradiance=irradiance, lamps=lamps, sun=None)

    def _ambient(self, t_s: float) -> Array:
        """Luminance of AMBIENT's irradiance on a few normals, more than without movers."""
        normals, more = geometry.sphere_normals(2), self.change(t_s)
        found = more.irradiance(normals)
        for lamp, share in zip(self._world.scenes[0].lamps, more.shares, strict=True):
            cosine = np.maximum(normals @ lamp.direction, 0)
            found = found + (1 - share) * cosine[:, None] * lamp.irradiance
        return luminance(found)

    def whole_lamps(self, t_s: float) -> list[Array]:
        """Directions of the lamps that nobody hides, where they are known exactly."""
        lamps, shares = self._still.lamps or (), self.change(t_s).shares
        return [lamp.direction for lamp, share in zip(lamps, shares, strict=False) if share > 0.99]

    def step(self, packets: Sequence[Packet]) -> float:
        """See :attr:`Moving.true_step`."""
        seen = [self.ambient(one.captured_s) for one in packets]
        mean = float(luminance(self._still.irradiance).mean())
        return max((float(np.abs(b - a).mean()) for a, b in pairwise(seen)), default=0) / mean


def judged(case: Case) -> list[Moving]:
    """Run a daemon and judge its packets."""
    recorded, run = record(case.run), case.run
    truth = Truth(run, recorded.world)
    found = []
    for name, some in recorded.packets.items():
        figures = judge.judge(lambda packet: truth.light(packet.captured_s), some, run.judged_s)
        found.append(
            Moving(
                case.what, case.motion, run.kind.words or f"{run.size_px[0]}", run.scene.name,
                name, figures, truth.step(some), lamps_off_deg(truth, some),
            )
        )  # fmt: skip
    return found


def lamps_off_deg(truth: Truth, packets: Sequence[Packet]) -> float | None:
    """By how much lamps that nobody hides lie beside where they are, 95 % of them."""
    angles = [
        angle_deg
        for one in packets
        for _, _, angle_deg in geometry.match_directions(
            [one.turn @ direction for direction in truth.whole_lamps(one.captured_s)],
            [light.direction for light in one.estimate.lights],
        )
    ]
    return float(np.quantile(angles, 0.95)) if angles else None


def case(scene: Scene, what: str, motion: str, **more: Any) -> Case:
    """Give a case by names; `more`: of its Run."""
    behaviour = replace(MOTIONS[motion], movers=WHAT[what])
    return Case(what, motion, Run(scene, behaviour, **{"exposures": "reported", **more}))


def rows(found: Sequence[Moving], subscription: str = "default") -> list[list[str]]:
    """Table, a row for each case."""
    table = []
    for one in found:
        if one.subscription != subscription:
            continue
        f = one.figures
        within = (f.relighting.within_1, f.relighting.within_3)
        flags = ", ".join(f"`{name}` {100 * share:.0f} %" for name, share in f.flags.items())
        table.append([
            one.what, one.motion, one.picture, one.scene, f"{f.error_median:.3f}",
            f"{f.error_p90:.3f}", f"{f.births_per_s:.2f}", f"{100 * f.ambient_step:.1f} %",
            f"{100 * one.true_step:.1f} %",
            ", ".join("–" if share is None else f"{100 * share:.0f} %" for share in within),
            "–" if one.lamps_off_deg is None else f"{one.lamps_off_deg:.2f}°",
            f"{100 * f.wrong_and_healthy:.0f} %", flags or "–",
        ])  # fmt: skip
    return table


def main() -> None:
    """Print a table, or all figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    names = (("what", WHAT, "what moves"), ("motion", MOTIONS, "motions"), ("size", SIZES, "sizes"))
    for name, known, words in names:
        parser.add_argument(f"--{name}", type=listed(list(known), words), default=list(known),
            metavar="NAME,…", help=f"of {','.join(known)}")  # fmt: skip
    parser.add_argument("--seconds", type=float, default=6.0,
        help="simulated seconds that are judged (default 6)")  # fmt: skip
    parser.add_argument("--raw", action="store_true", help="of raw packets, not smoothed ones")
    add_cameras(parser)
    add_options(parser, ["room", "procedural:1"])
    options = parser.parse_args()
    use_daemon(options.daemon)
    todo = [
        case(
            scene, what, motion, size_px=SIZES[size], exposures=options.exposures[0],
            judged_s=options.seconds, faults=options.faults,
            daemon_arguments=tuple(options.daemon_args), cameras=cameras,
        )
        for scene in find(options.scene)
        for cameras in options.cameras
        for size in (options.size if cameras == "equirect" else options.size[:1])
        for motion in options.motion
        for what in options.what
    ]  # fmt: skip
    found = recording.all_figures(
        "movers", judged, todo, lambda one: f"{one.scene} {one.what} {one.motion}",
        options.processes,
    )  # fmt: skip
    if options.json:
        print(to_json(found))
    else:
        print(markdown(HEAD, rows(found, "raw" if options.raw else "default")))


if __name__ == "__main__":
    try:
        main()
    except LightprobeError as error:
        raise SystemExit(f"movers: {error}") from None
