"""A sphere on a floor, lit by directional light: what an AR application would draw.

The floor shows what SH alone cannot: where shadows fall, and how soft they are. Light is a set of
directions with powers (K, 3), so truth and packet are drawn by the same few lines.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry, sh
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, Light
from lightprobe.geometry import Array

_GRID_PX = (64, 32)
#: A cell of a map that holds more than this share of all light is drawn in finer cells.
_FINEST_SHARE = 1 / 4000
#: A cell with a smaller share is black, but for rounding.
_ROUNDING = 1e-12
_POINTS_PER_LAMP = 32
_ALBEDO, _FLOOR_ALBEDO = 0.8, 0.45
_EYE_M = np.array([0.0, 1.5, 5.2])  # the sphere has radius 1 and rests on y = −1
_FIELD_DEG = 31.0
#: So many places at once: what they get of all directions stays in the processor's cache.
_BLOCK = 256

#: Single precision: enough for a picture, and half of the memory.
Single = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Lighting:
    """Light from K directions (K, 3), each with ∫ L dω (K, 3)."""

    directions: Array
    powers: Array

    @classmethod
    def of_map(cls, radiance: NDArray[np.float32]) -> Lighting:
        """Light of an equirectangular map (H, W, 3) without negative values, all of it once.

        The map is cut into cells, finer where it is bright. A cell becomes one direction, its
        centre of light, so no assumption is made on the shape of lamps and nothing counts twice.
        """
        height, width, _ = radiance.shape
        solid_angle = geometry.equirect_solid_angles(width, height)[:, None, None]
        power = radiance.astype(np.float64) * solid_angle
        moment = luminance(power)[..., None] * geometry.equirect_directions(width, height)
        table = _summed_area(np.concatenate([power, moment], axis=-1))
        all_light = float(luminance(power).sum())
        cells, kept = _cells(height, width), []
        while len(cells):
            sums = _sums(table, cells)
            size_px = (cells[:, 1] - cells[:, 0]) * (cells[:, 3] - cells[:, 2])
            split = (luminance(sums[:, :3]) > _FINEST_SHARE * all_light) & (size_px > 1)
            kept.append(sums[~split])
            cells = _quarters(cells[split])
        lit = np.concatenate(kept)
        lit = lit[luminance(lit[:, :3]) > _ROUNDING * all_light]
        return cls(geometry.normalize(lit[:, 3:]), lit[:, :3])

    @classmethod
    def of_estimate(cls, estimate: Estimate) -> Lighting:
        """Light that a packet describes: its SH, and its lamps when they are not in the SH."""
        solid_angle = geometry.equirect_solid_angles(*_GRID_PX)[:, None, None]
        directions = geometry.equirect_directions(*_GRID_PX)
        powers = sh.radiance(estimate.sh.coefficients, directions) * solid_angle
        rest = cls(directions.reshape(-1, 3), powers.reshape(-1, 3))
        return rest.plus(estimate.beside_sh)

    def plus(self, lamps: tuple[Light, ...]) -> Lighting:
        """Add lamps, each as points spread over its disc."""
        directions, powers = [self.directions], [self.powers]
        for lamp in lamps:
            radius_deg = max(lamp.angular_radius_deg, 0.1)
            directions.append(geometry.disc_points(lamp.direction, radius_deg, _POINTS_PER_LAMP))
            powers.append(np.tile(lamp.irradiance / _POINTS_PER_LAMP, (_POINTS_PER_LAMP, 1)))
        return Lighting(np.concatenate(directions), np.concatenate(powers))

    def sphere(self, normals: Array) -> Array:
        """Radiance (N, 3) of the sphere, which nothing shades."""
        return _ALBEDO / np.pi * self._sum(normals, lambda n, d: np.maximum(n @ d.T, 0))

    def floor(self, points: Array) -> Array:
        """Radiance (N, 3) of the floor at points (N, 3), in the sphere's shadow."""
        above = self.directions[:, 1] > 0
        return _FLOOR_ALBEDO / np.pi * Lighting(
            self.directions[above], self.powers[above] * self.directions[above, 1:2]
        )._sum(points, _unshaded)  # fmt: skip

    def _sum(self, places: Array, share: Callable[[Single, Single], Single]) -> Array:
        """Sum of the powers (N, 3) by the `share` (B, K) that places (B, 3) get of directions."""
        directions, powers = self.directions.astype(np.float32), self.powers.astype(np.float32)
        blocks = (
            share(places[k : k + _BLOCK].astype(np.float32), directions) @ powers
            for k in range(0, len(places), _BLOCK)
        )
        return np.concatenate([np.zeros((0, 3)), *blocks])


def _unshaded(points: Single, directions: Single) -> Single:
    """Whether the sphere leaves points (B, 3) the light of directions (K, 3)."""
    along = points @ directions.T  # of the ray p + t·d, where it is nearest to the centre
    away = (points * points).sum(axis=1)[:, None] - along**2
    lit: Single = np.asarray((away > 1) | (along > 0), np.float32)
    return lit


# Cells of a map are rows of (top, bottom, left, right) in pixels, the ends not included.
Cells = NDArray[np.intp]


def _cells(height: int, width: int) -> Cells:
    """Cells of a grid of about _GRID_PX over a map."""
    columns, rows = (
        min(count, size) for count, size in zip(_GRID_PX, (width, height), strict=True)
    )
    row = np.linspace(0, height, rows + 1).astype(np.intp)
    column = np.linspace(0, width, columns + 1).astype(np.intp)
    top, left = np.meshgrid(row[:-1], column[:-1], indexing="ij")
    bottom, right = np.meshgrid(row[1:], column[1:], indexing="ij")
    return np.stack([top.ravel(), bottom.ravel(), left.ravel(), right.ravel()], axis=1)


def _quarters(cells: Cells) -> Cells:
    """Cut every cell in two along each side that is longer than a pixel."""
    for low, high in ((0, 1), (2, 3)):
        middle = (cells[:, low] + cells[:, high]) // 2
        first, second = cells.copy(), cells.copy()
        first[:, high] = second[:, low] = middle
        cells = np.concatenate([first, second])
        cells = cells[cells[:, low] < cells[:, high]]
    return cells


def _summed_area(values: Array) -> Array:
    """Sums (H + 1, W + 1, C) of all that is above and to the left."""
    table = np.zeros((values.shape[0] + 1, values.shape[1] + 1, values.shape[2]))
    table[1:, 1:] = values.cumsum(axis=0).cumsum(axis=1)
    return table


def _sums(table: Array, cells: Cells) -> Array:
    """Sums (N, C) over cells."""
    top, bottom, left, right = cells.T
    return np.asarray(
        table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]
    )


def draw(lighting: Lighting, size_px: int) -> Array:
    """Picture (size, size, 4): linear radiance of the sphere on its floor, and opacity."""
    rays = _rays(size_px)
    # Sphere: |eye + t·ray| = 1; the nearest approach tells how much of a pixel it covers.
    along = -(rays @ _EYE_M)
    miss = np.sqrt(np.maximum(_EYE_M @ _EYE_M - along**2, 0))
    pixel_m = 2 * np.tan(np.radians(_FIELD_DEG / 2)) * np.linalg.norm(_EYE_M) / size_px
    cover = np.clip((1 - miss) / pixel_m + 0.5, 0, 1)
    depth = along - np.sqrt(np.maximum(1 - miss**2, 0))
    normals = geometry.normalize(_EYE_M + depth[..., None] * rays)
    picture = np.zeros((size_px, size_px, 4))
    on_floor = (rays[..., 1] < -0.02) & (cover < 1)
    points = _EYE_M + (-(1 + _EYE_M[1]) / rays[on_floor][:, 1])[:, None] * rays[on_floor]
    picture[on_floor, :3] = lighting.floor(points)
    picture[on_floor, 3] = np.clip((3.2 - np.hypot(points[:, 0], points[:, 2])) / 1.2, 0, 1)
    seen = cover > 0
    share = cover[seen][:, None]
    picture[seen, :3] = share * lighting.sphere(normals[seen]) + (1 - share) * picture[seen, :3]
    picture[seen, 3:] = np.maximum(share, picture[seen, 3:])
    return picture


def _rays(size_px: int) -> Array:
    """Unit rays (size, size, 3) of the picture's pixels from the eye towards the sphere."""
    forward = geometry.normalize(np.array([0.0, -0.2, 0.0]) - _EYE_M)
    right = np.array([1.0, 0, 0])
    up = np.cross(right, forward)  # right, up and forward are orthonormal: no roll
    half = np.tan(np.radians(_FIELD_DEG / 2))
    at = (2 * (np.arange(size_px) + 0.5) / size_px - 1) * half
    return geometry.normalize(forward + at[None, :, None] * right - at[:, None, None] * up)
