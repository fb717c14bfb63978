"""An estimate as an environment map: SH and lamps as the radiance of every direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry, sh
from lightprobe.estimate import Estimate
from lightprobe.geometry import Array
from lightprobe.lamp import Lamp, disc_pixels

#: Lamps have this radius at least, in pixels: so their centre of light is where it should be.
_LEAST_RADIUS_PX = 1.0


def environment_map(estimate: Estimate, width_px: int) -> tuple[NDArray[np.float32], list[str]]:
    """Equirectangular radiance (width / 2, width, 3) in the estimate's units, and notes on it.

    Each lamp is a disc of its angular radius, or a pixel's, that gives its irradiance; of a TOTAL
    estimate the lamps are in the SH already.
    """
    height_px = width_px // 2
    directions = geometry.equirect_directions(width_px, height_px)
    ambient = sh.radiance(estimate.sh.coefficients, directions)
    solid_angles = geometry.equirect_solid_angles(width_px, height_px)[:, None, None]
    radiance, notes = without_negative(ambient, solid_angles)
    flat = radiance.reshape(-1, 3)
    for light in estimate.beside_sh:
        radius_deg = max(light.angular_radius_deg, _LEAST_RADIUS_PX * 180 / height_px)
        index, values = disc_pixels(
            Lamp(light.direction, radius_deg, light.irradiance), width_px, height_px
        )
        flat[index] += values
    return radiance, notes


def without_negative(ambient: Array, solid_angles: Array) -> tuple[NDArray[np.float32], list[str]]:
    """Radiance with 0 for what is below it, and a note that says how much light that adds.

    SH of a low order swing below zero behind strong light.
    """
    added = -float((np.minimum(ambient, 0) * solid_angles).sum())
    there = float((np.maximum(ambient, 0) * solid_angles).sum())
    notes = []
    if added > 0.005 * there:
        notes.append(
            f"SH below zero set to 0: adds {100 * added / there:.1f} % to the ambient light"
        )
    return np.maximum(ambient, 0).astype(np.float32), notes
