"""A lamp as truth states it: a disc of uniform radiance, far away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe import geometry
from lightprobe.geometry import Array

_SUBPIXELS = 8


@dataclass(frozen=True, eq=False)
class Lamp:
    """A lamp at full power: what it adds to the background."""

    direction: Array  # (3,) unit vector towards it, probe frame
    radius_deg: float  # of the disc with the same solid angle
    irradiance: Array  # (3,) RGB, ∫ L dω of what it adds

    @property
    def radiance(self) -> Array:
        """Mean radiance (3,) that it adds."""
        return self.irradiance / float(geometry.cap_solid_angle_sr(self.radius_deg))

    def scaled(self, factor: float) -> Lamp:
        """Give the same lamp, brighter by a factor."""
        return Lamp(self.direction, self.radius_deg, factor * self.irradiance)


def disc_pixels(
    lamp: Lamp, width_px: int, height_px: int
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Flat indices (N,) of the pixels of a lamp's disc, and the radiance (N, 3) that it adds there.

    The map is equirectangular, width_px × height_px. Each pixel counts by the share of it that the
    disc covers: pixels at the rim are sampled on a fine grid; then all shares are scaled by the
    little that makes their solid angles add up to the disc's.
    """
    reach = np.radians(lamp.radius_deg)
    pixel = np.pi / height_px
    theta = np.arccos(np.clip(lamp.direction[1], -1, 1))
    top = max(0, int((theta - reach) / pixel) - 1)
    bottom = min(height_px, int((theta + reach) / pixel) + 2)
    rows = np.arange(top, bottom)[:, None]
    columns = np.arange(width_px)[None, :]
    away = np.radians(_angle(lamp, columns, rows, width_px, height_px))
    cover = (away < reach).astype(np.float64)
    rim_row, rim_column = np.nonzero(np.abs(away - reach) < pixel)
    steps = (np.arange(_SUBPIXELS) + 0.5) / _SUBPIXELS - 0.5
    fine_column = rim_column[:, None, None] + steps[None, None, :]
    fine_row = rim_row[:, None, None] + top + steps[None, :, None]
    fine = np.radians(_angle(lamp, fine_column, fine_row, width_px, height_px)) < reach
    weight = np.sin((fine_row + 0.5) * pixel)  # near a pole a pixel is a wedge
    cover[rim_row, rim_column] = (fine * weight).sum(axis=(1, 2)) / (_SUBPIXELS * weight).sum(
        axis=(1, 2)
    )
    if not cover.any():  # a lamp between the points that were looked at
        cover[np.unravel_index(away.argmin(), away.shape)] = 1
    row, column = np.nonzero(cover)
    solid_angle = geometry.equirect_solid_angles(width_px, height_px)[row + top]
    share = cover[row, column]
    share *= geometry.cap_solid_angle_sr(lamp.radius_deg) / (share @ solid_angle)
    values = share[:, None] * lamp.radiance
    return (row + top) * width_px + column, values.astype(np.float32)


def _angle(lamp: Lamp, column: ArrayLike, row: ArrayLike, width_px: int, height_px: int) -> Array:
    directions = geometry.equirect_direction(column, row, width_px, height_px)
    return geometry.angle_deg(directions, lamp.direction)
