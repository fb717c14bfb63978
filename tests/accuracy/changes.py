"""How fast estimates follow a lamp that is switched, and how still they are while lamps flicker.

Part of `make accuracy`; in simulated time, as live.py. By itself:

    build/venv/bin/python tests/accuracy/changes.py --scene room --json
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import recording
from judge import NEAR_DEG, Packet
from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.errors import LightprobeError
from lightprobe.estimate import flag_names
from lightprobe.evaluate.metrics import relighting, stated_error
from lightprobe.geometry import Array
from lightprobe.lamp import Lamp
from lightprobe.sim.flicker import Flicker
from lightprobe.sim.scene import Scene
from lightprobe.sim.world import Behaviour, World
from recording import (
    COMMANDED,
    RATE_HZ,
    SETTLE_S,
    SUBSCRIPTIONS,
    Run,
    add_options,
    find,
    markdown,
    record,
    to_json,
    use_daemon,
)

#: Rooms with several lamps.
SCENES = ("procedural:4", "room")
#: Lamps are switched so often; a packet is settled in the last quarter of the time between.
SWITCH_S, SETTLED = 2.0, 0.75
#: A change has arrived when so much of it shows.
ARRIVED = 0.9
#: No mains keeps step with a camera; at 120.0 Hz and 30 frames per second all phases are one, and
#: only bands across the rows tell it.
MAINS_HZ, FLICKER_DEPTH = (100.0, 120.25), 0.5
#: Lamps hang on three phases of the mains; a rolling shutter reads 960 rows in 19 ms.
PHASES, ROW_TIME_US = (0.0, 1 / 3, 2 / 3), 20.0
_NORMALS = geometry.sphere_normals(2)


@dataclass(frozen=True)
class Step:
    """What one subscriber saw of all changes of a scene."""

    scene: str
    exposures: str
    subscription: str
    changes: int
    frames_median: float  # with the change in them, until a packet shows it; inf: none did
    frames_worst: float
    overshoot_worst: float  # of the change
    error_settled: float  # relighting, once settled, worst
    announced: float  # share of the packets between that carry a flag or state an error like theirs


@dataclass(frozen=True)
class Ripple:
    """What one subscriber saw of a scene's strongest lamp while all flicker."""

    scene: str
    exposures: str
    subscription: str
    mains_hz: float
    listed: float  # share of the packets that list it
    ripple: float  # largest distance of its irradiance from its mean, of the mean
    bias: float  # of the mean from the truth's
    flagged: float  # share of the packets with FLICKER


@dataclass(frozen=True)
class Case:
    """A scene whose lamps are switched, or flicker."""

    run: Run
    mains_hz: float | None  # None: switched


def judged(case: Case) -> list[Step | Ripple]:
    """Run a daemon and judge its packets, for each subscription."""
    recorded, run = record(case.run), case.run
    found: list[Step | Ripple] = []
    for name, packets in recorded.packets.items():
        where = (run.scene.name, run.exposures, name)
        if case.mains_hz is None:
            found.append(steps(recorded.world, packets, where))
        else:
            found.append(flicker(recorded.world, packets, where, case.mains_hz))
    return found


def steps(world: World, packets: Sequence[Packet], where: tuple[str, str, str]) -> Step:
    """Sum up all switches that `packets` hold; the camera stands still."""
    times = np.array([packet.captured_s for packet in packets])
    light = np.array([luminance(packet.estimate.irradiance(_NORMALS)) for packet in packets])
    frames, overshoots, errors, announced = [], [], [], []
    last = int(times[-1] // SWITCH_S) if len(times) else 0
    for slot in range(1, last + 1):
        start_s = slot * SWITCH_S
        before, after = (_settled(times, light, which) for which in (slot - 1, slot))
        inside = (times >= start_s) & (times < start_s + SWITCH_S)
        if before is None or after is None:
            continue
        change, true = after - before, _true_light(world, slot) - _true_light(world, slot - 1)
        shown = (light[inside] - before) @ change / max(change @ change, 1e-30)
        # Of the daemon's own change, if that is most of the true one: bias is another question.
        arrived = np.flatnonzero((shown >= ARRIVED) & (change @ true > true @ true / 2))
        first = times[inside][arrived[0]] if len(arrived) else np.inf
        frames.append(np.floor((first - start_s) * RATE_HZ) + 1)
        overshoots.append(max(shown.max() - 1, 0.0))
        errors.append(_error(world, packets, times, slot))
        some = [packets[k] for k in np.flatnonzero(inside & (times < first))]
        announced += [_is_announced(world, packet) for packet in some]
    return Step(
        *where, len(frames), *(float(f(frames)) if frames else np.nan for f in (np.median, max)),
        float(max(overshoots, default=np.nan)), float(max(errors, default=np.nan)),
        float(np.mean(announced)) if announced else 1.0,
    )  # fmt: skip


def _settled(times: Array, light: Array, slot: int) -> Array | None:
    """Mean light (N,) at the end of a slot; None: no packet."""
    inside = (times >= (slot + SETTLED) * SWITCH_S) & (times < (slot + 1) * SWITCH_S)
    return light[inside].mean(axis=0) if inside.any() else None


def _true_light(world: World, slot: int) -> Array:
    """Luminance (N,) of the irradiance."""
    return np.asarray(luminance(world.at((slot + 0.5) * SWITCH_S).truth().irradiance(_NORMALS)))


def _is_announced(world: World, packet: Packet) -> bool:
    """Whether a flag or three times the error that it states cover how wrong it is."""
    stated = stated_error(packet.estimate) or 0
    return bool(packet.estimate.flags) or 3 * stated > _error_of(world, packet)


def _error_of(world: World, packet: Packet) -> float:
    """Relighting error."""
    truth = world.at(packet.captured_s).truth()
    error, _ = relighting(truth.irradiance(_NORMALS), packet.estimate.irradiance(_NORMALS))
    return error


def _error(world: World, packets: Sequence[Packet], times: Array, slot: int) -> float:
    """Relighting error of the last packet of a slot."""
    return _error_of(world, packets[np.flatnonzero(times < (slot + 1) * SWITCH_S)[-1]])


def flicker(
    world: World, packets: Sequence[Packet], where: tuple[str, str, str], mains_hz: float
) -> Ripple:
    """Follow the strongest lamp; the camera stands still."""
    lamp = max(world.scenes[0].lamps, key=lambda lamp: float(luminance(lamp.irradiance)))
    seen = np.array([_strength(packet, lamp) for packet in packets])
    known = seen[seen > 0]  # not NaN
    mean = float(known.mean()) if len(known) else np.nan
    names = [flag_names(packet.estimate.flags) for packet in packets]
    return Ripple(
        *where, mains_hz,
        listed=len(known) / max(len(packets), 1),
        ripple=float(np.abs(known / mean - 1).max()) if len(known) else np.nan,
        bias=(mean if len(known) else 0) / float(luminance(lamp.irradiance)) - 1,
        flagged=sum("FLICKER" in some for some in names) / max(len(packets), 1),
    )  # fmt: skip


def _strength(packet: Packet, lamp: Lamp) -> float:
    """Luminance of the light nearest to the lamp, by its irradiance; NaN: none is near."""
    near = [
        (float(light.direction @ lamp.direction), float(luminance(light.irradiance)))
        for light in packet.estimate.lights
    ]
    cosine, strength = max(near, default=(-1.0, np.nan))
    return strength if cosine > np.cos(np.radians(NEAR_DEG)) else np.nan


def cases(
    names: Sequence[str],
    exposures: Sequence[str] = COMMANDED,
    **more: object,
) -> list[Case]:
    """Every scene with more than one lamp, switched, and flickering at both mains."""
    found = []
    for scene, kind in product(find(names), exposures):
        found += of_scene(scene, kind, **more)
    return found


def of_scene(scene: Scene, exposures: str, **more: object) -> list[Case]:
    """Cases of one scene; one lamp cannot be switched, since it never is off."""
    found = []
    if len(scene.lamps) > 1:
        slots = len(scene.lamps) + 2  # all on, each off, all on again
        behaviour = Behaviour(act_s=0, switch_s=SWITCH_S)
        judged_s = slots * SWITCH_S - SETTLE_S
        found.append(Case(Run(scene, behaviour, exposures, judged_s, **more), None))
    for mains_hz in MAINS_HZ:
        flicker = Flicker(mains_hz, (FLICKER_DEPTH,), PHASES)
        run = Run(
            scene, Behaviour(act_s=0, flicker=flicker), exposures, row_time_us=ROW_TIME_US, **more
        )
        found.append(Case(run, mains_hz))
    return found


def all_figures(todo: Sequence[Case], processes: int = 2) -> list[Step | Ripple]:
    """Run them; progress on stderr."""
    return recording.all_figures(
        "changes", judged, todo,
        lambda one: f"{one.scene} {one.exposures}", processes,
    )  # fmt: skip


STEP_HEAD = [
    "exposures", "subscription", "frames until 90 % shows, median (worst)",
    "overshoot, worst", "packets before that are flagged, or state it",
    "relighting error once settled, worst",
]  # fmt: skip
FLICKER_HEAD = [
    "exposures", "subscription", "lamps flicker at", "strongest lamp is listed, worst",
    "ripple of its irradiance, median (worst)", "bias, worst", "flagged `FLICKER`",
]  # fmt: skip


def _frames(number: float) -> str:
    return f"{number:.0f}" if np.isfinite(number) else "never"


def step_rows(found: Sequence[Step | Ripple]) -> list[list[str]]:
    """Table over scenes."""
    table = []
    for exposures, name in product(COMMANDED, SUBSCRIPTIONS):
        some = [
            one
            for one in found
            if isinstance(one, Step) and (one.exposures, one.subscription) == (exposures, name)
        ]
        if some:
            table.append([
                exposures, name,
                f"{_frames(np.median([one.frames_median for one in some]))} "
                f"({_frames(max(one.frames_worst for one in some))})",
                f"{100 * max(one.overshoot_worst for one in some):.0f} %",
                f"{100 * np.mean([one.announced for one in some]):.0f} %",
                f"{max(one.error_settled for one in some):.3f}",
            ])  # fmt: skip
    return table


def flicker_rows(found: Sequence[Step | Ripple]) -> list[list[str]]:
    """Table over scenes."""
    table = []
    for exposures, name, mains_hz in product(COMMANDED, SUBSCRIPTIONS, MAINS_HZ):
        key = (exposures, name, mains_hz)
        some = [
            one
            for one in found
            if isinstance(one, Ripple) and (one.exposures, one.subscription, one.mains_hz) == key
        ]
        if some:
            ripples = [one.ripple for one in some]
            table.append([
                exposures, name, f"{mains_hz:g} Hz, ± {100 * FLICKER_DEPTH:.0f} %",
                f"{100 * min(one.listed for one in some):.0f} %",
                f"{100 * np.median(ripples):.0f} % ({100 * np.nanmax(ripples):.0f} %)",
                f"{100 * max((one.bias for one in some), key=abs):+.0f} %",
                f"{100 * np.mean([one.flagged for one in some]):.0f} %",
            ])  # fmt: skip
    return table


def main() -> None:
    """Print tables, or all figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_options(parser, SCENES)
    options = parser.parse_args()
    use_daemon(options.daemon)
    todo = cases(
        options.scene,
        options.exposures,
        daemon_arguments=tuple(options.daemon_args),
        faults=options.faults,
    )
    found = all_figures(todo, options.processes)
    if options.json:
        print(to_json(found))
        return
    print(
        markdown(STEP_HEAD, step_rows(found)), markdown(FLICKER_HEAD, flicker_rows(found)),
        sep="\n\n",
    )  # fmt: skip


if __name__ == "__main__":
    try:
        main()
    except LightprobeError as error:
        raise SystemExit(f"changes: {error}") from None
