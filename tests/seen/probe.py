"""A probe in a panorama: simulated camera, daemon, and its packet."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from lightprobe.estimate import Estimate, EstimateFlag, flag_names
from lightprobe.geometry import Array
from lightprobe.imaging import camera as lenses
from lightprobe.imaging import image
from lightprobe.reflection_map import ReflectionMap
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.exposure import median_luminance
from lightprobe.sim.live import LiveClient, LiveProbe
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription

#: The simulated camera sees the room at this median luminance; full scale at 1 s is 1.
_MEDIAN = 30.0
_PICTURE_PX = (1920, 960)
#: Simulated seconds until the daemon has chosen its exposures and seen all of them several times.
_SETTLE_S = 6.0


@dataclass(frozen=True, eq=False)
class Packet:
    """What the probe says, in the panorama's units."""

    estimate: Estimate  # AMBIENT of order 4, and lamps
    areas: Estimate  # the same light with area lights listed
    ambient: ReflectionMap  # of 64 texels, without the lamps
    total: ReflectionMap  # with them

    @property
    def summary(self) -> str:
        """For the log."""
        flags = flag_names(self.estimate.flags) or ["healthy"]
        lamps, all_lights = (
            ", ".join(f"{light.angular_radius_deg:.1f}°" for light in one.lights)
            for one in (self.estimate, self.areas)
        )
        return f"lamps {lamps}; with area lights {all_lights}; {' '.join(flags)}"


def measure(panorama: Array) -> Packet:
    """What a probe measures there: JPEG frames of a 360° camera, exposures by the daemon.

    In simulated time: other programs on this machine change nothing.
    """
    factor = _MEDIAN / float(median_luminance(np.float32(panorama)))
    with tempfile.TemporaryDirectory(prefix="lp-") as folder:
        path = Path(folder) / "room.pfm"
        image.write_pfm(path, np.float32(panorama * factor))
        world = World(scenes.load([str(path)]), Behaviour(act_s=0), None)
    camera = SimulatedCamera(world, lenses.load("equirect"), _PICTURE_PX)
    with LiveProbe(camera, ["--reflection-map=64"]) as live:
        ambient, total = (live.client(_wish(kind)) for kind in ("AMBIENT", "TOTAL"))
        areas = live.client(Subscription(sh_order=4, max_lights=8, area_lights=True))
        live.run(_SETTLE_S)
    estimates = (scaled(_newest(client), 1 / factor) for client in (ambient, areas))
    maps = (scaled_map(_newest_map(client), 1 / factor) for client in (ambient, total))
    return Packet(*estimates, *maps)


def _wish(kind: str) -> Subscription:
    return Subscription(
        sh_order=4, max_lights=8, reflection_map_size=64, reflection_map_kind=kind,  # type: ignore[arg-type]
    )  # fmt: skip


def _newest(client: LiveClient) -> Estimate:
    """Of those that are made of all exposures."""
    whole = (e for e in client.estimates if EstimateFlag.BRACKET_INCOMPLETE not in e.flags)
    return list(whole)[-1]


def _newest_map(client: LiveClient) -> ReflectionMap:
    return [r.message for r in client.received if isinstance(r.message, ReflectionMap)][-1]


def scaled(estimate: Estimate, factor: float) -> Estimate:
    """The same light in other units."""
    lights = tuple(replace(one, irradiance=factor * one.irradiance) for one in estimate.lights)
    ambient = replace(estimate.sh, coefficients=factor * estimate.sh.coefficients)
    return replace(estimate, lights=lights, sh=ambient)


def scaled_map(found: ReflectionMap, factor: float) -> ReflectionMap:
    """The same map in other units."""
    return replace(found, radiance=found.radiance * np.float32(factor))
