"""A probe in a panorama: simulated camera, daemon, and its packet."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from lightprobe import daemon
from lightprobe.cli.export import receive
from lightprobe.estimate import Estimate, flag_names
from lightprobe.geometry import Array
from lightprobe.imaging import image
from lightprobe.reflection_map import ReflectionMap
from lightprobe.sim.exposure import median_luminance
from lightprobe.wire import Subscription

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
#: The simulated camera sees the room at this median luminance; full scale at 1 s is 1.
_MEDIAN = 30.0
_SETTLE_S, _WAIT_S = 6.0, 60.0


@dataclass(frozen=True, eq=False)
class Packet:
    """What the probe says, in the panorama's units."""

    estimate: Estimate  # AMBIENT of order 4, and lamps
    ambient: ReflectionMap  # of 64 texels, without the lamps
    total: ReflectionMap  # with them

    @property
    def summary(self) -> str:
        """For the log."""
        flags = flag_names(self.estimate.flags) or ["healthy"]
        sizes = ", ".join(f"{light.angular_radius_deg:.1f}°" for light in self.estimate.lights)
        return f"{len(self.estimate.lights)} lamps ({sizes}), {' '.join(flags)}"


def measure(panorama: Array) -> Packet:
    """What a probe measures there: JPEG frames of a 360° camera, exposures by the daemon."""
    factor = _MEDIAN / float(median_luminance(np.float32(panorama)))
    with tempfile.TemporaryDirectory(prefix="lp-") as name:
        folder = Path(name)
        image.write_pfm(str(folder / "room.pfm"), np.float32(panorama * factor))
        command = [
            LIGHTPROBE, "simulate", "--socket", folder / "sim", "--act-s", "0",
            "--scenes", folder / "room.pfm", "--median-radiance", "0",
        ]  # fmt: skip
        simulator = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        uri = f"unix:{folder / 'probe'}"
        arguments = [f"--source=sim:{folder / 'sim'}", f"--publish={uri}", "--reflection-map=64"]
        try:
            with daemon.Daemon(arguments, folder / "log"):
                time.sleep(_SETTLE_S)
                estimate, ambient = _receive(uri, "AMBIENT")
                _, total = _receive(uri, "TOTAL")
        finally:
            simulator.terminate()
            simulator.wait()
    return Packet(
        _scaled(estimate, 1 / factor), _scaled_map(ambient, 1 / factor),
        _scaled_map(total, 1 / factor),
    )  # fmt: skip


def _receive(uri: str, kind: str) -> tuple[Estimate, ReflectionMap]:
    wish = Subscription(
        sh_order=4, max_lights=8, reflection_map_size=64, reflection_map_kind=kind,  # type: ignore[arg-type]
    )  # fmt: skip
    estimate, found = receive(uri, wish, _WAIT_S)
    assert found is not None
    return estimate, found


def _scaled(estimate: Estimate, factor: float) -> Estimate:
    lights = tuple(replace(one, irradiance=factor * one.irradiance) for one in estimate.lights)
    ambient = replace(estimate.sh, coefficients=factor * estimate.sh.coefficients)
    return replace(estimate, lights=lights, sh=ambient)


def _scaled_map(found: ReflectionMap, factor: float) -> ReflectionMap:
    return replace(found, radiance=found.radiance * np.float32(factor))
