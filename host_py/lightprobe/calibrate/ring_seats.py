"""The ring's LDRs and their seats, from readings while the box was turned in front of its camera.

R10 · (E / 10 lx)^−gamma + series, as in :mod:`ring_fit`, where E depends on where the sensor looks:
two more numbers. Least squares together with what the data sheets and the drawings say, by Gauss
and Newton, with weights that forget outliers (somebody walks by).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightprobe.calibrate import ring
from lightprobe.calibrate.files import CalibrationError
from lightprobe.calibrate.ring_fit import EXPECTED, EXPECTED_SIGMA, ring_file_values
from lightprobe.calibrate.ring_turning import ASIDE_DEG, Samples
from lightprobe.geometry import Array

#: A seat before any reading, degrees: twice what the guide asks for.
_SEAT_SIGMA_DEG = 4.0
#: The resin reflects light from aside, which is found as a seat that leans away from the brightest
#: light: by 2.5 degrees, root mean square, in a simulated room, and by 5 at most.
_RESIN_SIGMA_DEG = 3.0
#: The camera's own error, relative: no scatter is taken to be less.
_LEAST_SIGMA = 0.01
#: A reading so many sigmas off counts half as much (Cauchy's weights).
_OUTLIER = 2.5
_STEPS = 30
_MOST_SAMPLES = 3000
#: A curve that misses the readings by more than this, relative illuminance, is no LDR's.
_MOST_RMS = 0.25


@dataclass(frozen=True, eq=False)
class Found:
    """The result; arrays are (9,) unless they say otherwise."""

    ring: ring.Ring
    seat_sigma_deg: Array  # of each of both angles, as a measure of the print
    rms: Array  # of what is left, relative illuminance
    samples: int


def fit(samples: Samples, scale_sigma: float, divider_ohm: float = ring.DIVIDER_OHM) -> Found:
    """Calibrate from the samples; raises CalibrationError for a sensor that does not fit.

    `scale_sigma`: relative 1 sigma of the camera's cd/m² per unit: all nine are off by it together.
    """
    step = max(1, len(samples.lux) // _MOST_SAMPLES)
    lux, level = samples.lux[::step], samples.level[::step]
    rows = [_one(k, lux[:, :, k], level[:, k], divider_ohm) for k in range(ring.SENSORS)]
    r10, gamma, series, sigma, gamma_sigma, series_sigma, pivot, right, up, seat, rms = np.array(
        rows
    ).T
    found = ring.Ring(
        r10_ohm=r10, gamma=gamma, series_ohm=series, sigma=sigma, gamma_sigma=gamma_sigma,
        series_sigma_ohm=series_sigma, pivot_lux=pivot, divider_ohm=divider_ohm,
        drift_sigma=ring.DRIFT_OWN_SIGMA,
        drift_common_sigma=float(np.hypot(ring.DRIFT_COMMON_SIGMA, scale_sigma)),
        seat_right_deg=right, seat_up_deg=up,
    )  # fmt: skip
    return Found(found, seat, rms, len(samples.lux))


def _one(sensor: int, lux: Array, level: Array, divider_ohm: float) -> tuple[float, ...]:
    """Numbers of one sensor; lux (N, 5), level (N,)."""
    usable = (level > 0) & (level < ring.FULL_SCALE) & (lux[:, 0] > 0)
    if usable.sum() < 100:
        raise CalibrationError(
            f"calibrate: ring: sensor {sensor}: only {usable.sum()} usable readings: is it lit? is "
            "it open or shorted? (lightprobe mcu ring)"
        )
    lux, level = lux[usable], level[usable]
    total = ring.total_ohm(level, divider_ohm)
    expected = np.concatenate([EXPECTED, [0.0, 0.0]])
    prior = np.concatenate([EXPECTED_SIGMA, [_SEAT_SIGMA_DEG] * 2])
    found, weight, scatter = expected.copy(), np.ones(len(level)), 0.3
    for _ in range(_STEPS):
        off, slopes = _linearised(found, lux, total)
        system = np.vstack([slopes * weight[:, None], np.diag(1 / prior)])
        aim = np.concatenate([off * weight, (expected - found) / prior])
        found = found + np.linalg.lstsq(system, aim, rcond=None)[0]
        found[2] = max(found[2], 0.0)
        found[3:] = np.clip(found[3:], -15, 15)
        off, slopes = _linearised(found, lux, total)
        scatter = max(1.4826 * float(np.median(np.abs(off))), _LEAST_SIGMA * found[1])
        outlying = 1 + (off / (_OUTLIER * scatter)) ** 2
        # Neighbours in time are off alike: they count as one.
        alike = _correlated(off / outlying)
        weight = 1 / (scatter * np.sqrt(outlying * alike))
    weighed = slopes * weight[:, None]
    covariance = np.asarray(np.linalg.inv(weighed.T @ weighed + np.diag(1 / prior**2)), np.float64)
    rms = float(np.sqrt(np.sum(off**2 / outlying) / np.sum(1 / outlying))) / found[1]
    low, high = ring.LIMITS["gamma"]
    if rms > _MOST_RMS or not low <= found[1] <= high:
        raise CalibrationError(
            f"calibrate: ring: sensor {sensor}: its readings lie on no LDR's curve (gamma "
            f"{found[1]:.2f}, off by {100 * rms:.0f} %): is it shaded, or does the ring stand far "
            "from the camera?"
        )
    r10, gamma, series, sigma, gamma_sigma, series_sigma, pivot = ring_file_values(
        found[:3], covariance[:3, :3]
    )
    seat_sigma_deg = float(np.sqrt((covariance[3, 3] + covariance[4, 4]) / 2 + _RESIN_SIGMA_DEG**2))
    return (
        r10, gamma, series, float(np.hypot(sigma, rms)), gamma_sigma, series_sigma, pivot,
        float(found[3]), float(found[4]), seat_sigma_deg, rms,
    )  # fmt: skip


def _linearised(found: Array, lux: Array, total: Array) -> tuple[Array, Array]:
    """Logarithms of readings over model, and the model's derivatives by what is looked for."""
    right = (lux[:, 1] - lux[:, 2]) / (2 * ASIDE_DEG)
    up = (lux[:, 3] - lux[:, 4]) / (2 * ASIDE_DEG)
    straight = lux[:, 0]
    light = np.maximum(straight + found[3] * right + found[4] * up, straight / 10)
    x = np.log(light / 10)
    ldr = np.exp(found[0] - found[1] * x)
    model = ldr + found[2]
    by_light = -found[1] * ldr / light
    slopes = np.stack([ldr, -x * ldr, np.ones_like(ldr), by_light * right, by_light * up], axis=-1)
    return np.log(total / model), slopes / model[:, None]


def _correlated(off: Array) -> float:
    """Over how many neighbours residuals are alike: the integrated time of their correlation.

    Sokal, "Monte Carlo methods in statistical mechanics" (1997), section 3: summed up to the first
    lag at which nothing is left.
    """
    centred = off - off.mean()
    spectrum = np.abs(np.fft.rfft(centred, 2 * len(centred))) ** 2
    correlation = np.fft.irfft(spectrum)[: len(centred)]
    if correlation[0] <= 0:
        return 1.0
    correlation = correlation / correlation[0]
    end = int(np.argmax(correlation <= 0)) or len(correlation)
    return max(1.0, float(1 + 2 * correlation[1:end].sum()))
