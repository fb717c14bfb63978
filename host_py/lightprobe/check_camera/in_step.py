"""Lamps that flicker in step with the pictures: each looks like the last, and all are wrong.

At 30 pictures a second, lamps on mains of 60 Hz flicker four times from one to the next, and the
same part of their flicker meets every row. Exposures end as the row is read, so an exposure t has
the mean of the flicker over the time t before: in ω = 2π · 120 Hz, relative,

    e(t) = a sin(ωt) / (ωt) + b (1 − cos(ωt)) / (ωt)

with a and b of each row. Where that explains how exposures contradict each other, nothing else can
be told from them.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from lightprobe.calibrate.exposure_series import ExposureSeries
from lightprobe.check_camera.response import against
from lightprobe.check_camera.scene import SceneSeries
from lightprobe.geometry import Array

#: What lamps on the mains flicker with.
_MAINS_HZ = (100.0, 120.0)
#: A whole number of periods from picture to picture, within this share of one.
_IN_STEP = 0.02
_BANDS, _LEAST_STEPS, _LEAST_PLACES = 12, 9, 40
#: Contradictions below this are no flicker; and so much of them must be explained.
_LEAST, _EXPLAINED = 0.008, 0.82


@dataclass(frozen=True)
class InStep:
    """Flicker that explains contradictions."""

    hz: float
    share: float  # of the light, to each side
    explained: float  # share of the contradictions' variance


def rate_hz(series: ExposureSeries) -> float:
    """Pictures a second, by the middle of all gaps; 0: unknown."""
    frames = series.frames
    gaps = [
        (late.t_read_ns - early.t_read_ns) / (late.sequence - early.sequence)
        for early, late in itertools.pairwise(frames)
        if late.sequence > early.sequence
    ]
    middle = float(np.median(gaps)) if gaps else 0.0
    return 1e9 / middle if middle > 0 else 0.0


def find(scene: SceneSeries, table: Array, pictures_hz: float) -> InStep | None:
    """Look for it; `table`: linear light (256, 3) of each code."""
    if pictures_hz <= 0:
        return None
    best: InStep | None = None
    for hz in _MAINS_HZ:
        periods = hz / pictures_hz
        if round(periods) < 1 or abs(periods - round(periods)) > _IN_STEP:
            continue
        found = _explain(scene, table, hz)
        if found is not None and (best is None or found.explained > best.explained):
            best = found
    if best is None or best.explained < _EXPLAINED or best.share < _LEAST:
        return None
    return best


def _explain(scene: SceneSeries, table: Array, hz: float) -> InStep | None:
    """How well flicker of a frequency explains the contradictions of each band of rows."""
    phase = 2 * np.pi * hz * 1e-6 * scene.exposures_us
    log_t = np.log(scene.exposures_us)
    # A response other than the table's is smooth in the logarithm of exposure.
    smooth = np.stack([np.ones_like(log_t), log_t, log_t**2], axis=1)
    model = np.column_stack([smooth, np.sin(phase) / phase, (1 - np.cos(phase)) / phase])
    before = after = power = 0.0
    bands = 0
    for rows in np.array_split(np.arange(scene.codes.shape[1]), _BANDS):
        found = against(replace(scene, codes=scene.codes[:, rows]), table, _LEAST_PLACES)
        if found is None:
            continue
        errors = found[1]
        seen = np.isfinite(errors)
        if seen.sum() < _LEAST_STEPS:
            continue
        e = np.log1p(errors[seen])
        fitted = _left(e, model[seen])[0]
        before += float(np.mean(_left(e, smooth[seen])[1] ** 2))
        after += float(np.mean(_left(e, model[seen])[1] ** 2))
        power += float(fitted[-1] ** 2 + fitted[-2] ** 2)
        bands += 1
    if not bands or np.sqrt(before / bands) < _LEAST:
        return None
    return InStep(hz, float(np.sqrt(power / bands)), 1 - after / before)


def _left(values: Array, model: Array) -> tuple[Array, Array]:
    """Coefficients of a linear model, and what it leaves."""
    fitted = np.linalg.lstsq(model, values, rcond=None)[0]
    return np.asarray(fitted, dtype=np.float64), np.asarray(values - model @ fitted)
