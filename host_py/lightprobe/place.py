"""Light beside the probe: lamps re-aimed and re-scaled, ambient light moved through the room.

The formula is in docs/users/conventions.md, "Light at a place". Lamps whose distance is known shine
from where they are, and the SH change with the place where the room is known. What is not known
stays as the probe sees it, and says so: sigmas are None where nothing bounds the change.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from lightprobe.colour import luminance
from lightprobe.fallback import mean_irradiance
from lightprobe.geometry import Array, normalize
from lightprobe.room import moved as moved_sh
from lightprobe.room import room_at

if TYPE_CHECKING:
    from lightprobe.estimate import Estimate, Light

#: Relative change of the ambient light with every metre from the probe where the room is not known,
#: 1 sigma (docs/users/places.md, second row of the table).
AMBIENT_CHANGE_PER_M = 0.1
#: Relative change of a lamp's light with the angle at which it leaves the lamp, 1 sigma for each
#: radian: that of a flat panel (Lambert's cosine, tan 31 degrees); a globe's is 0.
EMISSION_CHANGE_PER_RAD = 0.6
#: No place is farther from the probe.
_FARTHEST_M = 1e12
_UP = np.array([0.0, 1.0, 0.0])


def light_at(light: Light, position_m: ArrayLike) -> Light:
    """Give a lamp as it is seen from `position_m`: (3,), metres from the probe, in its frame.

    The lamp is a ball at `distance_m`: its direction follows from geometry, its irradiance from the
    square of the distances, its angular radius from that of the ball. A place within the ball is
    taken to be on it. A lamp without distance stays where it is; its sigmas are None unless
    `nearest_m` bounds how much it can move. Raises ValueError where the position is none.
    """
    offset_m = _place(position_m)
    away_m = float(np.linalg.norm(offset_m))
    if away_m == 0:
        return light
    if light.distance_m is None:
        return _far(light, away_m)
    there_m = light.distance_m * light.direction - offset_m
    ball_m = light.distance_m * math.sin(math.radians(min(light.angular_radius_deg, 90.0)))
    from_there_m = max(float(np.linalg.norm(there_m)), ball_m, 1e-6)
    direction = normalize(there_m) if there_m.any() else light.direction
    nearer = light.distance_m / from_there_m
    radius_deg = math.degrees(math.asin(min(1.0, ball_m / from_there_m)))
    along = float(direction @ light.direction)
    across = math.sqrt(max(0.0, 1 - along * along))
    relative = light.distance_sigma
    distance_sigma_m = None if relative is None else relative * light.distance_m
    turned = None if distance_sigma_m is None else distance_sigma_m * across / from_there_m
    # irradiance goes with (D / |D d - p|)^2: its relative derivative by D; and a lamp shines there
    # with another side
    scaled = (
        None
        if relative is None
        else math.hypot(2 * relative * abs(1 - nearer * along), _emission(light, direction))
    )
    return replace(
        light,
        direction=direction,
        irradiance=light.irradiance * nearer**2,
        angular_radius_deg=radius_deg,
        distance_m=from_there_m,
        distance_sigma=None if relative is None else relative * nearer * abs(along),
        direction_sigma_deg=_both(
            None if light.direction_sigma_deg is None else light.direction_sigma_deg * nearer,
            None if turned is None else math.degrees(turned) / math.sqrt(2),
        ),
        irradiance_sigma=_strength_sigma(light, scaled, nearer**2),
        half_angle_deg=_half_angles(light, nearer),
        axis=_across(light.axis, direction),
    )


def estimate_at(estimate: Estimate, position_m: ArrayLike) -> Estimate:
    """Give the light at `position_m` (3,): metres from the probe, axes of `estimate.frame`.

    Only an estimate whose SH are AMBIENT can be moved: a TOTAL has its lamps in the SH. Raises
    ValueError. Where the room is known, the SH change with the place (best with order 4), else they
    stay as they are. `relighting_sigma` is wider; it is None where a lamp's distance is not known.
    """
    offset_m = _place(position_m)
    away_m = float(np.linalg.norm(offset_m))
    if away_m == 0:
        return estimate
    if estimate.sh.kind == "TOTAL":
        raise ValueError("estimate: at: lamps are in the SH: subscribe to AMBIENT")
    lights = tuple(light_at(light, offset_m) for light in estimate.lights)
    moved = replace(estimate, lights=lights, relighting_sigma=_sigma(estimate, lights, away_m))
    if (room := estimate.room) is not None:
        sh = replace(estimate.sh, coefficients=moved_sh(estimate.sh.coefficients, room, offset_m))
        moved = replace(moved, sh=sh, room=room_at(room, offset_m))
    up = float(luminance(moved.irradiance(_UP)))
    shared = tuple(_with_shadow(light, up) for light in lights)
    return replace(moved, lights=tuple(sorted(shared, key=_strength, reverse=True)))


def _place(position_m: ArrayLike) -> Array:
    """Give a place as an array (3,); ValueError where it is none, or beyond all rooms."""
    offset_m = np.asarray(position_m, dtype=np.float64)
    if offset_m.shape != (3,) or not (np.abs(offset_m) <= _FARTHEST_M).all():  # NaN, too
        raise ValueError(f"estimate: at {position_m!r}: expected x, y, z in metres")
    return offset_m


def _strength(light: Light) -> float:
    return float(luminance(light.irradiance))


def _far(light: Light, away_m: float) -> Light:
    """Give a lamp without distance: its sigmas hold what the nearest place allows, or are None."""
    if light.nearest_m is None or light.nearest_m <= 3 * away_m:
        return replace(light, direction_sigma_deg=None, irradiance_sigma=None, shadow_strength=None)
    share = away_m / light.nearest_m / 3  # nearest_m is 3 sigma
    return replace(
        light,
        nearest_m=light.nearest_m - away_m,
        direction_sigma_deg=_both(light.direction_sigma_deg, math.degrees(share)),
        irradiance_sigma=_strength_sigma(light, 2 * share, 1.0),
    )


def _emission(light: Light, direction: Array) -> float:
    """Relative sigma of a lamp's light that reaches a place from this direction: another side's."""
    along = min(1.0, max(-1.0, float(direction @ light.direction)))
    return EMISSION_CHANGE_PER_RAD * math.acos(along)


def _both(a: float | None, b: float | None) -> float | None:
    """Join two independent sigmas; one that is not known hides the other."""
    return None if a is None or b is None else math.hypot(a, b)


def _strength_sigma(light: Light, relative: float | None, scale: float) -> Array | None:
    if light.irradiance_sigma is None or relative is None:
        return None
    return np.asarray(scale * np.hypot(light.irradiance_sigma, relative * light.irradiance))


def _half_angles(light: Light, nearer: float) -> tuple[float, float] | None:
    if light.half_angle_deg is None:
        return None
    return tuple(
        math.degrees(math.atan(nearer * math.tan(math.radians(min(half, 89.0)))))
        for half in light.half_angle_deg
    )  # type: ignore[return-value]


def _across(axis: Array | None, direction: Array) -> Array | None:
    """Give what of an axis lies across the direction, as a unit vector."""
    if axis is None:
        return None
    rest = axis - (axis @ direction) * direction
    return normalize(rest) if float(np.linalg.norm(rest)) > 1e-6 else axis


def _sigma(estimate: Estimate, lights: tuple[Light, ...], away_m: float) -> float | None:
    """Relative sigma there: as measured, of the lamps' places, of the ambient light."""
    if estimate.relighting_sigma is None or any(light.irradiance_sigma is None for light in lights):
        return None
    here = [_sigma_of(light) for light in estimate.lights]
    there = [_sigma_of(light) for light in lights]
    whole = mean_irradiance(estimate)
    if whole <= 0:
        return None
    # Panels under one ceiling shine alike: what their sides bring adds up, all else is independent.
    sides = [
        _emission(before, after.direction) * _strength(after)
        for before, after in zip(estimate.lights, lights, strict=True)
        if before.distance_m is not None
    ]
    alike = sum(sides) ** 2 - sum(side**2 for side in sides)
    # A lamp's mean over all normals is a quarter of its irradiance (docs/users/conventions.md).
    apart = sum(max(0.0, b * b - a * a) for a, b in zip(here, there, strict=True))
    grown = (apart + alike) / 16 / whole**2
    per_m = AMBIENT_CHANGE_PER_M if estimate.room is None else estimate.room.error_per_m
    ambient = per_m * away_m
    return math.sqrt(estimate.relighting_sigma**2 + grown + ambient**2)


def _sigma_of(light: Light) -> float:
    """Sigma of a lamp's luminance, with what its direction moves, in units of irradiance."""
    sigma = 0.0 if light.irradiance_sigma is None else float(luminance(light.irradiance_sigma))
    turn = math.radians(light.direction_sigma_deg or 0.0) * _strength(light)
    return math.hypot(sigma, turn)


def _with_shadow(light: Light, up: float) -> Light:
    """State its share of the light on a surface that faces up."""
    if light.shadow_strength is None or up <= 0:
        return replace(light, shadow_strength=None)
    share = max(0.0, float(light.direction[1])) * _strength(light) / up
    return replace(light, shadow_strength=min(1.0, share))
