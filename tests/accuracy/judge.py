"""What packets of a running daemon are judged by; live.py runs the daemons.

All errors are of a packet against the light at its own capture time. Lights and ambient light are
compared in the scene's frame, so that a turn of the camera is no change of light.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from lightprobe import geometry
from lightprobe import sh as harmonics
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, EstimateFlag, LightFlag, flag_names
from lightprobe.evaluate.metrics import relighting, relighting_relative, stated_error
from lightprobe.geometry import Array
from lightprobe.lamp import Lamp
from lightprobe.sim.scene import MapTruth, Scene
from numpy.typing import ArrayLike

#: Wrong and healthy: off by more than the first, states less than the second, and no flag...
WRONG, STATED = 0.10, 0.03
#: ...but this one, which tells of the list, not of an error.
HARMLESS = EstimateFlag.MORE_LIGHTS
#: Shares travel as whole permille: half of one may be stated as none.
WIRE = 0.0005
#: A lamp is listed when a light lies so near, with so much of its light, or marked as clipped.
NEAR_DEG, SHARE = 10.0, 0.1
#: A sun: a lamp no larger than this that makes so much of all light.
SUN_RADIUS_DEG, SUN_SHARE = 3.5, 0.2
#: Normals of steps of AMBIENT; errors take all 642.
_COARSE = geometry.sphere_normals(2)


@dataclass(frozen=True)
class Packet:
    """An estimate, and how the camera was turned when it was captured."""

    estimate: Estimate
    rotation: ArrayLike  # quaternion w, x, y, z, camera to scene
    captured_s: float = 0.0  # in the simulated world's time

    @property
    def turn(self) -> Array:
        """Matrix from the scene's frame to the packet's."""
        if self.estimate.frame == "WORLD":  # the scene's, as what sends poses has it
            return np.eye(3)
        return geometry.rotation_matrix(self.rotation).T


@dataclass(frozen=True, eq=False)
class Light:
    """The truth of a scene whose lamps do not change, in the scene's frame."""

    normals: Array  # (642, 3)
    irradiance: Array  # (642, 3)
    lamps: tuple[Lamp, ...] | None  # None: no closed forms, as of panoramas
    sun: Lamp | None

    @classmethod
    def of(cls, scene: Scene) -> Light:
        """Sum up a scene with all lamps on."""
        truth = scene.truth(np.ones(len(scene.lamps)))
        normals = geometry.sphere_normals()
        irradiance = truth.irradiance(normals)
        small = [lamp for lamp in truth.lamps if lamp.radius_deg <= SUN_RADIUS_DEG]
        sun = max(small, key=_strength, default=None)
        if sun is not None and _strength(sun) < SUN_SHARE * 4 * luminance(irradiance).mean():
            sun = None  # four times the mean irradiance: the radiance of the whole sphere
        exact = not isinstance(truth, MapTruth) or scene.name == "room"
        return cls(normals, irradiance, truth.lamps if exact else None, sun)


@dataclass(frozen=True)
class Coverage:
    """Shares of values within 1 and 3 stated sigma; None where none was stated."""

    count: int
    within_1: float | None
    within_3: float | None

    @classmethod
    def of(cls, ratios: Iterable[float]) -> Coverage:
        """Of errors divided by their sigmas."""
        found = np.array([ratio for ratio in ratios if not np.isnan(ratio)])
        if not len(found):
            return cls(0, None, None)
        return cls(len(found), float(np.mean(found <= 1)), float(np.mean(found <= 3)))


@dataclass(frozen=True)
class Figures:
    """What one subscriber got; rates are per simulated second."""

    packets: int
    packets_per_s: float
    error_median: float  # relighting, MAE of the largest true irradiance
    error_p90: float
    wrong_and_healthy: float  # share of the packets
    healthy: float  # share without a flag that tells of an error
    flags: dict[str, float]  # share of the packets that carry each
    births_per_s: float  # lights that were not in the packet before
    ambient_step: float  # largest mean change of AMBIENT's irradiance, of the mean irradiance
    sun_listed: float | None  # share of the packets; None: the scene has no sun
    direction: Coverage  # only where lamps have closed forms
    irradiance: Coverage
    relighting: Coverage  # error and statement: root mean square over normals, of the mean


def judge(
    light_at: Callable[[Packet], Light],
    packets: Sequence[Packet],
    seconds: float,
    harmless: int = HARMLESS,
    bounds_count: bool = True,
) -> Figures:
    """Sum up what came in `seconds`; `light_at`: the truth when a packet was captured.

    `harmless`: flags that a healthy packet may carry. `bounds_count`: a sun is listed by a lamp
    that clips, however little of the sun's light it has; not with a ring, which tells the rest.
    """
    lights = [light_at(packet) for packet in packets]
    pairs = list(zip(lights, packets, strict=True))
    errors = [_relighting(*pair) for pair in pairs]
    maes = [mae for mae, _ in errors]
    wrong = [mae > WRONG and _seems_fine(p, harmless) for mae, p in zip(maes, packets, strict=True)]
    matches = [match for pair in pairs for match in _matches(*pair)]
    flags = Counter(name for packet in packets for name in flag_names(packet.estimate.flags))
    suns = [_lists(packet, light.sun, bounds_count) for light, packet in pairs if light.sun]
    count = max(len(packets), 1)
    return Figures(
        packets=len(packets),
        packets_per_s=len(packets) / seconds,
        error_median=float(np.median(maes)) if maes else float("nan"),
        error_p90=float(np.quantile(maes, 0.9)) if maes else float("nan"),
        wrong_and_healthy=sum(wrong) / count,
        healthy=sum(_healthy(p, harmless) for p in packets) / count,
        flags={name: number / count for name, number in sorted(flags.items())},
        births_per_s=births(packets) / seconds,
        ambient_step=ambient_step(packets, float(luminance(lights[0].irradiance).mean()))
        if lights
        else float("nan"),
        sun_listed=float(np.mean(suns)) if suns else None,
        direction=Coverage.of(match[0] for match in matches),
        irradiance=Coverage.of(match[1] for match in matches),
        relighting=Coverage.of(
            _ratio(rms, stated_error(packet.estimate), WIRE)
            for (_, rms), packet in zip(errors, packets, strict=True)
        ),
    )


def births(packets: Sequence[Packet]) -> int:
    """Lights whose id the packet before did not list."""
    ids = [{light.id for light in packet.estimate.lights} for packet in packets]
    return sum(len(after - before) for before, after in pairwise(ids))


def ambient_step(packets: Sequence[Packet], mean_irradiance: float) -> float:
    """Largest mean change of AMBIENT's irradiance between two packets, in the scene's frame."""
    seen = [
        luminance(harmonics.irradiance(p.estimate.sh.coefficients, _COARSE @ p.turn.T))
        for p in packets
    ]
    return (
        max((float(np.abs(b - a).mean()) for a, b in pairwise(seen)), default=0) / mean_irradiance
    )


def _relighting(light: Light, packet: Packet) -> tuple[float, float]:
    """MAE of the largest irradiance; and root mean square of the luminance, of its mean."""
    found = packet.estimate.irradiance(light.normals @ packet.turn.T)
    mae, _ = relighting(light.irradiance, found)
    return mae, relighting_relative(light.irradiance, found)


def _healthy(packet: Packet, harmless: int) -> bool:
    return not packet.estimate.flags & ~harmless


def _seems_fine(packet: Packet, harmless: int) -> bool:
    stated = stated_error(packet.estimate)
    return stated is not None and stated < STATED and _healthy(packet, harmless)


def _lists(packet: Packet, sun: Lamp, bounds_count: bool) -> bool:
    near, direction = np.cos(np.radians(NEAR_DEG)), packet.turn @ sun.direction
    least = SHARE * _strength(sun)
    return any(
        light.direction @ direction > near
        and (
            (bounds_count and light.flags & LightFlag.CLIPPED)
            or luminance(light.irradiance) > least
        )
        for light in packet.estimate.lights
    )


def _matches(light: Light, packet: Packet) -> list[tuple[float, float]]:
    """Error of direction and of irradiance in stated sigmas, of each lamp that was found."""
    if light.lamps is None:
        return []
    lights = packet.estimate.lights
    true = [packet.turn @ lamp.direction for lamp in light.lamps]
    ratios = []
    for i, j, angle_deg in geometry.match_directions(true, [found.direction for found in lights]):
        found, lamp = lights[j], light.lamps[i]
        sigma = None if found.irradiance_sigma is None else luminance(found.irradiance_sigma)
        error, least = abs(luminance(found.irradiance) - _strength(lamp)), WIRE * _strength(lamp)
        ratios.append((_ratio(angle_deg, found.direction_sigma_deg), _ratio(error, sigma, least)))
    return ratios


def _ratio(error: float, sigma: float | None, least: float = 1e-6) -> float:
    """NaN when no sigma is stated; `least`: what the wire can state."""
    return float("nan") if sigma is None else float(error / max(sigma, least))


def _strength(lamp: Lamp) -> float:
    return float(luminance(lamp.irradiance))
