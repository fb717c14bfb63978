"""Packets of a daemon before a simulated camera, in simulated time: no load changes them."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import multiprocessing
import os
import shlex
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from defects import DEFECTS
from judge import Packet
from kinds import KINDS, Kind
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.estimate import Estimate, Frame
from lightprobe.geometry import Array
from lightprobe.imaging.image import HDR_SUFFIXES
from lightprobe.reflection_map import ReflectionMap
from lightprobe.sim import response as responses
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.clock import START_NS
from lightprobe.sim.faults import Faults
from lightprobe.sim.head import Habits, Head, true_place, true_turn
from lightprobe.sim.illuminance import RingLight
from lightprobe.sim.lens_defects import LensDefects
from lightprobe.sim.live import LiveClient, LiveProbe
from lightprobe.sim.live_ring import LiveRing
from lightprobe.sim.pixel_defects import PixelDefects
from lightprobe.sim.processing import Processing
from lightprobe.sim.scene import PanoramaScene, Scene
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription

Figure = TypeVar("Figure")

#: Where a bare name is looked for besides: panoramas beside the checkout, if there are any.
MORE_PANORAMAS = Path(__file__).resolve().parents[3] / "shared/data/hdri"
#: Median radiance of panoramas: a quarter of full scale in 1/120 s, as outdoors; suns clip. Scenes
#: with exact lamps are as dim as rooms: their lamps fit into the shortest exposure, mostly.
OUTDOORS, INDOORS = 30.0, 4.0
SIZE_PX, RATE_HZ = (1920, 960), 30.0
#: Luminance of radiance 1 before a ring: its sensors then see 100 lx indoors to 10 000 lx outdoors.
RING_CD_M2_PER_UNIT = 10.0
#: Until the exposures have settled: so long, and so many frames.
SETTLE_S, SETTLE_FRAMES = 2.0, 20

EXPOSURES = {
    "reported": Faults(),
    "unreported": Faults(hide_exposure=1),
    "auto": Faults(hide_exposure=1, auto_exposure=1),
}
#: Those of cameras that are commanded: what tables show unless told.
COMMANDED = ("reported", "unreported")
SUBSCRIPTIONS = {
    "raw": Subscription(smoothing="RAW", max_lights=8, sh_order=4),
    "default": Subscription(),
}


@dataclass(frozen=True)
class Teller:
    """What tells the orientation besides the frames."""

    words: str
    kind: str  # as the daemon's --orientation has it
    faults: str = ""  # of the simulated sensor on the camera
    habits: Habits | None = None  # of the simulated app
    jumps: bool = False  # its world does: there is no truth to compare with
    places: bool = False  # the app says where the head is, too

    @property
    def wants_world(self) -> bool:
        """Subscribers ask for packets in its world."""
        return self.kind != "visual" and not self.jumps


ORIENTATIONS = {
    "visual": Teller("", "visual"),
    "sim": Teller("a sensor, 0.1°", "sim", "orientation_noise_deg=0.1"),
    "client": Teller("an app's poses, 0.1°", "client", habits=Habits()),
    "place": Teller(
        "an app's poses and places, 0.1°, 5 mm", "client", habits=Habits(memory_s=2), places=True
    ),
    "place-bad": Teller(
        "an app's poses and places, 0.3°, 10 mm", "client",
        habits=Habits(noise_deg=0.3, noise_m=0.01, memory_s=2), places=True,
    ),
    "spoiled": Teller(
        "an app's poses, 0.5°, 40 ms late, 40 % missing", "client",
        habits=Habits(noise_deg=0.5, transfer_ms=40, drop=0.4),
    ),
    "late": Teller(
        "a sensor that tells of 100 ms ago", "sim",
        "orientation_noise_deg=0.1&orientation_late_ms=100",
    ),
    "jumping": Teller(
        "a sensor that jumps by 10° every 2 s", "sim",
        "orientation_noise_deg=0.1&orientation_jump_deg=10&orientation_jump_s=2", jumps=True,
    ),
}  # fmt: skip


#: Two fisheye modules back to back, as many pixels to a degree as SIZE_PX.
MODULES = KINDS["square-modules"].files
#: The second of two cameras exposes so much later.
LATER_S = 0.008
#: Where highlights begin to bend, of full scale.
KNEE_AT = 0.7


@dataclass(frozen=True)
class Pair:
    """Two modules instead of one camera: how the second differs."""

    later_s: float = LATER_S
    sensitivity: tuple[float, float, float] = (1.0, 1.0, 1.0)  # R, G, B, against the first
    gamma: float = 1.0  # of its response, against the first: light to this power
    knee: float = 0.0  # full scale is so much more light, relative: highlights are compressed

    def response(self, first: Array) -> Array:
        """Linear light (256, 3) of each code of the second, by that of the first."""
        bent = np.maximum(first - KNEE_AT, 0) / (1 - KNEE_AT)
        return np.asarray(first**self.gamma + self.knee * bent**2)


@dataclass(frozen=True)
class Run:
    """One run of the daemon."""

    scene: Scene
    behaviour: Behaviour = field(default_factory=lambda: Behaviour(act_s=0))
    exposures: str = "reported"
    judged_s: float = 4.0
    size_px: tuple[int, int] = SIZE_PX
    daemon_arguments: tuple[str, ...] = ()
    faults: str = ""  # beside those of `exposures`, as `simulate --faults` has them
    rate_hz: float = RATE_HZ
    row_time_us: float = 0.0
    orientation: str = "visual"
    ring: bool = False  # with a ring of light sensors, calibrated to 3 %, beside the camera
    cameras: str = "equirect"  # of KINDS; lenses have pictures of the size that their files state
    pair: Pair | None = None  # two modules that differ, instead of `cameras`
    pixels: PixelDefects = field(default_factory=PixelDefects)  # of the sensors
    defects: str = "none"  # of DEFECTS; of all cameras, not of a pair
    stated: str | None = None  # instead of what `defects` states in the camera file
    film_deg: float | None = None  # angle of a polarizer that is fixed before the lens
    then: tuple[Scene, ...] = ()  # after `scene`, and so on in turns, behaviour.act_s each
    levels: tuple[float, ...] = (1.0,)  # of all light, in turns, behaviour.act_s each
    wishes: dict[str, Subscription] = field(default_factory=lambda: SUBSCRIPTIONS)  # "raw", …

    @property
    def kind(self) -> Kind:
        """Give the kind of the cameras."""
        return KINDS["square-modules" if self.pair else self.cameras]

    @property
    def settle_s(self) -> float:
        """Until the exposures have settled."""
        return max(SETTLE_S, SETTLE_FRAMES / self.rate_hz)

    @property
    def is_relative(self) -> bool:
        """No exposure is known: light has a scale of its own."""
        faults = EXPOSURES[self.exposures].merged(self.faults)
        return bool(faults.auto_exposure or (faults.ignore_exposure and faults.hide_exposure))

    @property
    def median_radiance(self) -> float:
        """What the scene is brought to."""
        return OUTDOORS if isinstance(self.scene, PanoramaScene) else INDOORS


@dataclass(frozen=True, eq=False)
class Recording:
    """The world, and what each subscriber got after the exposures had settled."""

    world: World
    packets: dict[str, list[Packet]]
    #: Reflection maps of subscribers that ask for some, each with the packet of the same light.
    maps: dict[str, list[tuple[Packet, ReflectionMap]]] = field(default_factory=dict)


def cameras(run: Run, world: World) -> list[SimulatedCamera]:
    """Give the cameras of a run: one, or several in one box."""
    defects, pair, found = DEFECTS[run.defects], run.pair, []
    known = None if defects.response is None else responses.parse(defects.response)
    for number, (lens, size_px) in enumerate(run.kind.seen(run.size_px)):
        differs = pair if number else None
        found.append(
            SimulatedCamera(
                world, lens, size_px, rate_hz=run.rate_hz, row_time_us=run.row_time_us,
                seed=number, sheet=None if run.film_deg is None else lens.sheet,
                phase_s=number * (pair.later_s if pair else LATER_S),
                white_balance=differs.sensitivity if differs else (1.0, 1.0, 1.0),
                response=differs.response(lens.response_table()) if differs else known,
                quality=defects.quality, processing=Processing().merged(defects.processing),
                lens_defects=LensDefects().merged(defects.lens_defects),
                pixels=replace(run.pixels, seed=run.pixels.seed + number),
            )
        )  # fmt: skip
    return found


def record(run: Run) -> Recording:
    """Run a daemon before a scene."""
    cv2.setNumThreads(1)
    scenes = World([run.scene, *run.then], median_radiance=run.median_radiance).scenes
    acts = [scene.scaled(level) for scene in scenes for level in run.levels]
    world = World(acts, run.behaviour)
    camera, *others = cameras(run, world)
    teller = ORIENTATIONS[run.orientation]
    faults = EXPOSURES[run.exposures].merged(run.faults).merged(teller.faults)
    arguments = (f"--orientation={teller.kind}", *run.daemon_arguments, *run.kind.daemon_arguments)
    frame: Frame = "WORLD" if teller.wants_world else "PROBE"
    with contextlib.ExitStack() as stack:
        stated = DEFECTS[run.defects].stated if run.stated is None else run.stated
        if stated and run.kind is not KINDS["equirect"]:
            raise UsageError(f"{run.defects}: what a camera file states is of equirect alone")
        if stated:
            file = stack.enter_context(tempfile.NamedTemporaryFile("w", suffix=".camera"))
            file.write(f"[camera]\nprojection = equirect\n{stated}")
            file.flush()
            arguments += (f"--camera={file.name}",)
        ring = stack.enter_context(LiveRing()) if run.ring else None
        if ring:
            known = None if run.is_relative else RING_CD_M2_PER_UNIT
            arguments += tuple(ring.daemon_arguments(known))
        probe = stack.enter_context(
            LiveProbe(camera, arguments, faults=faults, film_deg=run.film_deg, others=others)
        )
        if ring:
            light = RingLight(world, RING_CD_M2_PER_UNIT)
            ring.shine(lambda: light.lux(probe.link.state_now()))
            probe.apps.append(ring)
        clients = {
            name: probe.client(replace(wish, frame=frame)) for name, wish in run.wishes.items()
        }
        if teller.habits:
            placed = true_place(camera) if teller.places else None
            head = Head(clients["raw"], true_turn(camera), START_NS, teller.habits, placed)
            probe.apps.append(head)
        probe.run(run.settle_s)
        before = {name: len(client.estimates) for name, client in clients.items()}
        probe.run(run.judged_s)

        def packet(estimate: Estimate) -> Packet:
            t_s = probe.captured_s(estimate)
            return Packet(estimate, camera.true_rotation(world.at(t_s)), t_s)

        packets = {
            name: [packet(one) for one in client.estimates[before[name] :]]
            for name, client in clients.items()
        }
        maps = {name: _with_maps(packets[name], client) for name, client in clients.items()}
        return Recording(world, packets, maps)


def _with_maps(packets: Sequence[Packet], client: LiveClient) -> list[tuple[Packet, ReflectionMap]]:
    """Pair each map of a subscriber with its packet of the same light."""
    of = {one.estimate.sequence: one for one in packets}
    maps = [one.message for one in client.received if isinstance(one.message, ReflectionMap)]
    return [(of[one.sequence], one) for one in maps if one.sequence in of]


def all_figures(
    name: str,
    judged: Callable[[Any], list[Figure]],
    todo: Sequence[Any],
    said: Callable[[Figure], str],
    processes: int,
) -> list[Figure]:
    """Judge every case in a process of its own pool; progress on stderr, as `name`."""
    found: list[Figure] = []
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for done, some in enumerate(pool.imap_unordered(judged, todo), 1):
            found += some
            print(f"{name}: {done} of {len(todo)}: {said(some[0])}", file=sys.stderr, flush=True)
    return found


def find(names: Sequence[str]) -> list[Scene]:
    """Scenes as `lightprobe` names them, or panoramas by a part of their file's name."""
    found: list[Scene] = []
    for name in names:
        try:
            found += scenes.load([name])
        except LightprobeError:
            files = _panoramas(name)
            if not files:
                raise
            found += scenes.load(map(str, files))
    return found


def _panoramas(part: str) -> list[Path]:
    folders = [scenes.panorama_folder(), MORE_PANORAMAS]
    files = [file for folder in folders if folder.is_dir() for file in sorted(folder.iterdir())]
    return [file for file in files if file.suffix.lower() in HDR_SUFFIXES and part in file.stem]


def listed(known: Sequence[str], what: str) -> Callable[[str], list[str]]:
    """Give a parser of an option's comma-separated names."""

    def parse(text: str) -> list[str]:
        names = text.split(",")
        if unknown := [name for name in names if name not in known]:
            raise argparse.ArgumentTypeError(
                f"{what} {', '.join(unknown)}: known are {','.join(known)}"
            )
        return names

    return parse


def query(text: str) -> str:
    """Check an option's faults."""
    try:
        Faults().merged(text)
    except UsageError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def pixels(text: str) -> PixelDefects:
    """Parse an option's pixel defects."""
    try:
        return PixelDefects().merged(text)
    except UsageError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def size_px(text: str) -> tuple[int, int]:
    """Parse an option's picture size, as WxH."""
    try:
        width, height = map(int, text.split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: is to be as 960x480") from None
    return width, height


def add_options(parser: argparse.ArgumentParser, names: Sequence[str]) -> None:
    """What live.py and changes.py have in common; `names`: scenes unless told."""
    add = parser.add_argument
    add("--scene", nargs="+", default=list(names), metavar="NAME",
        help="as lightprobe simulate names them, or part of a panorama's file name")  # fmt: skip
    add("--exposures", type=listed(list(EXPOSURES), "exposures"), default=list(COMMANDED),
        metavar="KIND,…", help=f"of {','.join(EXPOSURES)}: whether frames tell theirs")  # fmt: skip
    add("--faults", type=query, default="", metavar="K=V&…",
        help="of the camera besides: --faults='drop=0.1&orientation_drop=0.5'")  # fmt: skip
    add("--daemon", type=Path, help="lightprobed to judge (default: of the build)")
    add("--daemon-args", type=shlex.split, default=[], metavar="'ARG …'",
        help="more options of the daemon: --daemon-args='--preset=fast'")  # fmt: skip
    add("--processes", type=int, default=2, help="runs at a time (default 2)")
    add("--json", action="store_true", help="print all figures instead of tables")


def add_cameras(parser: argparse.ArgumentParser) -> None:
    """What live.py and movers.py have in common."""
    lenses = "; ".join(f"{name}: {kind.words}" for name, kind in KINDS.items() if kind.words)
    parser.add_argument("--cameras", type=listed(list(KINDS), "cameras"), default=["equirect"],
        metavar="KIND,…", help="equirect, of --size (default), or lenses, whose pictures are as "
        f"large as their camera files state: {lenses}")  # fmt: skip


def use_daemon(path: Path | None) -> None:
    """Judge this lightprobed; UsageError when it is none."""
    if path is None:
        return
    if not (path.is_file() and os.access(path, os.X_OK)):
        raise UsageError(f"--daemon {path}: no program: build it first")
    os.environ["LIGHTPROBED"] = str(path.resolve())


def to_json(found: Sequence[Any]) -> str:
    """All fields of dataclasses; what is not finite is null."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: plain(one) for key, one in value.items()}
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return json.dumps([plain(asdict(one)) for one in found], indent=2)


def markdown(head: Sequence[str], body: Sequence[Sequence[str]]) -> str:
    """Table."""
    lines = [head, ["---"] * len(head), *body]
    return "\n".join("| " + " | ".join(row) + " |" for row in lines)
