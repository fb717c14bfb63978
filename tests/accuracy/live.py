"""How good estimates are while the camera turns: part of `make accuracy`.

A daemon before a simulated camera in simulated time (lightprobe.sim.live), so that no load changes
a figure. While you work on the daemon, one scene at two rates takes half a minute:

    build/venv/bin/python tests/accuracy/live.py --scene lobby --rates 0,100 --json
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from judge import Coverage, Figures, Light, judge
from lightprobe.errors import LightprobeError
from lightprobe.sim.scene import Scene
from lightprobe.sim.world import Behaviour
from recording import (
    EXPOSURES,
    SETTLE_S,
    SUBSCRIPTIONS,
    Run,
    add_options,
    find,
    listed,
    markdown,
    record,
    to_json,
    use_daemon,
)

#: Panoramas of blender-data, and rooms with exact lamps.
SCENES = ("blender", "procedural:4", "room")
#: Simulated seconds that are judged.
JUDGED_S = 4.0

MOTIONS = {
    "0": Behaviour(act_s=0),
    **{f"{rate}": Behaviour(act_s=0, turn_deg_s=rate) for rate in (2, 10, 30, 100, 300)},
    "head": Behaviour(act_s=0, swing_deg=40, swing_hz=0.5),
}


@dataclass(frozen=True)
class Case:
    """A scene, and how the camera turns."""

    motion: str
    run: Run


@dataclass(frozen=True)
class Live:
    """Figures of one scene under one motion, for one subscription."""

    scene: str
    motion: str
    exposures: str
    subscription: str
    figures: Figures


def judged(case: Case) -> list[Live]:
    """Run a daemon and judge its packets, for each subscription."""
    recording, run = record(case.run), case.run
    light = Light.of(recording.world.scenes[0])
    return [
        Live(run.scene.name, case.motion, run.exposures, name, judge(light, some, run.judged_s))
        for name, some in recording.packets.items()
    ]


def case(scene: Scene, motion: str, exposures: str, **more: Any) -> Case:
    """Give a case by names; `more`: of its Run."""
    return Case(motion, Run(scene, MOTIONS[motion], exposures, **more))


def cases(
    names: Sequence[str],
    rates: Sequence[str] = tuple(MOTIONS),
    exposures: Sequence[str] = tuple(EXPOSURES),
    **more: Any,
) -> list[Case]:
    """Every scene at every rate, exposures reported and not; `more`: of every run."""
    return [case(*which, **more) for which in product(find(names), rates, exposures)]


def all_figures(todo: Sequence[Case], processes: int = 2) -> list[Live]:
    """Run them; progress on stderr."""
    found: list[Live] = []
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for done, some in enumerate(pool.imap_unordered(judged, todo), 1):
            found += some
            one = some[0]
            print(f"live: {done} of {len(todo)}: {one.scene} {one.motion} {one.exposures}",
                  file=sys.stderr, flush=True)  # fmt: skip
    return found


HEAD = [
    "exposures", "subscription", "the camera turns", "packets per second, least",
    "relighting error, median (worst scene)", "of 90 % of the packets, worst scene",
    "wrong and healthy, median (worst)", "births per second, median (worst)",
    "AMBIENT's step, worst", "a sun is listed, worst",
]  # fmt: skip
COVERAGE_HEAD = [
    "exposures", "subscription", "the camera turns", "direction within 1σ, 3σ",
    "irradiance within 1σ, 3σ", "relighting within 1σ, 3σ", "flags, share of the packets",
]  # fmt: skip


def _groups(found: Sequence[Live]) -> list[tuple[list[str], list[Figures]]]:
    """First cells of a row, and the figures of all scenes for it."""
    groups = []
    for exposures, name, motion in product(EXPOSURES, SUBSCRIPTIONS, MOTIONS):
        key = (exposures, name, motion)
        some = [
            one.figures
            for one in found
            if (one.exposures, one.subscription, one.motion) == key and one.figures.packets
        ]
        if some:
            words = f"{motion} °/s" if motion != "head" else "± 40° at 0.5 Hz"
            groups.append(([exposures, name, words], some))
    return groups


def rows(found: Sequence[Live]) -> list[list[str]]:
    """Table over scenes: a row for each kind of exposures, subscription and motion."""
    table = []
    for first, some in _groups(found):
        suns = [one.sun_listed for one in some if one.sun_listed is not None]
        table.append([
            *first,
            f"{min(one.packets_per_s for one in some):.0f}",
            f"{np.median([one.error_median for one in some]):.3f} "
            f"({max(one.error_median for one in some):.3f})",
            f"{max(one.error_p90 for one in some):.3f}",
            f"{100 * np.median([one.wrong_and_healthy for one in some]):.0f} % "
            f"({100 * max(one.wrong_and_healthy for one in some):.0f} %)",
            f"{np.median([one.births_per_s for one in some]):.1f} "
            f"({max(one.births_per_s for one in some):.1f})",
            f"{100 * max(one.ambient_step for one in some):.1f} %",
            f"{100 * min(suns):.0f} %" if suns else "–",
        ])  # fmt: skip
    return table


def coverage_rows(found: Sequence[Live]) -> list[list[str]]:
    """Table over scenes: how often the truth is within the stated sigmas; and flags."""

    def covered(parts: Sequence[Coverage]) -> str:
        known = [part for part in parts if part.within_1 is not None]
        if not known:
            return "–"
        weights = [part.count for part in known]
        one, three = (
            np.average([getattr(part, name) for part in known], weights=weights)
            for name in ("within_1", "within_3")
        )
        return f"{100 * one:.0f} %, {100 * three:.0f} %"

    table = []
    for first, some in _groups(found):
        names = sorted({name for one in some for name in one.flags})
        shares = {name: np.mean([one.flags.get(name, 0) for one in some]) for name in names}
        table.append([
            *first, covered([one.direction for one in some]),
            covered([one.irradiance for one in some]), covered([one.relighting for one in some]),
            ", ".join(f"`{name}` {100 * share:.0f} %" for name, share in shares.items()) or "–",
        ])  # fmt: skip
    return table


def draw(found: Sequence[Live], path: Path) -> None:
    """Error and share of wrong and healthy packets by turning rate, a line for each scene."""
    plt.switch_backend("Agg")
    rates = [motion for motion in MOTIONS if motion != "head"]
    fig, axes = plt.subplots(2, len(EXPOSURES), sharex=True, sharey="row", figsize=(10, 7))
    for column, exposures in enumerate(EXPOSURES):
        some = {
            (one.scene, one.motion): one.figures
            for one in found
            if (one.exposures, one.subscription) == (exposures, "raw")
        }
        for scene in sorted({one.scene for one in found}):
            line = [some[scene, rate] for rate in rates]
            axes[0, column].plot(range(len(rates)), [one.error_median for one in line], "o-", ms=3)
            shares = [100 * one.wrong_and_healthy for one in line]
            axes[1, column].plot(range(len(rates)), shares, "o-", ms=3, label=scene)
        axes[0, column].set(title=f"exposures {exposures}", yscale="log")
        axes[1, column].set(xticks=range(len(rates)), xticklabels=rates)
        axes[1, column].set_xlabel("the camera turns, °/s")
    axes[0, 0].set_ylabel("relighting error, median of the packets")
    axes[1, 0].set_ylabel("wrong and healthy packets, %")
    axes[1, -1].legend(fontsize="x-small", ncols=2)
    fig.suptitle("While the camera turns (simulated)")
    fig.tight_layout()
    fig.savefig(path, dpi=110)


def main() -> None:
    """Print tables, or all figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rates", type=listed(list(MOTIONS), "rates"), default=list(MOTIONS),
        metavar="RATE,…", help=f"of {','.join(MOTIONS)}: °/s, or as heads do")  # fmt: skip
    parser.add_argument("--seconds", type=float, default=JUDGED_S,
        help=f"simulated seconds that are judged, after {SETTLE_S:g} (default {JUDGED_S:g})",
    )  # fmt: skip
    add_options(parser, SCENES)
    options = parser.parse_args()
    use_daemon(options.daemon)
    todo = cases(
        options.scene,
        options.rates,
        options.exposures,
        daemon_arguments=tuple(options.daemon_args),
        judged_s=options.seconds,
    )
    found = all_figures(todo, options.processes)
    if options.json:
        print(to_json(found))
        return
    print(markdown(HEAD, rows(found)), markdown(COVERAGE_HEAD, coverage_rows(found)), sep="\n\n")


if __name__ == "__main__":
    try:
        main()
    except LightprobeError as error:
        raise SystemExit(f"live: {error}") from None
