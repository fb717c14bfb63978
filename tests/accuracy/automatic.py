"""How good estimates are of a camera that only exposes automatically: part of `make accuracy`.

Light is relative then, and judged on the best scale that all packets of a run have in common. What
clips is known the better, the shorter the exposure is, so that a drift of the scale shows only
where nothing clips: the scale is judged before panoramas whose brightest parts are darkened. In
simulated time, as live.py. One scene takes two minutes:

    build/venv/bin/python tests/accuracy/automatic.py --scene room --json
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import recording
from judge import HARMLESS, Light, Packet, judge
from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.errors import LightprobeError
from lightprobe.estimate import EstimateFlag
from lightprobe.geometry import Array
from lightprobe.sim.exposure import median_luminance
from lightprobe.sim.room import Room
from lightprobe.sim.scene import PanoramaScene
from lightprobe.sim.world import Behaviour
from recording import Run, find, listed, markdown, record, to_json, use_daemon
from scale import Scale, on_one_scale

SCENES = ("sunrise", "courtyard", "room")
#: What happens: words, how the world behaves, and what of the Run is different.
CONDITIONS: dict[str, tuple[str, Behaviour, dict[str, Any]]] = {
    "still": ("nothing", Behaviour(act_s=0), {}),
    "100": ("the camera turns, 100 °/s", Behaviour(act_s=0, turn_deg_s=100), {}),
    "head": ("it turns, ± 40° at 0.5 Hz", Behaviour(act_s=0, swing_deg=40, swing_hz=0.5), {}),
    "breathes": (
        "its exposure breathes, ± 2 stops every 2 s", Behaviour(act_s=0),
        {"judged_s": 8.0, "faults": "breathe_stops=2"},
    ),
    "ring": (
        "its exposure breathes, with the ring of light sensors", Behaviour(act_s=0),
        {"judged_s": 8.0, "faults": "breathe_stops=2", "ring": True},
    ),
    "minute": (
        "a minute of 100 °/s", Behaviour(act_s=0, turn_deg_s=100),
        {"judged_s": 60.0, "size_px": (480, 240)},
    ),
    "lamps": ("lamps are switched one by one", Behaviour(act_s=0, switch_s=2), {"judged_s": 8.0}),
    "dark": (
        "all light is a quarter at once, and whole again", Behaviour(act_s=3),
        {"judged_s": 6.0, "levels": (1.0, 0.25)},
    ),
    "ignored": (
        "it turns, and takes commands without following them",
        Behaviour(act_s=0, swing_deg=40, swing_hz=0.5),
        {"judged_s": 12.0, "faults": "ignore_exposure=1"},
    ),
}  # fmt: skip
#: Nothing clips that is so many times as bright as the median, as automatic exposure exposes it.
MOST_TIMES_MEDIAN = 1.5
#: What the light is relative to is no error.
_HARMLESS = HARMLESS | EstimateFlag.EXPOSURE_UNKNOWN | EstimateFlag.EXPOSURE_IGNORED
_NORMALS = geometry.sphere_normals()


@dataclass(frozen=True)
class Case:
    """A scene, and what happens."""

    condition: str
    run: Run
    clips: bool = True


@dataclass(frozen=True)
class Automatic:
    """Figures of one scene under one condition, raw packets."""

    scene: str
    condition: str
    error_median: float  # relighting, on one scale
    error_p90: float
    wrong_and_healthy: float
    flags: dict[str, float] = field(default_factory=dict)
    scale: Scale | None = None
    clips: bool = True
    unsteady: float = 0.0  # total irradiance of a packet off the median of all, the worst, relative
    absolute_off: float | None = None  # the same in cd/m² off the truth; None: without a ring


def judged(case: Case) -> list[Automatic]:
    """Run a daemon and judge its packets."""
    recorded, run = record(case.run), case.run

    @cache
    def light(act: int, powers: tuple[float, ...]) -> Light:
        truth = recorded.world.scenes[act].truth(powers)
        return Light(_NORMALS, truth.irradiance(_NORMALS), None, None)

    def in_scene(packet: Packet) -> Light:
        """The truth in the scene's frame, into which packets are turned back."""
        state = recorded.world.at(packet.captured_s)
        return light(state.act, tuple(state.powers.tolist()))

    totals = np.array(
        [luminance(one.estimate.irradiance(_NORMALS)).mean() for one in recorded.packets["raw"]]
    )
    unsteady = float(np.abs(totals / np.median(totals) - 1).max())
    absolute_off = _absolute_off(in_scene, recorded.packets["raw"], totals) if run.ring else None
    packets, scale = on_one_scale(in_scene, recorded.packets["raw"])
    figures = judge(in_scene, packets, run.judged_s, _HARMLESS)
    return [
        Automatic(
            run.scene.name, case.condition, figures.error_median, figures.error_p90,
            figures.wrong_and_healthy, figures.flags, scale, case.clips, unsteady, absolute_off,
        )
    ]  # fmt: skip


def _absolute_off(
    truth: Callable[[Packet], Light], packets: Sequence[Packet], totals: Array
) -> float:
    """Worst packet's total irradiance, on the scale that the ring tells, off the truth."""
    found = totals * [one.estimate.cd_m2_per_unit or np.nan for one in packets]
    true = np.array([luminance(truth(one).irradiance).mean() for one in packets])
    return float(np.abs(found / (recording.RING_CD_M2_PER_UNIT * true) - 1).max())


def darkened(scene: PanoramaScene) -> PanoramaScene:
    """Give the same panorama with nothing in it that clips."""
    most = MOST_TIMES_MEDIAN * median_luminance(scene.radiance)
    return PanoramaScene.of(f"{scene.name}, darkened", np.minimum(scene.radiance, np.float32(most)))


def cases(names: Sequence[str], conditions: Sequence[str] = tuple(CONDITIONS)) -> list[Case]:
    """Every scene under every condition; panoramas have one lamp, which is not switched."""
    found = []
    for scene, name in product(find(names), conditions):
        _, behaviour, more = CONDITIONS[name]
        if name != "lamps" or isinstance(scene, Room):
            found.append(Case(name, Run(scene, behaviour, "auto", **more)))
        if name != "lamps" and isinstance(scene, PanoramaScene):
            found.append(Case(name, Run(darkened(scene), behaviour, "auto", **more), clips=False))
    return found


def all_figures(todo: Sequence[Case], processes: int = 2) -> list[Automatic]:
    """Run them; progress on stderr."""
    return recording.all_figures(
        "automatic", judged, todo, lambda one: f"{one.scene} {one.condition}", processes
    )


HEAD = [
    "what happens", "relighting error, median (worst scene)", "more than still, worst scene",
    "of 90 % of the packets, worst scene", "wrong and healthy, worst",
    "nothing clips: off the common scale, worst packet",
    "total irradiance off its median, worst packet",
    "in cd/m² off the truth, worst packet",
    "stated sigma of the scale at the end, largest",
    "scale within 1σ, 3σ of the first packet's",
]  # fmt: skip


def rows(found: Sequence[Automatic]) -> list[list[str]]:
    """Table over scenes."""
    still = {one.scene: one.error_median for one in found if one.condition == "still" and one.clips}
    table = []
    for name, (words, _, _) in CONDITIONS.items():
        some = [one for one in found if one.condition == name and one.clips]
        if not some:
            continue
        dark = [one for one in found if one.condition == name and not one.clips]
        more = [one.error_median - still[one.scene] for one in some if one.scene in still]
        scales = [one.scale for one in dark or some if one.scale is not None]
        absolute = [one.absolute_off for one in some if one.absolute_off is not None]
        sigmas = [scale.sigma for scale in scales if scale.sigma is not None]
        within_1 = [scale.within_1 for scale in scales if scale.within_1 is not None]
        within_3 = [scale.within_3 for scale in scales if scale.within_3 is not None]
        table.append([
            words,
            f"{np.median([one.error_median for one in some]):.3f} "
            f"({max(one.error_median for one in some):.3f})",
            f"{max(more):.3f}" if more and name != "still" else "–",
            f"{max(one.error_p90 for one in some):.3f}",
            f"{100 * max(one.wrong_and_healthy for one in some):.0f} %",
            f"{100 * max(scale.off_worst for scale in scales):.1f} %",
            f"{100 * max(one.unsteady for one in some):.1f} %",
            f"{100 * max(absolute):.0f} %" if absolute else "–",
            f"{100 * max(sigmas):.1f} %" if sigmas else "–",
            f"{100 * min(within_1):.0f} %, {100 * min(within_3):.0f} %" if within_1 else "–",
        ])  # fmt: skip
    return table


def main() -> None:
    """Print a table, or all figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--scene", nargs="+", default=list(SCENES), metavar="NAME",
        help="as lightprobe simulate names them, or part of a panorama's file name")  # fmt: skip
    add("--conditions", type=listed(list(CONDITIONS), "conditions"), default=list(CONDITIONS),
        metavar="NAME,…", help=f"of {','.join(CONDITIONS)}")  # fmt: skip
    add("--daemon", type=Path, help="lightprobed to judge (default: of the build)")
    add("--processes", type=int, default=2, help="runs at a time (default 2)")
    add("--json", action="store_true", help="print all figures instead of a table")
    options = parser.parse_args()
    use_daemon(options.daemon)
    found = all_figures(cases(options.scene, options.conditions), options.processes)
    print(to_json(found) if options.json else markdown(HEAD, rows(found)))


if __name__ == "__main__":
    try:
        main()
    except LightprobeError as error:
        raise SystemExit(f"automatic: {error}") from None
