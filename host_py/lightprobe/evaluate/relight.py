"""A sphere on a floor, lit by directional light: what an AR application would draw.

The floor shows what SH alone cannot: where shadows fall, and how soft they are. Light is a set of
directions with powers (K, 3), so truth and packet are drawn by the same few lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry, sh
from lightprobe.estimate import Estimate
from lightprobe.geometry import Array
from lightprobe.sim.scene import Lamp, disc_layer, disc_points

_GRID_PX = (64, 32)
_POINTS_PER_LAMP = 32
_ALBEDO, _FLOOR_ALBEDO = 0.8, 0.45
_EYE_M = np.array([0.0, 1.5, 5.2])  # the sphere has radius 1 and rests on y = −1
_FIELD_DEG = 31.0


@dataclass(frozen=True, eq=False)
class Lighting:
    """Light from K directions (K, 3), each with ∫ L dω (K, 3)."""

    directions: Array
    powers: Array

    @classmethod
    def of_map(cls, radiance: NDArray[np.float32], lamps: tuple[Lamp, ...]) -> Lighting:
        """Light of an equirectangular map; its lamps keep their size, the rest is made coarse."""
        height, width, _ = radiance.shape
        rest = radiance.astype(np.float32, copy=True)
        for lamp in lamps:
            layer = disc_layer(lamp, width, height)
            flat = rest.reshape(-1, 3)
            flat[layer.index] = np.maximum(flat[layer.index] - layer.values, 0)
        coarse = cv2.resize(rest, _GRID_PX, interpolation=cv2.INTER_AREA)
        return cls._of_grid(np.asarray(coarse, np.float64)).plus(lamps)

    @classmethod
    def of_estimate(cls, estimate: Estimate) -> Lighting:
        """Light that a packet describes: its SH, and its lamps when they are not in the SH."""
        directions = geometry.equirect_directions(*_GRID_PX)
        rest = cls._of_grid(sh.radiance(estimate.sh.coefficients, directions))
        if estimate.sh.kind == "TOTAL":
            return rest
        return rest.plus(
            tuple(
                Lamp(light.direction, max(light.angular_radius_deg, 0.1), light.irradiance)
                for light in estimate.lights
            )
        )

    @classmethod
    def _of_grid(cls, radiance: Array) -> Lighting:
        solid_angle = geometry.equirect_solid_angles(*_GRID_PX)[:, None, None]
        directions = geometry.equirect_directions(*_GRID_PX).reshape(-1, 3)
        return cls(directions, (radiance * solid_angle).reshape(-1, 3))

    def plus(self, lamps: tuple[Lamp, ...]) -> Lighting:
        """Add lamps, each as points spread over its disc."""
        directions, powers = [self.directions], [self.powers]
        for lamp in lamps:
            directions.append(disc_points(lamp.direction, lamp.radius_deg, _POINTS_PER_LAMP))
            powers.append(np.tile(lamp.irradiance / _POINTS_PER_LAMP, (_POINTS_PER_LAMP, 1)))
        return Lighting(np.concatenate(directions), np.concatenate(powers))

    def sphere(self, normals: Array) -> Array:
        """Radiance (N, 3) of the sphere, which nothing shades."""
        return _ALBEDO / np.pi * np.maximum(normals @ self.directions.T, 0) @ self.powers

    def floor(self, points: Array) -> Array:
        """Radiance (N, 3) of the floor at points (N, 3), in the sphere's shadow."""
        above = self.directions[:, 1] > 0
        directions, powers = self.directions[above], self.powers[above]
        total = np.empty((len(points), 3))
        for block in range(0, len(points), 4096):
            p = points[block : block + 4096]
            along = p @ directions.T  # of the ray p + t·d, where it is nearest to the centre
            away = (p * p).sum(axis=1)[:, None] - along**2
            lit = (away > 1) | (along > 0)
            total[block : block + 4096] = (lit * directions[:, 1]) @ powers
        return _FLOOR_ALBEDO / np.pi * total


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
