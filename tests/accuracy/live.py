"""How good estimates are while the camera turns: part of `make accuracy`.

A daemon before a simulated camera in simulated time (lightprobe.sim.live), so that no load changes
a figure. While you work on the daemon, one scene at two rates takes half a minute:

    build/venv/bin/python tests/accuracy/live.py --scene lobby --rates 0,100 --json

--defects gives the camera and its lens what cheap ones have (defects.py), and prints one table:

    build/venv/bin/python tests/accuracy/live.py --scene room procedural:1 --rates 0,30 \
        --size 960x480 --exposures reported --defects all

--cameras takes other cameras than one that gives panoramas: --cameras dual-fisheye,two-modules.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import motions
import numpy as np
import recording
from defects import DEFECTS, defect_rows
from defects import HEAD as DEFECTS_HEAD
from judge import Coverage, Figures, Light, Packet, judge
from kinds import KINDS
from lightprobe import geometry
from lightprobe.errors import LightprobeError
from lightprobe.sim.flicker import Flicker
from lightprobe.sim.room import Room
from lightprobe.sim.scene import Scene
from lightprobe.sim.world import Behaviour, World
from motions import MOTIONS
from recording import (
    COMMANDED,
    EXPOSURES,
    ORIENTATIONS,
    SETTLE_S,
    SIZE_PX,
    SUBSCRIPTIONS,
    Run,
    add_cameras,
    add_options,
    find,
    listed,
    markdown,
    pixels,
    record,
    size_px,
    to_json,
    use_daemon,
)
from scale import Scale, on_one_scale

#: Panoramas of blender-data, and rooms with exact lamps.
SCENES = ("blender", "procedural:4", "room")
#: Where things go wrong.
TROUBLED_SCENES = ("room",)
#: Where something tells the orientation besides the frames.
TOLD_SCENES, TOLD_RATES = ("room",), ("100", "swing", "head")
#: Where lamps and suns clip: with the ring of light sensors.
RING_SCENES, RING_RATES = ("blender",), ("0", "30", "100")
#: Cameras with lenses, in the table of SCENES.
LENS_SCENES, LENS_RATES = ("room",), ("0", "head")
LENS_KINDS = ("dual-fisheye", "two-modules")
#: Simulated seconds that are judged.
JUDGED_S = 4.0

#: What goes wrong in use: words, how the world behaves, and what of the Run is different.
_SWING = MOTIONS["swing"]
TROUBLES: dict[str, tuple[str, Behaviour, dict[str, Any]]] = {
    "covered": (
        "half of the lens is covered for 2 s",
        Behaviour(act_s=0, cover_from_s=3, cover_to_s=5), {},
    ),
    "walk": (
        "a walk across the room, 1 m/s",
        Behaviour(act_s=0, walk_m=1.2, walk_m_s=1), {"size_px": (960, 480)},
    ),
    "ignored": (
        "exposures are ignored, 30 °/s", MOTIONS["30"], {"faults": "ignore_exposure=1"},
    ),
    "rolling": (
        "rolling shutter, 100 Hz, ± 40° at 0.5 Hz",
        replace(_SWING, flicker=Flicker(100, (0.5,), (0, 1 / 3, 2 / 3))), {"row_time_us": 30.0},
    ),
    "1fps": (
        "1 frame per second, 10 °/s", MOTIONS["10"], {"rate_hz": 1.0, "judged_s": 20.0},
    ),
    "120fps": (
        "120 frames per second, ± 40° at 0.5 Hz",
        _SWING, {"rate_hz": 120.0, "judged_s": 2.0, "size_px": (960, 480)},
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A scene, and how the camera turns or what goes wrong."""

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
    orientation: str = "visual"
    ring: bool = False
    defects: str = "none"
    cameras: str = "equirect"  # of KINDS
    in_world: float | None = None  # share of the packets; None: nobody asked for it
    off_deg: float | None = None  # of what they state as their orientation, 95 % of them
    sigma_deg: float | None = None  # that they state, median
    scale: Scale | None = None  # where the exposure is not known: judged on the best common scale


def told(some: Sequence[Packet], world: World) -> dict[str, float | None]:
    """Judge what packets in the world of what tells the orientation state of it."""
    inside = [packet for packet in some if packet.estimate.frame == "WORLD"]
    off_deg = [_off_deg(packet, world) for packet in inside]
    sigmas = [packet.estimate.orientation_sigma_deg for packet in inside]
    return {
        "in_world": len(inside) / max(len(some), 1),
        "off_deg": float(np.quantile(off_deg, 0.95)) if inside else None,
        "sigma_deg": float(np.median(np.array(sigmas, float))) if inside else None,
    }


def _off_deg(packet: Packet, world: World) -> float:
    xyzw = packet.estimate.orientation
    assert xyzw is not None
    stated = geometry.rotation_matrix(np.roll(xyzw, 1))
    true = geometry.rotation_matrix(world.rotation(packet.captured_s))
    return float(np.degrees(np.arccos(np.clip((np.trace(stated.T @ true) - 1) / 2, -1, 1))))


def judged(case: Case) -> list[Live]:
    """Run a daemon and judge its packets, for each subscription."""
    recorded, run = record(case.run), case.run

    @cache
    def light(t_s: float) -> Light:
        return Light.of(recorded.world.at(t_s).scene)

    def light_at(packet: Packet) -> Light:
        return light(packet.captured_s if run.behaviour.is_going else 0.0)

    asked = ORIENTATIONS[run.orientation].wants_world
    found = []
    for name, some in recorded.packets.items():
        scale = None
        if run.is_relative:
            some, scale = on_one_scale(light_at, some)
        found.append(
            Live(
                run.scene.name,
                case.motion,
                run.exposures,
                name,
                judge(light_at, some, run.judged_s, bounds_count=not run.ring),
                run.orientation,
                run.ring,
                run.defects,
                run.cameras,
                **(told(some, recorded.world) if asked else {}),
                scale=scale,
            )
        )
    return found


def case(scene: Scene, motion: str, exposures: str, **more: Any) -> Case:
    """Give a case by names; `more`: of its Run."""
    if motion in MOTIONS:
        return Case(motion, Run(scene, MOTIONS[motion], exposures, **more))
    _, behaviour, special = TROUBLES[motion]
    faults = "&".join(filter(None, (special.get("faults"), more.get("faults"))))
    return Case(motion, Run(scene, behaviour, exposures, **{**more, **special, "faults": faults}))


def cases(
    names: Sequence[str],
    rates: Sequence[str] = tuple(MOTIONS),
    exposures: Sequence[str] = COMMANDED,
    **more: Any,
) -> list[Case]:
    """Every scene at every rate or in every trouble, exposures reported and not.

    `more`: of every run. Only rooms can be walked in.
    """
    return [
        case(*which, **more)
        for which in product(find(names), rates, exposures)
        if which[1] != "walk" or isinstance(which[0], Room)
    ]


def told_cases() -> list[Case]:
    """Everything that can tell the orientation, well or badly."""
    return [
        one
        for orientation, teller in ORIENTATIONS.items()
        if not teller.places  # moving.py
        for one in cases(TOLD_SCENES, TOLD_RATES, ["reported"], orientation=orientation)
    ]


def ring_cases(judged_s: float = JUDGED_S) -> list[Case]:
    """With the ring of light sensors beside the camera."""
    return cases(RING_SCENES, RING_RATES, ["reported"], ring=True, judged_s=judged_s)


def lens_cases(judged_s: float = JUDGED_S) -> list[Case]:
    """Cameras with lenses."""
    return [
        one
        for kind in LENS_KINDS
        for one in cases(LENS_SCENES, LENS_RATES, ["reported"], cameras=kind, judged_s=judged_s)
    ]


def ring_rows(moving: Sequence[Live], ringed: Sequence[Live]) -> list[list[str]]:
    """Rows of `ringed`, and beside them those of the same scenes and rates without the ring."""
    same = {(one.scene, one.motion, one.exposures) for one in ringed}
    without = [one for one in moving if (one.scene, one.motion, one.exposures) in same]
    return rows([*without, *ringed])


def readme_rows(found: Sequence[Live]) -> list[list[str]]:
    """Table over scenes of what a client gets that asks for nothing, exposures reported."""
    shown = ("reported", "default", "equirect")
    some = [one for one in found if (one.exposures, one.subscription, one.cameras) == shown]
    columns = [HEAD.index(name) for name in README_HEAD]
    return [[row[column] for column in columns] for row in rows(some)]


def all_figures(todo: Sequence[Case], processes: int = 2) -> list[Live]:
    """Run them; progress on stderr."""
    return recording.all_figures(
        "live", judged, todo,
        lambda one: f"{one.scene} {one.motion} {one.exposures}", processes,
    )  # fmt: skip


#: More than there are scenes.
COLOURS = plt.get_cmap("tab20").colors  # type: ignore[attr-defined]

HEAD = [
    "exposures", "subscription", "the camera turns", "packets per second, least",
    "relighting error, median (worst scene)", "more than still, worst scene",
    "of 90 % of the packets, worst scene",
    "wrong and healthy, median (worst)", "births per second, median (worst)",
    "AMBIENT's step, worst", "a sun is listed, worst",
]  # fmt: skip
#: What README.md shows of HEAD.
README_HEAD = [
    "the camera turns", "relighting error, median (worst scene)",
    "wrong and healthy, median (worst)", "births per second, median (worst)",
]  # fmt: skip
COVERAGE_HEAD = [
    "exposures", "subscription", "the camera turns", "direction within 1σ, 3σ",
    "irradiance within 1σ, 3σ", "relighting within 1σ, 3σ", "flags, share of the packets",
]  # fmt: skip


def _groups(found: Sequence[Live]) -> list[tuple[list[str], list[Figures]]]:
    """First cells of a row, and the figures of all scenes for it."""
    groups = []
    kinds = list(product(KINDS, (*MOTIONS, *TROUBLES), ORIENTATIONS, (False, True)))
    for exposures, name, (cameras, motion, teller, ring) in product(
        EXPOSURES, SUBSCRIPTIONS, kinds
    ):
        key = (exposures, name, motion, teller, ring, cameras)
        some = [
            one.figures for one in found if (one.exposures, one.subscription, *_what(one)) == key
        ]
        if some:
            groups.append(([exposures, name, _words(*key[2:])], some))
    return groups


def _what(one: Live) -> tuple[str, str, bool, str]:
    """Arguments of :func:`_words`."""
    return one.motion, one.orientation, one.ring, one.cameras


def _words(
    motion: str, orientation: str = "visual", ring: bool = False, cameras: str = "equirect"
) -> str:
    words = TROUBLES[motion][0] if motion in TROUBLES else motions.words(motion)
    besides = [ORIENTATIONS[orientation].words, "with the ring" if ring else ""]
    return "; ".join(filter(None, [words, *besides, KINDS[cameras].words]))


def _more_than_still(found: Sequence[Live], first: Sequence[str]) -> str:
    """Largest difference of the median errors to those of the same scene while nothing moves."""
    some = [one for one in found if [one.exposures, one.subscription] == list(first[:2])]
    errors = {(one.scene, *_what(one)): one.figures.error_median for one in some}
    more = [
        one.figures.error_median - errors[still]
        for one in some
        if _words(*_what(one)) == first[2] and one.motion != "0"
        if (still := (one.scene, "0", "visual", one.ring, one.cameras)) in errors
    ]
    return f"{np.nanmax(more):.3f}" if np.isfinite(more).any() else "–"


def rows(found: Sequence[Live]) -> list[list[str]]:
    """Table over scenes: a row for each kind of exposures, subscription and motion."""
    table = []
    for first, everything in _groups(found):
        some = [one for one in everything if one.packets] or everything
        suns = [one.sun_listed for one in some if one.sun_listed is not None]
        table.append([
            *first,
            f"{min(one.packets_per_s for one in everything):.0f}",
            f"{np.median([one.error_median for one in some]):.3f} "
            f"({max(one.error_median for one in some):.3f})",
            _more_than_still(found, first),
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


#: What is shown of HEAD beside what is told of the orientation.
_OF_HEAD = [
    "the camera turns", "relighting error, median (worst scene)",
    "wrong and healthy, median (worst)",
]  # fmt: skip
TOLD_HEAD = [
    *_OF_HEAD, "packets in the world of what tells the orientation, least",
    "orientation off, 95 % of them, worst scene", "stated sigma about each axis, median",
]  # fmt: skip


def told_rows(found: Sequence[Live]) -> list[list[str]]:
    """Table over scenes: what is told of the orientation, raw packets, exposures reported."""
    some = [one for one in found if (one.exposures, one.subscription) == ("reported", "raw")]
    columns = [HEAD.index(name) for name in _OF_HEAD]
    table = []
    for row in rows(some):
        group = [one for one in some if _words(one.motion, one.orientation) == row[2]]
        inside = [one.in_world for one in group if one.in_world is not None]
        off = [one.off_deg for one in group if one.off_deg is not None]
        sigmas = [one.sigma_deg for one in group if one.sigma_deg is not None]
        table.append([
            *(row[column] for column in columns),
            f"{100 * min(inside):.0f} %" if inside else "–",
            f"{max(off):.2f}°" if off else "–",
            f"{np.median(sigmas):.2f}°" if sigmas else "–",
        ])  # fmt: skip
    return table


def draw(found: Sequence[Live], path: Path) -> None:
    """Error and share of wrong and healthy packets by turning rate, a line for each scene."""
    plt.switch_backend("Agg")
    rates = [motion for motion in MOTIONS if motion not in motions.WORDS]
    fig, axes = plt.subplots(2, len(COMMANDED), sharex=True, sharey="row", figsize=(10, 7))
    for column, exposures in enumerate(COMMANDED):
        some = {
            (one.scene, one.motion): one.figures
            for one in found
            if (one.exposures, one.subscription, one.cameras) == (exposures, "raw", "equirect")
        }
        for index, scene in enumerate(sorted({one.scene for one in found})):
            look = {"color": COLOURS[index % len(COLOURS)], "marker": "o", "markersize": 3}
            line = [some[scene, rate] for rate in rates]
            axes[0, column].plot(range(len(rates)), [one.error_median for one in line], **look)
            shares = [100 * one.wrong_and_healthy for one in line]
            axes[1, column].plot(range(len(rates)), shares, label=scene, **look)
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
        metavar="RATE,…", help=f"of {','.join(MOTIONS)}: °/s, or see motions.py")  # fmt: skip
    parser.add_argument("--troubles", type=listed(list(TROUBLES), "troubles"), default=[],
        metavar="TROUBLE,…",
        help=f"instead of rates, of {','.join(TROUBLES)}")  # fmt: skip
    parser.add_argument("--orientation", type=listed(list(ORIENTATIONS), "orientations"),
        default=["visual"], metavar="KIND,…",
        help=f"what tells it, of {','.join(ORIENTATIONS)} (default visual)")  # fmt: skip
    parser.add_argument(
        "--ring",
        action="store_true",
        help="with a ring of light sensors: the firmware in its simulated box",
    )
    parser.add_argument("--seconds", type=float, default=JUDGED_S,
        help=f"simulated seconds that are judged, after {SETTLE_S:g} (default {JUDGED_S:g})",
    )  # fmt: skip
    parser.add_argument("--size", type=size_px, default=SIZE_PX, metavar="WxH",
        help="of the camera's pictures, pixels (default {}x{})".format(*SIZE_PX))  # fmt: skip
    parser.add_argument("--defects", type=listed([*DEFECTS, "all"], "defects"), default=["none"],
        metavar="DEFECT,…",
        help=f"of the camera and its lens: all, or of {','.join(DEFECTS)}")  # fmt: skip
    parser.add_argument("--pixels", type=pixels, default=pixels(""), metavar="K=V&…",
        help="of the sensor, as simulate --pixel-defects has them: stuck=12")  # fmt: skip
    add_cameras(parser)
    add_options(parser, SCENES)
    options = parser.parse_args()
    use_daemon(options.daemon)
    todo = [
        one
        for orientation in options.orientation
        for cameras in options.cameras
        for name in (DEFECTS if "all" in options.defects else options.defects)
        for one in cases(
            options.scene,
            options.troubles or options.rates,
            options.exposures,
            faults=options.faults,
            daemon_arguments=tuple(options.daemon_args),
            judged_s=options.seconds,
            size_px=options.size,
            orientation=orientation,
            ring=options.ring,
            defects=name,
            cameras=cameras,
            pixels=options.pixels,
        )
    ]
    found = all_figures(todo, options.processes)
    if options.json:
        print(to_json(found))
        return
    if options.defects != ["none"]:
        print(markdown(DEFECTS_HEAD, defect_rows(found)))
        return
    print(markdown(HEAD, rows(found)), markdown(COVERAGE_HEAD, coverage_rows(found)), sep="\n\n")
    if options.orientation != ["visual"]:
        print("", markdown(TOLD_HEAD, told_rows(found)), sep="\n")


if __name__ == "__main__":
    try:
        main()
    except LightprobeError as error:
        raise SystemExit(f"live: {error}") from None
