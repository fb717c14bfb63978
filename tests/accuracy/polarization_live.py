"""Mirror images told by daemon and wheel: still, and while the head turns.

Firmware, wheel, film, a camera that is told its exposures, and the daemon, in simulated time. Rooms
are those of polarization.py. The tables of docs/users/accuracy.md (two hours on two cores), or one
of other rooms:

    build/venv/bin/python tests/accuracy/polarization_live.py --page
    build/venv/bin/python tests/accuracy/polarization_live.py --rooms glossy --first 200 --scenes 10
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial
from typing import TypeVar

import cv2
import glossy
import numpy as np
from lightprobe import geometry
from lightprobe.estimate import Estimate, Health, LightFlag
from lightprobe.imaging import camera as lenses
from lightprobe.imaging.film import Sheet
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.glossy_rooms import glossy_room
from lightprobe.sim.live import LiveClient, LiveProbe
from lightprobe.sim.live_box import LiveBox
from lightprobe.sim.polarized import PolishedFloor
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.scene import Scene
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription
from page import ACCURACY, put
from recording import markdown

SIZE_PX, RATE_HZ = (1920, 960), 10.0
#: The wheel homes and sweeps twice in the first ones (12 s); the last ones are judged.
SETTLE_S, JUDGED_S = 13.0, 4.0
MEDIAN_RADIANCE = 30.0
#: What may stand before the lens, and the published stack, the outermost first.
FILMS = {
    "none": "no film", "films": "three films (published)", "swept": "0°, 45°, 90°, 135°, swept",
}  # fmt: skip
STACK_DEG = (90.0, 45.0, 0.0)


@dataclass(frozen=True)
class Count:
    """Of some rooms: the newest estimate, and all that were judged."""

    lamps: int = 0
    lost: int = 0  # not listed, or called a reflection
    false: int = 0  # listed, no lamp, and not called a reflection
    reflections: int = 0  # no lamps, called reflections
    packets: int = 0
    wrong_packets: int = 0  # with a lamp lost or a false one

    def __add__(self, other: Count) -> Count:
        """Sum of both."""
        names = [field.name for field in fields(Count)]
        return Count(*(getattr(self, name) + getattr(other, name) for name in names))


def count(lamps: Sequence[geometry.Array], estimate: Estimate) -> Count:
    """Judge one estimate; `lamps`: directions in the camera's frame."""
    pairs = geometry.match_directions(lamps, [light.direction for light in estimate.lights])
    matched = {index for _, index, _ in pairs}
    called = {
        index for index, light in enumerate(estimate.lights) if light.flags & LightFlag.REFLECTION
    }
    others = set(range(len(estimate.lights))) - matched
    lost, false = len(lamps) - len(matched - called), len(others - called)
    return Count(len(lamps), lost, false, len(others & called), 1, int(bool(lost or false)))


def seen(
    scene: Scene, turn_deg_s: float, film: str, seed: int
) -> tuple[list[Estimate], list[geometry.Array]]:
    """The last estimates of a room, and how each one's frame is turned into the room's (3, 3).

    `film`: of FILMS.
    """
    cv2.setNumThreads(1)
    world = World([scene], Behaviour(act_s=0, turn_deg_s=turn_deg_s), MEDIAN_RADIANCE)
    camera = SimulatedCamera(
        world, lenses.load("equirect"), SIZE_PX, rate_hz=RATE_HZ, seed=seed,
        sheet=None if film == "none" else Sheet(), stack_deg=STACK_DEG if film == "films" else (),
    )  # fmt: skip
    wish = Subscription(max_lights=8, smoothing="RAW", area_lights=True)

    def watch(probe: LiveProbe) -> tuple[list[Estimate], list[geometry.Array]]:
        client = probe.client(wish)
        probe.run(SETTLE_S if film == "swept" else 2.0)
        before = len(client.estimates)
        probe.run(JUDGED_S)
        some = client.estimates[before:]
        return some, [_turn(camera, world, probe.captured_s(one)) for one in some]

    if film != "swept":
        with LiveProbe(camera, ["--polarizer=films"] if film == "films" else []) as probe:
            return watch(probe)
    with LiveBox(seed=seed) as box, LiveProbe(camera, box.arguments, box=box) as probe:
        return watch(probe)


def _turn(camera: SimulatedCamera, world: World, t_s: float) -> geometry.Array:
    return geometry.rotation_matrix(camera.true_rotation(world.at(t_s)))


def judge(turn_deg_s: float, film: str, seed: int) -> Count:
    """One varnished room."""
    scene = PolishedFloor(random_scene(seed))
    estimates, turns = seen(scene, turn_deg_s, film, seed)
    counts = [
        count([turn.T @ lamp.direction for lamp in scene.lamps], one)
        for one, turn in zip(estimates, turns, strict=True)
    ]
    wrong = sum(one.wrong_packets for one in counts)
    return Count(**(asdict(counts[-1]) | {"packets": len(counts), "wrong_packets": wrong}))


def judge_glossy(turn_deg_s: float, seed: int) -> glossy.Found:
    """One glossy room."""
    room = glossy_room(seed)
    return glossy.found(room, *seen(room, turn_deg_s, "swept", seed))


Sum = TypeVar("Sum", Count, glossy.Found)


def total(
    one_room: Callable[[int], Sum], seeds: Sequence[int], processes: int, nothing: Sum
) -> Sum:
    """Sum over rooms; each of them on stderr."""
    found = nothing
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for seed, one in zip(seeds, pool.imap(one_room, seeds), strict=True):
            found += one
            print(f"polarization: room {seed}: {one}", file=sys.stderr, flush=True)
    return found


HEAD = [
    "the camera turns", "film", "lamps listed", "false lamps listed", "reflections named",
    "packets with any of it wrong",
]  # fmt: skip


def row(rate: float, film: str, one: Count) -> list[str]:
    """Row of the table."""
    return [
        f"{rate:g} °/s", FILMS[film],
        f"{one.lamps - one.lost} of {one.lamps}", f"{one.false}", f"{one.reflections}",
        f"{100 * one.wrong_packets / max(one.packets, 1):.1f} %",
    ]  # fmt: skip


def varnished(
    seeds: Sequence[int], rates: Sequence[float], films: Sequence[str], processes: int
) -> str:
    """Give the table of varnished rooms."""
    return markdown(HEAD, [
        row(rate, film, total(partial(judge, rate, film), seeds, processes, Count()))
        for film in films for rate in rates
    ])  # fmt: skip


def in_glossy_rooms(seeds: Sequence[int], rates: Sequence[float], processes: int) -> str:
    """Give the table of glossy rooms."""
    nothing = glossy.Found(Counter())
    return glossy.table({
        f"at {rate:g} °/s": total(partial(judge_glossy, rate), seeds, processes, nothing)
        for rate in rates
    })  # fmt: skip


# ---------------------------------------------------------------- time

TIME_HEAD = ["frames per second", "exposures", "a sweep", "of it turning and settling",
             "frames with an angle"]  # fmt: skip


def time_row(rate_hz: float, exposures: int) -> list[str]:
    """How long sweeps of the daemon's own angles take: medians, and the longest sweep."""
    world = World([PolishedFloor(random_scene(8))], Behaviour(act_s=0), MEDIAN_RADIANCE)
    camera = SimulatedCamera(
        world, lenses.load("equirect"), (480, 240), rate_hz=rate_hz, sheet=Sheet()
    )
    with LiveBox() as box:
        options = (*box.arguments, f"--brackets={exposures}")
        with LiveProbe(camera, options, box=box) as probe:
            client = probe.client(Subscription(health_period_ms=20))
            probe.run(40.0)
            return [f"{rate_hz:g}", f"{exposures}", *_times(client)]


def _times(client: LiveClient) -> list[str]:
    ends, turning, stamped = [], [], []
    so_far_s = last_s = 0.0
    for received in client.received:
        if not isinstance(received.message, Health) or received.message.wheel is None:
            continue
        wheel = received.message.wheel
        so_far_s += (received.t_s - last_s) * (wheel.phase == "MOVING")
        last_s = received.t_s
        if wheel.sweeps > len(ends):
            ends.append(received.t_s)
            turning.append(so_far_s)
            stamped.append(wheel.frames_stamped)
    sweeps_s, moves_s = np.diff(ends), np.diff(turning)
    return [
        f"{np.median(sweeps_s):.1f} s (longest {sweeps_s.max():.1f} s)",
        f"{np.median(moves_s):.1f} s", f"{np.median(np.diff(stamped)):.0f}",
    ]  # fmt: skip


def sweep_times() -> str:
    """Give the table of times."""
    return markdown(TIME_HEAD, [time_row(*one) for one in ((30.0, 3), (30.0, 4), (10.0, 3))])


#: Constants were chosen on the first rooms; the others are unseen.
FIRST, UNSEEN, GLOSSY = range(40), range(100, 120), range(200, 212)


def write_page(processes: int) -> None:
    """Measure all that the page shows."""
    put(ACCURACY, {"sweep-time": sweep_times()})
    put(ACCURACY, {"polarization-glossy-live": in_glossy_rooms(GLOSSY, (0.0, 30.0), processes)})
    put(ACCURACY, {"polarization-live-unseen": varnished(UNSEEN, (30.0,), ("swept",), processes)})
    put(ACCURACY, {"polarization-live": varnished(FIRST, (0.0, 30.0), tuple(FILMS), processes)})


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rooms", choices=("varnished", "glossy"), default="varnished")
    parser.add_argument("--first", type=int, default=0, help="number of the first room")
    parser.add_argument("--scenes", type=int, default=40, help="how many rooms")
    parser.add_argument("--rates", default="0,30", help="°/s, like 0,30")
    parser.add_argument("--films", default=",".join(FILMS), help=f"some of {','.join(FILMS)}")
    parser.add_argument("--processes", type=int, default=2, help="rooms at a time")
    parser.add_argument("--time", action="store_true", help="only how long a sweep takes")
    parser.add_argument("--page", action="store_true", help="write docs/users/accuracy.md")
    options = parser.parse_args()
    films = options.films.split(",")
    if not set(films) <= set(FILMS):
        parser.error(f"--films={options.films}: expected some of {','.join(FILMS)}")
    seeds = range(options.first, options.first + options.scenes)
    rates = [float(word) for word in options.rates.split(",")]
    if options.page:
        write_page(options.processes)
    elif options.time:
        print(sweep_times())
    elif options.rooms == "glossy":
        print(in_glossy_rooms(seeds, rates, options.processes))
    else:
        print(varnished(seeds, rates, films, options.processes))


if __name__ == "__main__":
    main()
