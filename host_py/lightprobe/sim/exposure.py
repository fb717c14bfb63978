"""Which exposure suits a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.errors import UsageError

#: Share of full scale at which the first exposure puts the scene's median.
MEDIAN_AT = 0.25
#: Exposures of a bracket follow each other at this distance, the longest first.
STOPS_APART = 4


@dataclass(frozen=True)
class ExposureLimits:
    """Exposures that a camera can do; UVC counts in steps of 100 µs."""

    least_us: float = 100.0
    most_us: float = 33000.0
    step_us: float = 100.0  # 0: any value in between

    def __post_init__(self) -> None:
        """Check that there is one; UsageError."""
        if not 0 < self.least_us <= self.most_us:
            raise UsageError(
                f"camera: exposures of {self.least_us:g}…{self.most_us:g} µs: "
                "the least must be above 0 and not above the most"
            )

    def at(self, rate_hz: float) -> ExposureLimits:
        """Give the limits at a frame rate: no exposure is longer than the time between frames."""
        period_us = 1e6 / rate_hz
        if period_us >= self.most_us:
            return self
        if self.step_us:
            period_us = math.floor(period_us / self.step_us) * self.step_us
        return ExposureLimits(self.least_us, period_us, self.step_us)

    def nearest(self, exposure_us: float) -> float:
        """Give what the camera does when told `exposure_us`."""
        if self.step_us:
            exposure_us = max(round(exposure_us / self.step_us), 1) * self.step_us
        return min(max(exposure_us, self.least_us), self.most_us)


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
