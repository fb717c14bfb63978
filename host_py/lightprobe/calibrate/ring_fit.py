"""The ring's LDRs from levels at known illuminances: R10, gamma, and how well they are known.

ln R = ln R10 − gamma · ln(E / 10 lx): a straight line per sensor, by least squares. Where the light
hardly changed gamma cannot be told from R10: then gamma stays nominal, and sigma says so.
"""

from __future__ import annotations

import numpy as np

from lightprobe.calibrate import ring
from lightprobe.calibrate.files import CalibrationError
from lightprobe.geometry import Array

#: Illuminances must span this factor for gamma to be found.
LEAST_SPAN = 3.0
#: Of gamma, when it is taken from the data sheet.
GAMMA_SIGMA = 0.1


def fit(
    lux: Array, level: Array, level_sigma: float, divider_ohm: float = ring.DIVIDER_OHM
) -> ring.Ring:
    """Calibrate from `lux` (N, 9) and `level` (N, 9); NaN where a pair is not known.

    `level_sigma`: relative 1 sigma of `lux` that is common to all pairs. Raises CalibrationError
    for a sensor that no usable pair is of, or that no LDR is.
    """
    usable = (lux > 0) & (level > 0) & (level < ring.FULL_SCALE)
    rows = [
        _one(k, lux[usable[:, k], k], level[usable[:, k], k], divider_ohm)
        for k in range(ring.SENSORS)
    ]
    r10_ohm, gamma, sigma = np.array(rows).T
    return ring.Ring(r10_ohm, gamma, np.hypot(sigma, level_sigma), divider_ohm)


def _one(sensor: int, lux: Array, level: Array, divider_ohm: float) -> tuple[float, float, float]:
    """R10, gamma and relative sigma of one sensor."""
    where = f"calibrate: ring: sensor {sensor}"
    if len(lux) == 0:
        raise CalibrationError(
            f"{where}: no usable reading: is it lit? is it open or shorted? (lightprobe mcu ring)"
        )
    x = np.log(lux / 10)
    y = np.log(ring.ldr_ohm(level, divider_ohm))
    if len(lux) < 2 or np.ptp(x) < np.log(LEAST_SPAN):
        slope, free = -ring.NOMINAL_GAMMA, 1
        spread = float(np.abs(x).mean()) * GAMMA_SIGMA / ring.NOMINAL_GAMMA
    else:
        slope, free, spread = float(np.polyfit(x, y, 1)[0]), 2, 0.0
    start = float(np.mean(y - slope * x))
    left = y - start - slope * x
    noise = float(np.sqrt(left @ left / max(len(x) - free, 1)))
    r10_ohm, gamma = float(np.exp(start)), -slope
    limits = (("R10", r10_ohm, ring.R10_OHM), ("gamma", gamma, ring.GAMMA))
    for name, value, (low, high) in limits:
        if not low <= value <= high:
            raise CalibrationError(
                f"{where}: {name} would be {value:.3g}, want {low:g}…{high:g}: did the light reach "
                "it as stated, and rest long enough?"
            )
    return r10_ohm, gamma, noise / gamma + spread
