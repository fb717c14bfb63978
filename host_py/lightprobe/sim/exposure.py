"""Which exposure suits a scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry
from lightprobe.colour import luminance

#: Share of full scale at which the first exposure puts the scene's median.
MEDIAN_AT = 0.25
#: Exposures of a bracket follow each other at this distance, the longest first.
STOPS_APART = 4


def median_luminance(radiance: NDArray[np.float32]) -> float:
    """Median over the sphere (not over pixels) of an equirectangular map's luminance."""
    height, width, _ = radiance.shape
    weight = np.repeat(geometry.equirect_solid_angles(width, height), width)
    brightness = luminance(radiance).ravel()
    order = np.argsort(brightness)
    middle = int(np.searchsorted(np.cumsum(weight[order]), 2 * np.pi))
    return float(brightness[order[min(middle, len(order) - 1)]])


def bracket_us(median: float, count: int) -> list[float]:
    """Exposures in microseconds for a median radiance above 0 (1.0 = full scale at one second)."""
    first = 1e6 * MEDIAN_AT / median
    return [first / 2 ** (STOPS_APART * k) for k in range(count)]
