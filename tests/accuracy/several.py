"""How good estimates of two fisheye modules back to back are, beside one 360° camera.

Part of `make accuracy`; in simulated time, as live.py. The second module exposes 8 ms later; alike,
or with 3 % more red and 3 % less blue, or with another curve. One scene takes two minutes:

    build/venv/bin/python tests/accuracy/several.py --scene room --json
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import recording
from judge import Figures, Light, judge
from lightprobe.errors import LightprobeError
from lightprobe.sim.world import Behaviour
from recording import COMMANDED, Pair, Run, add_options, find, listed, markdown, to_json, use_daemon

SCENES = ("courtyard", "room")
RATES = ("0", "30")
CAMERAS: dict[str, tuple[str, Pair | None]] = {
    "one": ("one equirectangular camera", None),
    "alike": ("two fisheye modules, alike", Pair()),
    "other": ("two fisheye modules, 3 % different", Pair(sensitivity=(1.03, 1.0, 0.97))),
    "gamma": ("two fisheye modules, of gamma 2.2 and 2.27", Pair(gamma=2.27 / 2.2)),
    "knee": ("two fisheye modules, highlights of one bent by 3 %", Pair(knee=0.03)),
}


@dataclass(frozen=True)
class Case:
    """Cameras in a box that turns."""

    rate: str
    cameras: str
    run: Run


@dataclass(frozen=True)
class Several:
    """Figures of one scene, raw packets."""

    scene: str
    rate: str
    exposures: str
    cameras: str
    figures: Figures


def judged(case: Case) -> list[Several]:
    """Run a daemon and judge its packets."""
    recorded, run = recording.record(case.run), case.run
    light = Light.of(recorded.world.scenes[0])
    figures = judge(lambda _: light, recorded.packets["raw"], run.judged_s)
    return [Several(run.scene.name, case.rate, run.exposures, case.cameras, figures)]


def cases(
    names: Sequence[str],
    rates: Sequence[str] = RATES,
    exposures: Sequence[str] = COMMANDED,
    cameras: Sequence[str] = tuple(CAMERAS),
) -> list[Case]:
    """Every scene, rate and kind of exposures, before one camera and before two."""
    return [
        Case(
            rate,
            which,
            Run(scene, Behaviour(act_s=0, turn_deg_s=float(rate)), kind, pair=CAMERAS[which][1]),
        )
        for scene, rate, kind, which in product(find(names), rates, exposures, cameras)
    ]


def all_figures(todo: Sequence[Case], processes: int = 2) -> list[Several]:
    """Run them; progress on stderr."""
    return recording.all_figures(
        "several", judged, todo, lambda one: f"{one.scene} {one.rate} {one.cameras}", processes
    )


HEAD = [
    "exposures", "the box turns", "cameras", "packets per second, least",
    "relighting error, median (worst scene)", "more than one camera, worst scene",
    "of 90 % of the packets, worst scene", "wrong and healthy, worst",
    "relighting within 1σ, 3σ",
]  # fmt: skip


def _more(some: Sequence[Several], single: dict[tuple[str, str, str], float]) -> str:
    more = [
        one.figures.error_median - single[one.scene, one.rate, one.exposures]
        for one in some
        if one.cameras != "one" and (one.scene, one.rate, one.exposures) in single
    ]
    return f"{max(more):+.3f}" if more else "–"


def rows(found: Sequence[Several]) -> list[list[str]]:
    """Table over scenes."""
    single = {
        (one.scene, one.rate, one.exposures): one.figures.error_median
        for one in found
        if one.cameras == "one"
    }
    table = []
    for exposures, rate, which in product(recording.EXPOSURES, RATES, CAMERAS):
        some = [
            one
            for one in found
            if (one.exposures, one.rate, one.cameras) == (exposures, rate, which)
        ]
        if not some:
            continue
        figures = [one.figures for one in some]
        known = [one.relighting for one in figures if one.relighting.within_1 is not None]
        within = [
            np.mean([getattr(one, name) for one in known]) if known else np.nan
            for name in ("within_1", "within_3")
        ]
        table.append([
            exposures, f"{rate} °/s", CAMERAS[which][0],
            f"{min(one.packets_per_s for one in figures):.0f}",
            f"{np.median([one.error_median for one in figures]):.3f} "
            f"({max(one.error_median for one in figures):.3f})",
            _more(some, single),
            f"{max(one.error_p90 for one in figures):.3f}",
            f"{100 * max(one.wrong_and_healthy for one in figures):.0f} %",
            f"{100 * within[0]:.0f} %, {100 * within[1]:.0f} %",
        ])  # fmt: skip
    return table


def main() -> None:
    """Print the table, or all figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rates", type=listed(list(RATES), "rates"), default=list(RATES),
        metavar="RATE,…", help=f"of {','.join(RATES)}: °/s")  # fmt: skip
    parser.add_argument("--cameras", type=listed(list(CAMERAS), "cameras"), default=list(CAMERAS),
        metavar="KIND,…", help=f"of {','.join(CAMERAS)}")  # fmt: skip
    add_options(parser, SCENES)
    options = parser.parse_args()
    use_daemon(options.daemon)
    todo = cases(options.scene, options.rates, options.exposures, options.cameras)
    found = all_figures(todo, options.processes)
    print(to_json(found) if options.json else markdown(HEAD, rows(found)))


if __name__ == "__main__":
    try:
        main()
    except LightprobeError as error:
        raise SystemExit(f"several: {error}") from None
