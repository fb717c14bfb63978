"""`make trade`: what each choice costs, and what it brings; what `lightprobe trade` answers from.

A simulated camera shows each scene to a daemon (simulated time): with each preset and picture size,
and with one client for each model of the light that a packet can hold. That camera exposes as
shortly as the daemon wants, so that few lamps clip; what a webcam (100 µs at least) does not see,
and what the ring of light sensors adds, is measured apart. Errors are of what an app draws by the
packet (drawn.py). Of a model and of a map it is what they leave out: what is more than with all
that a packet can hold, as variances, scene by scene. Bytes are those that clients read. Processor
time is a ratio to a plain decode of the same pictures in the same process (timing.py).

Writes host_py/lightprobe/trade.json, and parts of docs/users/trade.md with its plot.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import cv2
import drawn
import frames
import numpy as np
import timing
import trade_page
from lightprobe.imaging import camera as lenses
from lightprobe.reflection_map import SIZES, ReflectionMap
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.exposure import ExposureLimits
from lightprobe.sim.live import LiveClient, LiveProbe
from lightprobe.sim.scene import Scene
from lightprobe.sim.world import Behaviour, World
from lightprobe.trade import DRAWS, SIGHTS, TABLE
from lightprobe.wire import Subscription
from rich.console import Console
from rich.progress import Progress

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "accuracy"))
import recording

PRESETS = ("fast", "balanced", "accurate")
#: Pictures: equirectangular, 4:2:0, as bench/frames.py names their kinds.
WIDTHS_PX = (960, 1920)
DEFAULT = ("balanced", 1920)
#: What sees the light: a camera of any exposure, a webcam, a webcam with the ring.
ANY, WEBCAM, RING = SIGHTS
LIMITS = {ANY: ExposureLimits(0.05, 33000.0, 0.0), WEBCAM: ExposureLimits()}
SCENES = ("room", "procedural:4", "blender")
LIGHTS, ORDERS = (0, 1, 2, 4, 8), (0, 1, 2, 3, 4)
#: Until exposures, map and lamps have settled; until a packet of each client has come.
_SETTLE_S, _JUDGED_S, _RATE_HZ = 4.0, 1.0, 10.0
_MEDIAN_RADIANCE = 30.0
#: All that a packet can say.
_RICHEST = Subscription(
    sh_order=4, max_lights=8, area_lights=True, smoothing="RAW", health_period_ms=0,
    reflection_map_size=64, reflection_map_rate_hz=30,
)  # fmt: skip

Errors = dict[str, float]


@dataclass(frozen=True)
class Case:
    """One daemon before one scene."""

    scene: Scene
    preset: str = DEFAULT[0]
    width_px: int = DEFAULT[1]
    sight: str = ANY

    @property
    def asks_everything(self) -> bool:
        """Whether its clients ask for every model of the light."""
        return (self.preset, self.width_px, self.sight) == (*DEFAULT, ANY)

    @property
    def arguments(self) -> tuple[str, ...]:
        """More of the daemon's."""
        return (f"--preset={self.preset}", "--reflection-map=64", "--brackets=4")


@dataclass(frozen=True)
class Found:
    """What came of it."""

    measuring: Errors  # of the richest packet, with the largest map
    models: dict[tuple[int, int, bool], tuple[float, Errors]]  # bytes of a packet, left out
    maps: dict[int, tuple[float, Errors]]  # bytes of a map, left out


def wishes() -> dict[tuple[int, int, bool], Subscription]:
    """Give every model of the light: order, lights, whether area lights are listed."""
    return {
        (order, lights, area): Subscription(
            sh_order=order, max_lights=lights, area_lights=area, smoothing="RAW",
            health_period_ms=0,
        )
        for order, lights, area in product(ORDERS, LIGHTS, (False, True))
        if lights or not area
    }  # fmt: skip


def _newest_map(client: LiveClient) -> ReflectionMap:
    return next(
        one.message for one in reversed(client.received) if isinstance(one.message, ReflectionMap)
    )


def _counts(client: LiveClient) -> tuple[int, int, int]:
    """Bytes, estimates, maps so far."""
    maps = sum(isinstance(one.message, ReflectionMap) for one in client.received)
    return client.bytes_received, len(client.estimates), maps


def _truth(scene: Scene) -> drawn.Truth:
    powers = np.ones(len(scene.lamps))
    picture = scene.render(drawn.WIDTH_PX, drawn.WIDTH_PX // 2).compose(powers)
    return drawn.Truth.of(scene.truth(powers).irradiance(drawn.NORMALS), picture)


def run(case: Case) -> Found:
    """Show a scene to a daemon and judge what its clients get."""
    cv2.setNumThreads(1)
    return _with_ring(case) if case.sight == RING else _by_camera(case)


def _with_ring(case: Case) -> Found:
    size_px = (case.width_px, case.width_px // 2)
    got = recording.record(
        recording.Run(
            case.scene, judged_s=_JUDGED_S, size_px=size_px, daemon_arguments=case.arguments,
            rate_hz=_RATE_HZ, ring=True, wishes={"raw": _RICHEST},
        )
    )  # fmt: skip
    packet, mirrored = got.maps["raw"][-1]
    return Found(_truth(got.world.scenes[0]).errors(packet.estimate, mirrored), {}, {})


def _by_camera(case: Case) -> Found:
    world = World([case.scene], Behaviour(act_s=0), median_radiance=_MEDIAN_RADIANCE)
    size_px = (case.width_px, case.width_px // 2)
    camera = SimulatedCamera(
        world,
        lenses.load("equirect"),
        size_px,
        rate_hz=_RATE_HZ,
        limits=LIMITS[case.sight],
    )
    truth = _truth(world.scenes[0])
    asked = wishes() if case.asks_everything else {}
    with LiveProbe(camera, case.arguments) as probe:
        richest = probe.client(_RICHEST)
        clients = {key: probe.client(wish) for key, wish in asked.items()}
        mirrors = {
            size: probe.client(
                Subscription(health_period_ms=0, reflection_map_size=size,
                             reflection_map_rate_hz=30)
            )
            for size in SIZES if case.asks_everything
        }  # fmt: skip
        plain = probe.client(Subscription(health_period_ms=0))
        probe.run(_SETTLE_S)
        everybody = [*clients.values(), *mirrors.values(), plain]
        before = {id(client): _counts(client) for client in everybody}
        probe.run(_JUDGED_S)

        def sizes(client: LiveClient) -> tuple[float, float, float]:
            return tuple(
                now - then for now, then in zip(_counts(client), before[id(client)], strict=True)
            )  # type: ignore[return-value]

        measuring = truth.errors(richest.estimates[-1], _newest_map(richest))

        def left_out(client: LiveClient, mirrored: ReflectionMap | None = None) -> Errors:
            errors = truth.errors(client.estimates[-1], mirrored)
            return {
                name: math.sqrt(max(0.0, error**2 - measuring[name] ** 2))
                for name, error in errors.items()
            }

        models = {
            key: (sizes(client)[0] / sizes(client)[1], left_out(client))
            for key, client in clients.items()
        }
        packet = sizes(plain)[0] / sizes(plain)[1]
        maps = {}
        for size, client in mirrors.items():
            total, estimates, count = sizes(client)
            maps[size] = (
                (total - packet * estimates) / count,
                left_out(client, _newest_map(client)),
            )
    return Found(measuring, models, maps)


def summed(some: Sequence[Errors]) -> dict[str, list[float]]:
    """Median and worst of each way to draw."""
    return {
        name: [_short(np.median([one[name] for one in some])),
               _short(np.max([one[name] for one in some]))]
        for name in DRAWS
    }  # fmt: skip


def _short(value: float) -> float:
    return float(f"{float(value):.3g}")


@dataclass(frozen=True)
class Speeds:
    """Processor time."""

    ratios: dict[tuple[str, int], float]  # to a plain decode of its size, by preset and width
    maps_ms: dict[int, float]  # by size
    decodes_ms: dict[int, float]  # by width


def speeds(rounds: int, folder: Path) -> Speeds:
    """Time presets and maps on pictures of the scenes."""
    some = scenes.load(SCENES)
    ratios: dict[tuple[str, int], float] = {}
    decodes_ms: dict[int, float] = {}
    maps_ms: dict[int, float] = {}
    for width in WIDTHS_PX:
        kind = frames.KINDS[f"equirect_{width}x{width // 2}_420"]
        files = frames.make(kind, folder, some)
        found = timing.time_some(kind, files, rounds, *PRESETS, "stages")
        ratios |= {(preset, width): found[preset]["ratio"] for preset in PRESETS}
        decodes_ms[width] = found[timing.YARDSTICK]["median_ms"]
        if width == DEFAULT[1]:
            maps_ms = {size: found[f"stage_reflection_map_{size}"]["median_ms"] for size in SIZES}
    return Speeds(ratios, maps_ms, decodes_ms)


def measure(rounds: int, processes: int) -> dict[str, object]:
    """Give the whole table."""
    some = scenes.load(SCENES)
    todo = [Case(*one) for one in product(some, PRESETS, WIDTHS_PX)]
    todo += [Case(scene, sight=sight) for scene, sight in product(some, (WEBCAM, RING))]
    with (
        Progress(console=Console(stderr=True)) as bar,
        multiprocessing.get_context("spawn").Pool(processes, maxtasksperchild=8) as pool,
    ):
        ordered = pool.imap(run, todo)
        found = list(bar.track(ordered, total=len(todo), description="scenes"))
    print("trade: processor time", file=sys.stderr)
    with tempfile.TemporaryDirectory() as folder:
        times = speeds(rounds, Path(folder))
    plain_ms = times.decodes_ms[DEFAULT[1]]
    pairs = list(zip(todo, found, strict=True))
    of_default = [one for case, one in pairs if case.asks_everything]

    def errors(preset: str, width: int, sight: str) -> dict[str, list[float]]:
        wanted = preset, width, sight
        return summed([one.measuring for case, one in pairs
                       if (case.preset, case.width_px, case.sight) == wanted])  # fmt: skip

    return {
        "scenes": len(of_default),
        "default": {"preset": DEFAULT[0], "width_px": DEFAULT[1]},
        "sights": [
            {"sight": sight, "errors": errors(*DEFAULT, sight)} for sight in (ANY, WEBCAM, RING)
        ],
        "measuring": [
            {"preset": preset, "width_px": width,
             "decodes": _short(times.ratios[preset, width] * times.decodes_ms[width] / plain_ms),
             "errors": errors(preset, width, ANY)}
            for width, preset in product(WIDTHS_PX, PRESETS)
        ],
        "models": [
            {"sh_order": key[0], "max_lights": key[1], "area_lights": key[2],
             "bytes": round(np.median([one.models[key][0] for one in of_default])),
             "errors": summed([one.models[key][1] for one in of_default])}
            for key in wishes()
        ],
        "maps": [
            {"size": size, "bytes": round(np.median([one.maps[size][0] for one in of_default])),
             "decodes": _short(times.maps_ms[size] / plain_ms),
             "errors": summed([one.maps[size][1] for one in of_default])}
            for size in SIZES
        ],
    }  # fmt: skip


def _text(table: dict[str, object]) -> str:
    """JSON, a row of the table on a line."""
    parts = []
    for name, value in table.items():
        if isinstance(value, list):
            rows = ",\n  ".join(json.dumps(row) for row in value)
            parts.append(f'"{name}": [\n  {rows}\n ]')
        else:
            parts.append(f'"{name}": {json.dumps(value)}')
    return "{\n " + ",\n ".join(parts) + "\n}\n"


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=60, help="pictures that are timed (60)")
    parser.add_argument("--processes", type=int, default=2, help="daemons at a time (2)")
    parser.add_argument("--page", action="store_true", help="write page and plot again, no more")
    options = parser.parse_args()
    if not options.page:
        TABLE.write_text(_text(measure(options.rounds, options.processes)))
    trade_page.write()


if __name__ == "__main__":
    main()
