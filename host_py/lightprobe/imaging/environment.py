"""An estimate as an environment map: SH and lamps as the radiance of every direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry, not_negative, sh
from lightprobe.estimate import Estimate, Light
from lightprobe.geometry import Array
from lightprobe.lamp import Lamp, disc_pixels

#: Lamps have this radius at least, in pixels: so their centre of light is where it should be.
_LEAST_RADIUS_PX = 1.0
#: Largest error of irradiance that is not worth a note.
_CLOSE = 0.005


def environment_map(estimate: Estimate, width_px: int) -> tuple[NDArray[np.float32], list[str]]:
    """Equirectangular radiance (width / 2, width, 3) in the estimate's units, and notes on it.

    Each lamp is a disc of its angular radius, or a pixel's, and each area light an ellipse, that
    gives its irradiance. The rest is what makes the SH of the whole those of the packet's total
    light, and is nowhere negative; of a TOTAL estimate it is all.
    """
    height_px = width_px // 2
    lamps = lamps_alone(estimate, width_px).reshape(-1, 3)
    lit = np.flatnonzero(lamps.any(axis=1))
    row, column = np.divmod(lit, width_px)
    towards = geometry.equirect_direction(column, row, width_px, height_px)
    solid_angles = geometry.equirect_solid_angles(width_px, height_px)
    flux = lamps[lit] * solid_angles[row, None]
    directions = geometry.equirect_directions(width_px, height_px)
    rest, notes = rest_beside(estimate, towards, flux, directions)
    return rest + lamps.reshape(rest.shape), notes


def lamps_alone(estimate: Estimate, width_px: int) -> NDArray[np.float32]:
    """The same map with nothing but the lamps and area lights."""
    height_px = width_px // 2
    lamps = np.zeros((height_px * width_px, 3), np.float32)
    for light in estimate.beside_sh:
        index, values = disc_pixels(lamp_of(light, 180 / height_px), width_px, height_px)
        lamps[index] += values
    return lamps.reshape(height_px, width_px, 3)


def lamp_of(light: Light, least_deg: float) -> Lamp:
    """Give a light of a packet as a disc, no smaller than `least_deg`, or as an ellipse."""
    radius_deg = max(light.angular_radius_deg, _LEAST_RADIUS_PX * least_deg)
    half_deg = light.half_angle_deg
    if half_deg is None or min(half_deg) < least_deg:
        return Lamp(light.direction, radius_deg, light.irradiance)
    return Lamp(light.direction, radius_deg, light.irradiance, half_deg, light.axis)


def rest_beside(
    estimate: Estimate, towards: Array, flux: Array, directions: Array
) -> tuple[NDArray[np.float32], list[str]]:
    """Radiance (…, 3) at directions (…, 3) of the light beside lamps that have been drawn.

    `towards` (N, 3) and `flux` (N, 3): of what they are drawn with, radiance times solid angle.
    Together the two have the SH of the estimate's total light.
    """
    total = estimate.total().coefficients
    wanted = total - sh.evaluate(sh.order_of(total), towards).T @ flux
    return without_negative(wanted, directions)


def without_negative(
    coefficients: Array, directions: Array
) -> tuple[NDArray[np.float32], list[str]]:
    """Radiance that is nowhere negative and has these SH, and a note where there is none.

    SH of a low order swing below zero behind strong light.
    """
    fitted = not_negative.fit(coefficients)
    error = not_negative.irradiance_error(coefficients, fitted)
    notes = []
    if error > _CLOSE:
        notes.append(f"no light has these SH: irradiance is off by up to {100 * error:.1f} %")
    return np.maximum(sh.radiance(fitted, directions), 0).astype(np.float32), notes
