"""Luminance of radiance 1 (cd/m² per unit): a camera's estimates against measured illuminance.

By a lux meter: lux = scale · ∫ luminance · cos dω. By the ring of light sensors: the daemon solves
for the scale together with what clips, and says so in every estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lightprobe.calibrate.files import CalibrationError
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, EstimateFlag
from lightprobe.geometry import Array

#: With one of these flags an estimate is not the light that a meter sees.
UNFIT = (
    EstimateFlag.STALE | EstimateFlag.EXPOSURE_UNKNOWN | EstimateFlag.UNDEREXPOSED
    | EstimateFlag.RING_ONLY | EstimateFlag.NO_LIGHT | EstimateFlag.MOTION
)  # fmt: skip
#: An estimate that knows its light less well, such as one in which much clips, does not count.
MOST_SIGMA = 0.05
#: Relative 1 sigma: of a lux meter's reading, and of a camera's response and vignetting.
METER_SIGMA, CAMERA_SIGMA = 0.05, 0.02


@dataclass(frozen=True)
class Scale:
    """The result."""

    cd_m2_per_unit: float
    sigma: float  # relative, 1 sigma
    estimates_used: int


def by_meter(estimates: Sequence[Estimate], lux: float, direction: Array) -> Scale:
    """Compare with a lux meter that faces `direction` (3,); raises CalibrationError."""
    fit = [e for e in estimates if (e.relighting_sigma or 0) <= MOST_SIGMA and not e.flags & UNFIT]
    unit = np.array([float(luminance(e.irradiance(direction))) for e in fit])
    if not len(unit) or not unit.mean() > 0:
        raise _none_fits(estimates)
    light = np.hypot(np.median([e.relighting_sigma or 0 for e in fit]), CAMERA_SIGMA)
    return Scale(lux / float(unit.mean()), float(np.hypot(METER_SIGMA, light)), len(fit))


def by_ring(estimates: Sequence[Estimate]) -> Scale:
    """Take what the estimates say of themselves; raises CalibrationError."""
    known = [
        (e.cd_m2_per_unit, e.cd_m2_per_unit_sigma)
        for e in estimates
        if e.cd_m2_per_unit is not None
        and e.cd_m2_per_unit_sigma is not None
        and not e.flags & (UNFIT | EstimateFlag.RING_FAULT)
    ]
    if not known:
        raise _none_fits(estimates)
    value, sigma = np.median(known, axis=0)
    return Scale(float(value), float(np.hypot(sigma, CAMERA_SIGMA)), len(known))


def _none_fits(estimates: Sequence[Estimate]) -> CalibrationError:
    flags = sorted({flag for estimate in estimates for flag in estimate.to_json()["flags"]})
    why = f" (flags: {', '.join(flags)})" if flags else ""
    return CalibrationError(
        f"calibrate: scale: none of {len(estimates)} estimates knows its light well enough{why}: "
        "choose steady light in which little clips, such as a room without direct sun"
    )
