"""How good estimates are while the camera turns: part of `make accuracy`.

A daemon before a simulated camera in simulated time (lightprobe.sim.live), so that no load changes
a figure. While you work on the daemon, one scene at two rates takes half a minute:

    build/venv/bin/python tests/accuracy/live.py --scene lobby --rates 0,100 --json
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import matplotlib.pyplot as plt
import numpy as np
from judge import Coverage, Figures, Light, Packet, judge
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.estimate import Estimate
from lightprobe.imaging import camera as lenses
from lightprobe.imaging.image import HDR_SUFFIXES
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.faults import Faults
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.scene import Scene
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription

ROOT = Path(__file__).resolve().parents[2]
#: Panoramas of blender-data, and rooms with exact lamps.
SCENES = ("blender", "procedural:4", "room")
#: Where a bare name is looked for besides: panoramas beside the checkout, if there are any.
MORE_PANORAMAS = ROOT.parent / "shared/data/hdri"
#: As most tests have it: a quarter of full scale in 1/120 s.
MEDIAN_RADIANCE = 30.0
SIZE_PX, RATE_HZ = (1920, 960), 30.0
#: Until the exposures have settled; then it is judged for so long.
SETTLE_S, JUDGED_S = 2.0, 4.0

MOTIONS = {
    "0": Behaviour(act_s=0),
    **{f"{rate}": Behaviour(act_s=0, turn_deg_s=rate) for rate in (2, 10, 30, 100, 300)},
    "head": Behaviour(act_s=0, swing_deg=40, swing_hz=0.5),
}
EXPOSURES = {"reported": Faults(), "unreported": Faults(hide_exposure=1)}
SUBSCRIPTIONS = {
    "raw": Subscription(smoothing="RAW", max_lights=8, sh_order=4),
    "default": Subscription(),
}


@dataclass(frozen=True)
class Case:
    """One run of the daemon."""

    scene: Scene
    motion: str
    exposures: str
    size_px: tuple[int, int] = SIZE_PX
    daemon_arguments: tuple[str, ...] = ()
    judged_s: float = JUDGED_S


@dataclass(frozen=True)
class Live:
    """Figures of one scene under one motion, for one subscription."""

    scene: str
    motion: str
    exposures: str
    subscription: str
    figures: Figures


def run(case: Case) -> list[Live]:
    """Run a daemon before a scene and judge its packets, for each subscription."""
    cv2.setNumThreads(1)
    world = World([case.scene], MOTIONS[case.motion], MEDIAN_RADIANCE)
    camera = SimulatedCamera(world, lenses.load("equirect"), case.size_px, rate_hz=RATE_HZ)
    with LiveProbe(camera, case.daemon_arguments, faults=EXPOSURES[case.exposures]) as probe:
        clients = {name: probe.client(wish) for name, wish in SUBSCRIPTIONS.items()}
        probe.run(SETTLE_S)
        before = {name: len(client.estimates) for name, client in clients.items()}
        probe.run(case.judged_s)
        heard = {name: client.estimates[before[name] :] for name, client in clients.items()}

        def packet(estimate: Estimate) -> Packet:
            state = world.at(probe.captured_s(estimate))
            return Packet(estimate, camera.true_yaw_deg(state))

        packets = {name: [packet(one) for one in found] for name, found in heard.items()}
    light = Light.of(world.scenes[0])
    return [
        Live(case.scene.name, case.motion, case.exposures, name, judge(light, some, case.judged_s))
        for name, some in packets.items()
    ]


def cases(
    names: Sequence[str],
    rates: Sequence[str] = tuple(MOTIONS),
    exposures: Sequence[str] = tuple(EXPOSURES),
    **more: Any,
) -> list[Case]:
    """Every scene at every rate, exposures reported and not; `more`: of every case."""
    return [Case(*which, **more) for which in product(find(names), rates, exposures)]


def all_figures(todo: Sequence[Case], processes: int = 2) -> list[Live]:
    """Run them; progress on stderr."""
    found: list[Live] = []
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for done, some in enumerate(pool.imap_unordered(run, todo), 1):
            found += some
            one = some[0]
            print(f"live: {done} of {len(todo)}: {one.scene} {one.motion} {one.exposures}",
                  file=sys.stderr, flush=True)  # fmt: skip
    return found


def find(names: Sequence[str]) -> list[Scene]:
    """Scenes as `lightprobe` names them, or panoramas by a part of their file's name."""
    found: list[Scene] = []
    for name in names:
        files = [] if Path(name).exists() else _panoramas(name)
        found += scenes.load([str(file) for file in files] or [name])
    return found


def _panoramas(part: str) -> list[Path]:
    folders = [scenes.panorama_folder(), MORE_PANORAMAS]
    files = [file for folder in folders if folder.is_dir() for file in sorted(folder.iterdir())]
    return [file for file in files if file.suffix.lower() in HDR_SUFFIXES and part in file.stem]


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


def markdown(head: Sequence[str], body: Sequence[Sequence[str]]) -> str:
    """Table."""
    lines = [head, ["---"] * len(head), *body]
    return "\n".join("| " + " | ".join(row) + " |" for row in lines)


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


def to_json(found: Sequence[Live]) -> str:
    """All figures."""
    return json.dumps([asdict(one) for one in found], indent=2)


def _listed(known: Sequence[str], what: str) -> object:
    def parse(text: str) -> list[str]:
        names = text.split(",")
        if unknown := [name for name in names if name not in known]:
            raise argparse.ArgumentTypeError(
                f"{what} {', '.join(unknown)}: known are {','.join(known)}"
            )
        return names

    return parse


def parser() -> argparse.ArgumentParser:
    """Options."""
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument(
        "--scene",
        nargs="+",
        default=list(SCENES),
        metavar="NAME",
        help="as lightprobe simulate names them, or part of a panorama's file name",
    )
    p.add_argument(
        "--rates",
        type=_listed(list(MOTIONS), "rates"),
        default=list(MOTIONS),
        metavar="RATE,…",
        help=f"of {','.join(MOTIONS)}: °/s, or as heads do",
    )
    p.add_argument(
        "--exposures",
        type=_listed(list(EXPOSURES), "exposures"),
        default=list(EXPOSURES),
        metavar="KIND,…",
        help=f"of {','.join(EXPOSURES)}: whether frames tell theirs",
    )
    p.add_argument(
        "--seconds",
        type=float,
        default=JUDGED_S,
        help=f"simulated seconds that are judged (default {JUDGED_S:g})",
    )
    p.add_argument("--daemon", type=Path, help="lightprobed to judge (default: of the build)")
    p.add_argument(
        "--daemon-args",
        type=shlex.split,
        default=[],
        metavar="'ARG …'",
        help="more options of the daemon: --daemon-args='--preset=fast'",
    )
    p.add_argument("--processes", type=int, default=2, help="runs at a time (default 2)")
    p.add_argument("--json", action="store_true", help="print all figures instead of tables")
    return p


def main() -> None:
    """Print tables, or all figures."""
    options = parser().parse_args()
    if options.daemon:
        if not os.access(options.daemon, os.X_OK):
            raise UsageError(f"live: --daemon {options.daemon}: no program: build it first")
        os.environ["LIGHTPROBED"] = str(options.daemon.resolve())
    found = all_figures(
        cases(
            options.scene, options.rates, options.exposures,
            daemon_arguments=tuple(options.daemon_args), judged_s=options.seconds,
        ),
        options.processes,
    )  # fmt: skip
    if options.json:
        print(to_json(found))
        return
    print(markdown(HEAD, rows(found)), markdown(COVERAGE_HEAD, coverage_rows(found)), sep="\n\n")


if __name__ == "__main__":
    try:
        main()
    except LightprobeError as error:
        raise SystemExit(str(error)) from None
