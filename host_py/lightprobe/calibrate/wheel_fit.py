"""The wheel's servo from what it is told and what the comb shows: gain, zero, lag, backlash.

While the wheel is swept over its comb the firmware tells, at the same moments, the width p of the
servo's pulses and how many edges lie below the wheel. At an edge the wheel's angle E is known.
Going up at speed v the servo pushes the wheel from below, going down from one backlash B above,
and it follows the pulses by L seconds late:

    p = zero + gain · E + gain · L · v − gain · B · [v < 0]

which is linear in zero, gain, gain · L and gain · B: sweeps both ways at two speeds tell all four.
L holds half of the servo's frame and of the time between two readings; B holds the servo's dead
band.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lightprobe.calibrate.files import CalibrationError
from lightprobe.geometry import Array

#: Fewer crossings do not make a calibration.
LEAST_CROSSINGS = 24
#: After a start the wheel first takes up its backlash: so many edges are left out.
_SETTLING_EDGES = 2
_OUTLIER_SIGMAS = 5.0
#: Smallest sigma of one crossing that outliers are judged by, microseconds.
_LEAST_SIGMA_US = 0.5


@dataclass(frozen=True)
class Reading:
    """What the firmware tells at one moment."""

    pulse_us: float
    edges: int  # of the comb below the wheel


@dataclass(frozen=True)
class Crossing:
    """An edge that went by."""

    edge_deg: float
    pulse_us: float
    speed_deg_s: float  # negative downwards


@dataclass(frozen=True)
class WheelCalibration:
    """The servo as it is; sigmas are of the fit."""

    zero_us: float  # pulse at wheel angle 0, pushed from below
    gain_us_deg: float
    lag_s: float
    backlash_deg: float
    zero_sigma_us: float
    gain_sigma_us_deg: float
    backlash_sigma_deg: float
    rms_deg: float  # of what the model leaves: how crooked servo and comb are
    crossings: int


def crossings(
    readings: Sequence[Reading], first_deg: float, pitch_deg: float, speed_deg_s: float
) -> list[Crossing]:
    """Edges that one sweep passed, `speed_deg_s` as it was told, with its sign.

    The pulse at an edge is the mean of the readings on both sides of it. Left out: the first edges
    after the start, and those that go by while the pulse stands still or goes back. A servo that
    is built in the other way round turns the wheel up with shorter pulses.
    """
    if not readings:
        return []
    way = 1 if speed_deg_s > 0 else -1
    sweep_us = readings[-1].pulse_us - readings[0].pulse_us
    passed = []
    for before, after in pairwise(readings):
        step_us = after.pulse_us - before.pulse_us
        if after.edges - before.edges != way or step_us * sweep_us <= 0:
            continue
        edge = min(before.edges, after.edges)  # edge k: k edges lie below it
        pulse_us = (before.pulse_us + after.pulse_us) / 2
        passed.append(Crossing(first_deg + edge * pitch_deg, pulse_us, speed_deg_s))
    return passed[_SETTLING_EDGES:]


def fit(passed: Iterable[Crossing]) -> WheelCalibration:
    """Least squares over all sweeps; CalibrationError when they do not tell enough."""
    rows = np.array([(c.edge_deg, c.pulse_us, c.speed_deg_s) for c in passed]).reshape(-1, 3)
    if len(rows) < LEAST_CROSSINGS:
        raise CalibrationError(
            f"calibrate: wheel: only {len(rows)} edges of the comb passed, {LEAST_CROSSINGS} are "
            "needed: does the wheel turn? `lightprobe mcu watch` shows it"
        )
    edge, pulse, speed = rows.T
    system = np.stack([np.ones_like(edge), edge, speed, -(speed < 0).astype(float)], axis=-1)
    if np.linalg.matrix_rank(system) < 4:
        raise CalibrationError("calibrate: wheel: expected sweeps both ways, at two speeds")
    kept = np.full(len(rows), True)
    for _ in range(3):
        solution = np.linalg.lstsq(system[kept], pulse[kept], rcond=None)[0]
        left = pulse - system @ solution
        sigma = max(1.4826 * float(np.median(np.abs(left[kept]))), _LEAST_SIGMA_US)
        kept = np.abs(left) < _OUTLIER_SIGMAS * sigma
    return _result(system[kept], left[kept], solution)


def _result(system: Array, left: Array, solution: Array) -> WheelCalibration:
    zero, gain, gain_lag, gain_backlash = (float(value) for value in solution)
    if abs(gain) < 0.1:
        raise CalibrationError("calibrate: wheel: the pulses have no effect on the comb")
    freedom = max(len(left) - 4, 1)
    variance = float(left @ left) / freedom
    sigma = np.sqrt(np.diag(np.linalg.inv(system.T @ system)) * variance)
    return WheelCalibration(
        zero_us=zero,
        gain_us_deg=gain,
        lag_s=gain_lag / gain,
        backlash_deg=gain_backlash / gain,
        zero_sigma_us=float(sigma[0]),
        gain_sigma_us_deg=float(sigma[1]),
        backlash_sigma_deg=float(sigma[3] / abs(gain)),
        rms_deg=float(np.sqrt(variance) / abs(gain)),
        crossings=len(left),
    )
