"""White balance: do colours stay while nothing changes, and beside something coloured?

Ratios of red and blue to green, at places that keep their brightness. What multiplies them all
alike is the camera's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightprobe.calibrate.exposure_series import ExposureSeries
from lightprobe.calibrate.flat_patches import step_of
from lightprobe.calibrate.response_curve import curve_at
from lightprobe.check_camera.answers import Answer, Outcome
from lightprobe.geometry import Array

DRIFTS, ADAPTS = "white balance at rest", "white balance and colours"
#: Changes of a ratio, relative, from which on it moves.
NOTICED = 0.01
#: And from which on colours are worth little.
TOO_MUCH = 0.1
#: Every camera obeys its command within this.
_SETTLES_S = 0.7
#: Within this an automatic has found its way after other exposures.
_AUTOMATIC_S = 10.0
_LOW, _HIGH = 24.0, 225.0
_LEAST_PLACES = 60
#: A place that keeps its green within this is not covered; a coloured thing covers such a share.
_SAME_GREEN, _LEAST_COVERED = 0.03, 0.08
#: It must change the colour of the whole picture by this.
_LEAST_CAST = 0.06
#: A change of so many times what is seen at rest is more than drift.
_DRIFT_EXPLAINS = 1.5
#: Places whose ratios change by different amounts: the light has changed, not the camera.
#: By a share of that change, and by more than what JPEG's rounding of colours makes.
_MOST_SCATTER, _ROUNDING = 0.5, 0.06
_STEP = (
    "hold it (white_balance_k in the camera file; v4l2-ctl -c white_balance_automatic=0); if it "
    "still moves, take another camera"
)


@dataclass(frozen=True, eq=False)
class Colours:
    """Logarithms of linear light (times, rows, columns, 3) of one exposure; NaN: unusable."""

    light: Array
    t_s: Array  # (times,) since the first
    whole: Array  # (times, 3) mean linear light of all of the picture


def colours(series: ExposureSeries, table: Array) -> Colours:
    """Read the frames that are left of a series of one exposure; `table`: (256, 3) light of codes.

    Frames whose files are gone do not count, nor do the first, which may have another exposure.
    """
    found, times, whole = [], [], []
    begin_ns = series.frames[0].t_read_ns + round(1e9 * _SETTLES_S) if series.frames else 0
    for frame in series.frames:
        late = frame.t_read_ns >= begin_ns
        picture = frame.codes() if late and frame.path.exists() else None
        if picture is None:
            continue
        step = step_of(1.0, [picture])
        if step is None:
            continue
        good = np.all((step.mean > _LOW) & (step.mean < _HIGH) & (step.highest < 253), axis=-1)
        light = np.stack([curve_at(table[:, c], step.mean[..., c]) for c in range(3)], axis=-1)
        found.append(np.where(good[..., None], np.log(np.maximum(light, 1e-7)), np.nan))
        times.append(1e-9 * frame.t_read_ns)
        whole.append(light.mean(axis=(0, 1)))
    if not found:
        return Colours(np.zeros((0, 0, 0, 3)), np.zeros(0), np.zeros((0, 3)))
    return Colours(np.stack(found), np.array(times) - times[0], np.stack(whole))


@dataclass(frozen=True, eq=False)
class Drift:
    """Red and blue against green over time."""

    ratios: Array  # (times, 2) logarithms, their mean is 0
    t_s: Array
    scatter: float  # of places, 1 sigma, in what changed most
    places: int

    @property
    def size(self) -> float:
        """From the smallest ratio to the largest, relative."""
        return float(np.ptp(self.ratios, axis=0).max(initial=0.0)) if len(self.ratios) else 0.0


def drift(rest: Colours) -> Drift | None:
    """Follow colours over time; None: too little is seen."""
    settled = rest.t_s >= min(_AUTOMATIC_S, 0.4 * rest.t_s.max(initial=0.0))
    rest = Colours(rest.light[settled], rest.t_s[settled], rest.whole[settled])
    if len(rest.t_s) < 4:
        return None
    good = np.all(np.isfinite(rest.light), axis=(0, 3))
    if good.sum() < _LEAST_PLACES:
        return None
    light = rest.light[:, good]
    ratios = light[..., [0, 2]] - light[..., [1]]
    ratios = ratios - ratios.mean(axis=0)
    common = np.median(ratios, axis=1)
    swing = np.ptp(common, axis=0)
    which = int(np.argmax(swing))
    low, high = np.argmin(common[:, which]), np.argmax(common[:, which])
    each = ratios[high, :, which] - ratios[low, :, which]
    spread = float(np.median(np.abs(each - np.median(each)))) * 1.48
    return Drift(common, rest.t_s, spread, int(good.sum()))


def judge_drift(found: Drift | None) -> Answer:
    """Say whether the white balance stays at rest."""
    if found is None:
        return Answer(
            DRIFTS, Outcome.UNKNOWN, "because too few places are well exposed in all colours",
            "point the camera at a lit room with pale walls",
        )  # fmt: skip
    seconds = float(found.t_s[-1] - found.t_s[0])
    numbers = {"change": found.size, "seconds": seconds}
    if found.size < NOTICED:
        words = f"stays within {100 * found.size:.1f} % for {seconds:.0f} s"
        return Answer(DRIFTS, Outcome.FINE, words, numbers=numbers)
    if found.scatter > max(_MOST_SCATTER * found.size, _ROUNDING):
        return Answer(
            DRIFTS, Outcome.UNKNOWN, "because the light itself changes: not all places alike",
            "keep lamps and people as they are for the minute", numbers,
        )  # fmt: skip
    words = f"white balance that drifts by {100 * found.size:.0f} % at rest"
    outcome = Outcome.UNFIT if found.size > TOO_MUCH else Outcome.DEFECT
    return Answer(DRIFTS, outcome, words, _STEP, numbers)


@dataclass(frozen=True)
class Adaption:
    """What a coloured thing before the lens did to the colours of the rest."""

    shift: float  # largest change of a ratio beside it, relative
    cast: float  # of the whole picture
    covered: float  # share of the picture
    places: int


def adaption(before: Colours, after: Colours) -> Adaption | None:
    """Compare the ends of two series; None: too little is seen."""
    if not len(before.t_s) or not len(after.t_s):
        return None
    first, last = before.light[-3:].mean(axis=0), after.light[-3:].mean(axis=0)
    seen = np.all(np.isfinite(first), axis=-1)
    both = seen & np.all(np.isfinite(last), axis=-1)
    change = last - first
    same = both & (np.abs(change[..., 1]) < _SAME_GREEN)
    if same.sum() < _LEAST_PLACES:
        return None
    ratio = change[..., [0, 2]] - change[..., [1]]
    shift = np.median(ratio[same], axis=0)
    looks = np.log(np.maximum([before.whole[-1], after.whole[-1]], 1e-7))
    tints = looks[:, [0, 2]] - looks[:, [1]]
    cast = np.abs(tints[1] - tints[0] - shift).max()
    covered = 1 - same.sum() / max(int(seen.sum()), 1)
    return Adaption(float(np.abs(shift).max()), float(cast), float(covered), int(same.sum()))


def judge_adaption(found: Adaption | None, drifts: float = 0.0) -> Answer:
    """Say whether the white balance follows what is in view; `drifts`: by so much at rest."""
    step = "hold a bright red or blue cloth or paper before a third of the view, in good light"
    if found is None:
        why = "because too few places are seen beside the coloured thing"
        return Answer(ADAPTS, Outcome.UNKNOWN, why, step)
    numbers = {"shift": found.shift, "cast": found.cast, "covered": found.covered}
    if found.shift >= NOTICED and found.shift <= _DRIFT_EXPLAINS * drifts:
        return Answer(
            ADAPTS, Outcome.UNKNOWN, "because the white balance drifts at rest already", _STEP,
            numbers,
        )  # fmt: skip
    if found.shift >= NOTICED:
        words = f"white balance that follows what is in view (by {100 * found.shift:.0f} %)"
        outcome = Outcome.UNFIT if found.shift > TOO_MUCH else Outcome.DEFECT
        return Answer(ADAPTS, outcome, words, _STEP, numbers)
    if found.covered < _LEAST_COVERED or found.cast < _LEAST_CAST:
        why = "because nothing large and coloured came into view"
        return Answer(ADAPTS, Outcome.UNKNOWN, why, step, numbers)
    words = f"stays within {100 * found.shift:.1f} % beside something coloured"
    return Answer(ADAPTS, Outcome.FINE, words, numbers=numbers)
