"""All of an estimate's light as a number of lights: for renderers that know nothing else.

The lamps stay. The rest is cut into regions of the sphere, and each region becomes one light, from
its centre of light and as strong as all of it. A region that is cut is a rectangle of a map of
azimuth and elevation, and it is cut across one of its two axes:

* variance [VD]: the region in which light is farthest from its centre, so that as little of that is
  left as can be;
* median [D]: the region with the most light, across its longer side, into halves.

Sources: [D] Debevec, A Median Cut Algorithm for Light Probe Sampling, 2005; [VD] Viriyothai,
Debevec, Variance Minimization Light Probe Sampling, 2009.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.errors import UsageError
from lightprobe.estimate import Estimate, Light, SphericalHarmonics
from lightprobe.geometry import Array
from lightprobe.imaging.environment import lamps_alone, rest_beside
from lightprobe.reflection_map import ReflectionMap

Cut = Literal["variance", "median"]
CUTS: tuple[Cut, ...] = get_args(Cut)
MOST = 64
#: Width of the map that is cut.
_WIDTH_PX = 128


@dataclass(frozen=True, eq=False)
class _Region:
    """A rectangle of the map: rows and columns of its first pixel and after its last."""

    flux: Array  # (H, W): luminance times solid angle, of the whole map
    towards: Array  # (H, W, 3): centres of pixels times that
    rows: tuple[int, int]
    columns: tuple[int, int]

    def _part(self, of: Array) -> Array:
        return np.asarray(of[slice(*self.rows), slice(*self.columns)])

    @property
    def whole(self) -> float:
        """All of its light."""
        return float(self._part(self.flux).sum())

    @property
    def spread(self) -> float:
        """Light times the mean square of how far it is from its centre (chords)."""
        return float(_spread(self.whole, self._part(self.towards).sum(axis=(0, 1))))

    def cuts(self, axis: int) -> tuple[Array, Array]:
        """Cut across an axis after each pixel but the last: light before it, spread left."""
        other = 1 - axis
        flux = self._part(self.flux).sum(axis=other).cumsum()
        towards = self._part(self.towards).sum(axis=other).cumsum(axis=0)
        first = _spread(flux[:-1], towards[:-1])
        second = _spread(flux[-1] - flux[:-1], towards[-1] - towards[:-1])
        return flux[:-1], first + second

    def divided(self, axis: int, after: int) -> tuple[_Region, _Region]:
        """Cut after a pixel of an axis."""
        low, high = (self.rows, self.columns)[axis]
        ends = (low, low + after + 1), (low + after + 1, high)
        if axis == 0:
            return replace(self, rows=ends[0]), replace(self, rows=ends[1])
        return replace(self, columns=ends[0]), replace(self, columns=ends[1])

    def is_wide(self) -> bool:
        """Whether it is longer along a row than along a column, on the sphere."""
        (top, bottom), (left, right) = self.rows, self.columns
        height_px, width_px = self.flux.shape
        elevation = math.pi * (0.5 - (top + bottom) / 2 / height_px)
        around = 2 * math.pi * (right - left) / width_px * math.cos(elevation)
        return bool(around > math.pi * (bottom - top) / height_px)


def _spread(whole: Array | float, towards: Array) -> Array:
    """Σ F |d − c|² of unit vectors d with light F and centre c: Σ F − |Σ F d|²/Σ F."""
    square = np.sum(np.asarray(towards) ** 2, axis=-1)
    return np.asarray(whole - square / np.maximum(whole, 1e-300))


def _halved(region: _Region) -> tuple[_Region, ...]:
    axis = 1 if region.is_wide() else 0
    for one in (axis, 1 - axis):
        before, _ = region.cuts(one)
        if len(before):
            return region.divided(one, int(np.abs(before - region.whole / 2).argmin()))
    return (region,)


def _narrowed(region: _Region) -> tuple[_Region, ...]:
    best: tuple[float, int, int] | None = None
    for axis in (0, 1):
        _, left = region.cuts(axis)
        if len(left) and (best is None or left.min() < best[0]):
            best = float(left.min()), axis, int(left.argmin())
    return (region,) if best is None else region.divided(*best[1:])


def _regions(light: _Region, count: int, cut: Cut) -> list[_Region]:
    """Cut a map into so many regions, or fewer, where there is nothing more to cut."""
    found = [light]
    while len(found) < count:
        worth = [one.whole if cut == "median" else one.spread for one in found]
        next_one = int(np.argmax(worth))
        parts = (_halved if cut == "median" else _narrowed)(found[next_one])
        if len(parts) == 1 or not worth[next_one] > 0:
            break
        found[next_one : next_one + 1] = parts
    return [one for one in found if one.whole > 0]


def constellation(
    estimate: Estimate, count: int, cut: Cut = "variance", mirrored: ReflectionMap | None = None
) -> tuple[Estimate, list[str]]:
    """Give the estimate as `count` lights (1…64) and no SH, and notes on it.

    A lamp stays as it is if it is stronger than the mean of the lights that are left; weaker ones
    and area lights join the rest. `mirrored`: a reflection map of AMBIENT, which is cut then;
    without it, what the SH say, nowhere negative. Lights stand strongest first; those made of
    regions have the radius of a disc with the same spread. Raises UsageError.
    """
    if not 1 <= count <= MOST:
        raise UsageError(f"constellation: {count} lights: expected 1…{MOST}")
    lamps = sorted(filter(_is_lamp, estimate.beside_sh), key=_strength, reverse=True)
    width_px = _WIDTH_PX if mirrored is None else 4 * mirrored.size
    radiant, notes = _rest(estimate, mirrored, width_px)
    kept = lamps[
        : _stay([_strength(lamp) for lamp in lamps], float(luminance(radiant).sum()), count)
    ]
    for light in lamps[len(kept) :]:
        _join(radiant, light)
    flux_map = np.maximum(luminance(radiant), 0)
    towards = geometry.equirect_directions(width_px, width_px // 2)
    whole = _Region(flux_map, towards * flux_map[..., None], (0, width_px // 2), (0, width_px))
    regions = _regions(whole, count - len(kept), cut)
    first = max((light.id for light in kept), default=0) + 1
    made = [_light(one, radiant, first + k) for k, one in enumerate(regions)]
    dark = SphericalHarmonics("AMBIENT", 0, np.zeros((1, 3)))
    lights = tuple(sorted((*kept, *made), key=_strength, reverse=True))
    return replace(
        estimate, lights=lights, sh=dark, key=None, predicted_error=None, room=None
    ), notes  # fmt: skip


def _is_lamp(light: Light) -> bool:
    return light.half_angle_deg is None


def _rest(
    estimate: Estimate, mirrored: ReflectionMap | None, width_px: int
) -> tuple[Array, list[str]]:
    """Give what is beside the lamps, (H, W, 3): radiance times solid angle; and notes.

    Area lights are in it with their size: a packet's SH lack each as if it were a point, and what
    is nowhere negative and has such SH may be far from the light.
    """
    lamps = tuple(light for light in estimate.beside_sh if _is_lamp(light))
    wide = tuple(light for light in estimate.beside_sh if not _is_lamp(light))
    solid_angles = geometry.equirect_solid_angles(width_px, width_px // 2)[:, None, None]
    drawn = lamps_alone(replace(estimate, lights=wide, key=None), width_px) * solid_angles
    if mirrored:
        return drawn + mirrored.environment_map(width_px) * solid_angles, []
    directions = geometry.equirect_directions(width_px, width_px // 2)
    lit = drawn.any(axis=-1)
    towards = [*(light.direction for light in lamps), *directions[lit]]
    flux = [*(light.irradiance for light in lamps), *drawn[lit]]
    beside, notes = rest_beside(
        estimate, np.array(towards).reshape(-1, 3), np.array(flux).reshape(-1, 3), directions
    )
    return drawn + beside * solid_angles, notes


def _stay(strengths: list[float], rest: float, count: int) -> int:
    """Say how many lamps stay: each is stronger than the mean of the lights that are left."""
    left = rest + sum(strengths)
    for number, strength in enumerate(strengths):
        if number == count - 1 or strength * (count - number) <= left:
            return number
        left -= strength
    return len(strengths)


def _join(radiant: Array, light: Light) -> None:
    """Add a lamp to the pixel in which it stands."""
    height_px, width_px, _ = radiant.shape
    column, row = np.rint(geometry.equirect_pixel(light.direction, width_px, height_px))
    radiant[min(max(int(row), 0), height_px - 1), int(column) % width_px] += light.irradiance


def _strength(light: Light) -> float:
    return float(luminance(light.irradiance))


def _light(region: _Region, radiant: Array, number: int) -> Light:
    centre = region._part(region.towards).sum(axis=(0, 1))
    length = float(np.linalg.norm(centre))
    # the centre of a disc's light is (1 + cos r) / 2 from the middle of the sphere
    share = min(1.0, length / region.whole)
    radius = min(90.0, math.degrees(math.acos(max(-1.0, 2 * share - 1))))
    direction = centre / length if length > 0 else np.array([0.0, 1.0, 0.0])
    return Light(number, direction, region._part(radiant).sum(axis=(0, 1)), radius)
