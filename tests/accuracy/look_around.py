"""Panoramas without a 360° camera: a phone that looks around, beside a 360° camera.

    build/venv/bin/python tests/accuracy/look_around.py --page    # docs/users/look_around.md

A camera of 70° by 43° holds still for 2 s and is turned for 15 s, and an app tells its poses; the
last half second is judged, in simulated time. What it has seen is computed here from its true
poses, and not by the daemon. Relighting as in docs/users/accuracy.md: mean absolute error of
irradiance over 642 normals, of its largest value. Sigmas: root mean square over normals, of the
mean.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from judge import Light
from lightprobe import geometry
from lightprobe.estimate import Estimate, EstimateFlag
from lightprobe.evaluate.metrics import relighting, relighting_relative, stated_error
from lightprobe.geometry import Array
from lightprobe.imaging import camera as lenses
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.clock import START_NS
from lightprobe.sim.head import Habits, Head, true_turn
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.motion import Track, turned
from lightprobe.sim.scene import PanoramaScene, Scene
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription
from page import ROOT, put
from recording import INDOORS, OUTDOORS, find, markdown

PAGE = ROOT / "docs/users/look_around.md"
PHONE = ROOT / "tests/accuracy/cameras/phone.camera"
SCENES = ("room", "procedural:3", "interior", "courtyard", "night", "city")
#: How long it looks around, and how much of its end is judged.
LOOK_S, JUDGED_S = 15.0, 0.5
#: Before that it holds still for so long: exposures settle, and the app's clock becomes known.
HOLD_S = 2.0
RATE_HZ = 30.0
#: From one ring to the next it takes so much of a ring's time.
_RISE_SHARE = 0.15
#: Where it is computed what has been seen: columns of a panorama.
_SEEN_WIDTH = 180
PANORAMA_PX = (960, 480)
_STILL = np.array([1.0, 0, 0, 0])


@dataclass(frozen=True)
class Look:
    """How the camera is turned: rings at so many degrees above the horizon, one after another."""

    words: str
    rings_deg: tuple[float, ...] = ()  # none: a 360° camera that stands still

    def track(self) -> Track:
        """Once around for each ring, all in LOOK_S, after HOLD_S."""
        t_s = np.arange(0, HOLD_S + LOOK_S + 1, 1 / 60)
        round_ = np.clip((t_s - HOLD_S) / LOOK_S, 0, 1) * len(self.rings_deg)
        number = np.minimum(round_.astype(int), len(self.rings_deg) - 1)
        height = np.array(self.rings_deg)
        rise = np.clip((round_ - number) / _RISE_SHARE, 0, 1) * (number > 0)
        before = height[np.maximum(number - 1, 0)]
        smooth = np.where(number > 0, (1 - np.cos(np.pi * rise)) / 2, 1)
        nod_deg = before + (height[number] - before) * smooth
        # a little more than once around, since it rises meanwhile
        yaw_deg = 360 * (1 + _RISE_SHARE) * round_
        return Track(t_s, turned(yaw_deg, nod_deg), np.zeros((len(t_s), 3)), self.words)


LOOKS = {
    "360": Look("a 360° camera that stands still"),
    "three": Look("three rings: ahead, up, down", (0, 58, -58)),
    "two": Look("two rings, at ±35°: not the poles", (35, -35)),
    "low": Look("two rings, at −10° and −58°: not the ceiling", (-10, -58)),
}


@dataclass(frozen=True)
class Case:
    """How one look ended."""

    scene: str
    look: str
    seen: float  # share of the sphere
    error: float  # relighting, MAE of the largest irradiance
    relative: float  # what sigma states: RMS over normals, of the mean
    stated: float | None
    partial: bool  # PARTIAL_VIEW
    clipped: bool

    @property
    def within_3(self) -> bool:
        """Whether three stated sigmas cover the error."""
        return self.stated is not None and self.relative <= 3 * self.stated


def seen_share(camera: lenses.Camera, rotations: Array) -> float:
    """Share of the sphere that pictures at these rotations (N, 4) show."""
    directions = geometry.equirect_directions(_SEEN_WIDTH, _SEEN_WIDTH // 2).reshape(-1, 3)
    weights = geometry.equirect_solid_angles(_SEEN_WIDTH, _SEEN_WIDTH // 2)
    weights = np.repeat(weights, _SEEN_WIDTH)
    (lens,) = camera.lenses
    seen = np.zeros(len(directions), bool)
    for rotation in rotations:
        x, y = lens.place(geometry.rotate(geometry.inverse(rotation), directions))
        with np.errstate(invalid="ignore"):
            seen |= (x >= 0) & (y >= 0) & (x < camera.width_px) & (y < camera.height_px)
    return float(weights[seen].sum() / weights.sum())


def run(scene: Scene, name: str, arguments: Sequence[str] = ()) -> Case:
    """Look around in a scene."""
    cv2.setNumThreads(1)
    look = LOOKS[name]
    level = OUTDOORS if isinstance(scene, PanoramaScene) else INDOORS
    path = look.track() if look.rings_deg else None
    world = World([scene], Behaviour(act_s=0, path=path), median_radiance=level)
    lens = lenses.load(str(PHONE) if path else "equirect")
    size_px = (lens.width_px, lens.height_px) if path else PANORAMA_PX
    camera = SimulatedCamera(world, lens, size_px, rate_hz=RATE_HZ)
    told = ("--orientation=client", f"--camera={PHONE}") if path else ("--orientation=none",)
    with LiveProbe(camera, (*told, *arguments)) as probe:
        wish = Subscription(
            smoothing="RAW", max_lights=8, sh_order=4, frame="WORLD" if path else "PROBE"
        )
        client = probe.client(wish)
        if path:
            probe.apps.append(Head(client, true_turn(camera), START_NS, Habits()))
        probe.run(HOLD_S + LOOK_S - JUDGED_S)
        before = len(client.estimates)
        probe.run(JUDGED_S)
        packets = client.estimates[before:]
        turns = [
            world.rotation(probe.captured_s(one)) if path and one.frame == "PROBE" else _STILL
            for one in packets
        ]
    share = 1.0
    if path:
        share = seen_share(lens, world.rotation(np.arange(0, HOLD_S + LOOK_S, 1 / RATE_HZ)))
    return judged(scene.name, name, share, Light.of(world.scenes[0]), packets, turns)


def judged(
    scene: str,
    look: str,
    share: float,
    light: Light,
    packets: Sequence[Estimate],
    turns: Sequence[Array],
) -> Case:
    """Compare packets, whose frame is turned so against the scene's, with the truth: the median."""
    if not packets:
        return Case(scene, look, share, math.nan, math.nan, None, False, False)
    found = [
        packet.irradiance(geometry.rotate(geometry.inverse(turn), light.normals))
        for packet, turn in zip(packets, turns, strict=True)
    ]
    stated = [s for s in map(stated_error, packets) if s is not None]
    flags = packets[-1].flags
    return Case(
        scene, look, share,
        float(np.median([relighting(light.irradiance, one)[0] for one in found])),
        float(np.median([relighting_relative(light.irradiance, one) for one in found])),
        float(np.median(stated)) if stated else None,
        bool(flags & EstimateFlag.PARTIAL_VIEW), bool(flags & EstimateFlag.CLIPPED),
    )  # fmt: skip


def _run_named(arguments: Sequence[str], what: tuple[Scene, str]) -> Case:
    return run(*what, arguments)


def read(file: Path | None) -> list[Case]:
    """Cases that a file has; none of a file that is not there."""
    if file is None or not file.exists():
        return []
    return [Case(**one) for one in json.loads(file.read_text())]


def write(file: Path | None, cases: Sequence[Case]) -> None:
    """Keep cases in a file, if there is to be one."""
    if file is not None:
        file.write_text(json.dumps([asdict(case) for case in cases], indent=1))


def run_all(
    names: Sequence[str],
    looks: Sequence[str],
    processes: int,
    arguments: Sequence[str] = (),
    file: Path | None = None,
) -> list[Case]:
    """All looks in all scenes, but those that the file has; it gets the others, one by one."""
    found = read(file)
    known = {(case.scene, case.look) for case in found}
    every = [(scene, look) for scene in find(names) for look in looks]
    todo = [one for one in every if (one[0].name, one[1]) not in known]
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for case in pool.imap(partial(_run_named, tuple(arguments)), todo):
            found.append(case)
            write(file, found)
            print(case, file=sys.stderr, flush=True)
    wanted = {(scene.name, look) for scene, look in every}
    return [case for case in found if (case.scene, case.look) in wanted]


def table(cases: Sequence[Case]) -> str:
    """Markdown: a row for each look, median and worst of its scenes."""
    whole = {case.scene: case.error for case in cases if case.look == "360"}
    rows = []
    for name, look in LOOKS.items():
        mine = [case for case in cases if case.look == name]
        if not mine:
            continue
        errors = np.array([case.error for case in mine])
        more = errors - np.array([whole.get(case.scene, math.nan) for case in mine])
        sigmas = [case.stated for case in mine if case.stated is not None]
        rows.append([
            look.words, f"{100 * np.mean([case.seen for case in mine]):.0f} %",
            f"{np.median(errors):.3f} ({errors.max():.3f})",
            "" if name == "360" else f"{np.median(more):+.3f} ({more.max():+.3f})",
            f"{np.median(sigmas):.3f}" if sigmas else "–",
            f"{sum(case.within_3 for case in mine)} of {len(mine)}",
            f"{sum(case.partial for case in mine)} of {len(mine)}",
            f"{sum(case.clipped for case in mine)} of {len(mine)}",
        ])  # fmt: skip
    head = [
        "the camera looks", "seen", "relighting error, median (worst)",
        "more than by the 360° camera, median (worst)", "stated sigma, median", "within 3 sigma",
        "PARTIAL_VIEW", "CLIPPED",
    ]  # fmt: skip
    return markdown(head, rows) + "\n"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", nargs="+", default=list(SCENES), metavar="NAME")
    parser.add_argument("--look", nargs="+", choices=list(LOOKS), default=list(LOOKS))
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--daemon-args", nargs="*", default=[], metavar="ARG")
    parser.add_argument("--page", action="store_true", help=f"write it into {PAGE.name}")
    parser.add_argument("--json", type=Path, help="all cases into this file; go on where it ends")
    options = parser.parse_args()
    cases = run_all(
        options.scene, options.look, options.processes, options.daemon_args, options.json
    )
    text = table(cases)
    if options.page:
        put(PAGE, {"look-around": text})
    print(text, end="")


if __name__ == "__main__":
    main()
