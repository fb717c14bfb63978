"""A lamp as truth states it: a disc or an ellipse of uniform radiance, far away."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry
from lightprobe.geometry import Array

_SUBPIXELS = 8


@dataclass(frozen=True, eq=False)
class Lamp:
    """A lamp at full power: what it adds to the background."""

    direction: Array  # (3,) unit vector towards it, probe frame
    radius_deg: float  # of the disc with the same solid angle
    irradiance: Array  # (3,) RGB, ∫ L dω of what it adds
    #: Of an ellipse: half its angles along `axis` and across, and a unit vector across `direction`.
    half_angle_deg: tuple[float, float] | None = None
    axis: Array | None = None

    @property
    def radiance(self) -> Array:
        """Mean radiance (3,) that it adds."""
        return self.irradiance / float(geometry.cap_solid_angle_sr(self.radius_deg))

    def scaled(self, factor: float) -> Lamp:
        """Give the same lamp, brighter by a factor."""
        return replace(self, irradiance=factor * self.irradiance)

    def place(self, directions: Array) -> Array:
        """Where directions (…, 3) are in it: 0 in the middle, 1 on the edge, more outside."""
        away_deg = geometry.angle_deg(directions, self.direction)
        if self.half_angle_deg is None or self.axis is None:
            return np.asarray(away_deg / self.radius_deg)
        across = np.cross(self.direction, self.axis)
        angles_deg = [np.degrees(np.arcsin(np.clip(directions @ one, -1, 1)))
                      for one in (self.axis, across)]  # fmt: skip
        along, beside = (a / half for a, half in zip(angles_deg, self.half_angle_deg, strict=True))
        return np.where(away_deg < 90, np.hypot(along, beside), np.inf)


def disc_pixels(
    lamp: Lamp, width_px: int, height_px: int
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Flat indices (N,) of the pixels of a lamp, and the radiance (N, 3) that it adds there.

    The map is equirectangular, width_px × height_px. Each pixel counts by the share of it that the
    lamp covers: pixels at the rim are sampled on a fine grid; then all shares are scaled by the
    little that makes the lamp's light add up to its irradiance.
    """
    halves = np.radians(lamp.half_angle_deg or (lamp.radius_deg, lamp.radius_deg))
    reach, pixel = float(halves.max()), np.pi / height_px
    theta = np.arccos(np.clip(lamp.direction[1], -1, 1))
    top = max(0, int((theta - reach) / pixel) - 1)
    bottom = min(height_px, int((theta + reach) / pixel) + 2)
    rows = np.arange(top, bottom)[:, None]
    columns = np.arange(width_px)[None, :]
    place = lamp.place(geometry.equirect_direction(columns, rows, width_px, height_px))
    cover = (place < 1).astype(np.float64)
    rim_row, rim_column = np.nonzero(np.abs(place - 1) * halves.min() < pixel)
    steps = (np.arange(_SUBPIXELS) + 0.5) / _SUBPIXELS - 0.5
    fine_column = rim_column[:, None, None] + steps[None, None, :]
    fine_row = rim_row[:, None, None] + top + steps[None, :, None]
    fine = lamp.place(geometry.equirect_direction(fine_column, fine_row, width_px, height_px)) < 1
    weight = np.sin((fine_row + 0.5) * pixel)  # near a pole a pixel is a wedge
    cover[rim_row, rim_column] = (fine * weight).sum(axis=(1, 2)) / (_SUBPIXELS * weight).sum(
        axis=(1, 2)
    )
    if not cover.any():  # a lamp between the points that were looked at
        cover[np.unravel_index(place.argmin(), place.shape)] = 1
    row, column = np.nonzero(cover)
    solid_angle = geometry.equirect_solid_angles(width_px, height_px)[row + top]
    share = cover[row, column]
    values = share[:, None] * lamp.irradiance / (share @ solid_angle)
    return (row + top) * width_px + column, values.astype(np.float32)
