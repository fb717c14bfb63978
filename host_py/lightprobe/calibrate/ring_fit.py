"""The ring's LDRs from levels at known illuminances: R10, gamma, series resistance, their sigmas.

Resistance of LDR and multiplexer: R10 · (E / 10 lx)^−gamma + series. Three numbers a sensor, found
by least squares from the readings together with what the data sheets say of the three (a maximum a
posteriori estimate): what the readings do not tell stays as the data sheets have it, and its sigma
says so. With light above some 10 000 lx among the readings the series resistance is told by them.
"""

from __future__ import annotations

import numpy as np

from lightprobe.calibrate import ring
from lightprobe.calibrate.files import CalibrationError
from lightprobe.geometry import Array

#: ln R10, gamma, series resistance: expected and 1 sigma before any reading. R10 is left wide, so
#: that other types of LDR can be fitted.
EXPECTED = np.array([np.log(ring.NOMINAL_R10_OHM), ring.NOMINAL_GAMMA, ring.NOMINAL_SERIES_OHM])
EXPECTED_SIGMA = np.array([0.8, ring.NOMINAL_GAMMA_SIGMA, ring.NOMINAL_SERIES_SIGMA_OHM])
#: Readings that lie so many of their sigmas off the curve are not of this LDR.
_MOST_OFF = 4.0
_STEPS = 50


def fit(
    lux: Array, level: Array, light_sigma: float, divider_ohm: float = ring.DIVIDER_OHM
) -> ring.Ring:
    """Calibrate from `lux` (N, 9) and `level` (N, 9); NaN where a pair is not known.

    `light_sigma`: relative 1 sigma of each `lux`, which may be common to all pairs. Raises
    CalibrationError for a sensor that no usable pair is of, or whose readings fit no LDR.
    """
    usable = (lux > 0) & (level > 0) & (level < ring.FULL_SCALE)
    rows = [
        _one(k, lux[usable[:, k], k], level[usable[:, k], k], light_sigma, divider_ohm)
        for k in range(ring.SENSORS)
    ]
    r10_ohm, gamma, series_ohm, sigma, gamma_sigma, series_sigma_ohm, pivot_lux = np.array(rows).T
    return ring.Ring(
        r10_ohm=r10_ohm,
        gamma=gamma,
        series_ohm=series_ohm,
        sigma=np.hypot(sigma, light_sigma),
        gamma_sigma=gamma_sigma,
        series_sigma_ohm=series_sigma_ohm,
        pivot_lux=pivot_lux,
        divider_ohm=divider_ohm,
        drift_sigma=ring.DRIFT_OWN_SIGMA,
        drift_common_sigma=ring.DRIFT_COMMON_SIGMA,
    )


def _one(
    sensor: int, lux: Array, level: Array, light_sigma: float, divider_ohm: float
) -> tuple[float, ...]:
    """R10, gamma, series resistance and their sigmas of one sensor; see `fit`."""
    where = f"calibrate: ring: sensor {sensor}"
    if len(lux) == 0:
        raise CalibrationError(
            f"{where}: no usable reading: is it lit? is it open or shorted? (lightprobe mcu ring)"
        )
    total = ring.total_ohm(level, divider_ohm)
    slope = divider_ohm * ring.FULL_SCALE / level**2
    found = EXPECTED.copy()
    for _ in range(_STEPS):
        off, system = _linearised(found, lux, total, slope, light_sigma)
        step = np.linalg.lstsq(system, off, rcond=None)[0]
        found = found + step
        found[2] = max(found[2], 0.0)
        if np.all(np.abs(step) < 1e-6 * EXPECTED_SIGMA):
            break
    off, system = _linearised(found, lux, total, slope, light_sigma)
    _refuse_bad_readings(where, found, off[: len(lux)])
    spread = max(1.0, float(off[: len(lux)] @ off[: len(lux)]) / max(len(lux) - 3, 1))
    covariance: Array = np.asarray(np.linalg.inv(system.T @ system)) * spread
    return ring_file_values(found, covariance)


def _linearised(
    found: Array, lux: Array, total: Array, slope: Array, light_sigma: float
) -> tuple[Array, Array]:
    """What is left of readings and expectations, and the derivatives of both, in sigmas."""
    x = np.log(lux / 10)
    ldr = np.exp(found[0] - found[1] * x)
    model = ldr + found[2]
    derivatives = np.stack([ldr, -x * ldr, np.ones_like(ldr)], axis=-1) / model[:, None]
    by_light = found[1] * max(light_sigma, 1e-3) * ldr / model
    sigma = np.hypot(by_light, ring.LEVEL_SIGMA * slope / total)
    off = np.concatenate([np.log(total / model) / sigma, (EXPECTED - found) / EXPECTED_SIGMA])
    return off, np.vstack([derivatives / sigma[:, None], np.diag(1 / EXPECTED_SIGMA)])


def _refuse_bad_readings(where: str, found: Array, off: Array) -> None:
    low, high = ring.LIMITS["gamma"]
    if np.abs(off).max() > _MOST_OFF or not low <= found[1] <= high:
        raise CalibrationError(
            f"{where}: its readings lie on no LDR's curve (gamma {found[1]:.2f}, off by "
            f"{np.abs(off).max():.1f} sigma): did the light reach it as stated, and rest long "
            "enough?"
        )


def ring_file_values(found: Array, covariance: Array) -> tuple[float, ...]:
    """Seven values of a ring file: r10_ohm, gamma, series_ohm, sigma, gamma_sigma and so on.

    `found` (3,): ln R10, gamma, series resistance; `covariance` (3, 3): theirs. The pivot is where
    the illuminance is known best, and sigma how well it is known there.
    """
    r10, gamma, series = (float(value) for value in found)
    pivot = covariance[0, 1] / covariance[1, 1]
    variance = covariance[0, 0] - covariance[0, 1] ** 2 / covariance[1, 1]
    low, high = ring.LIMITS["pivot_lux"]
    return (
        float(np.exp(r10)),
        gamma,
        series,
        float(np.sqrt(max(variance, 0.0))) / gamma,
        float(np.sqrt(covariance[1, 1])),
        float(np.sqrt(covariance[2, 2])),
        float(np.clip(10 * np.exp(pivot), low, high)),
    )
