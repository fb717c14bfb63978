"""What the ring reads, against the light that the camera sees, while the box is turned.

Each reading is compared with the illuminance at its own time, which is interpolated between the two
nearest estimates and lags as an LDR does. The illuminance is computed where each sensor should look
and a little to the right, left, up and down of it; from these differences its seat is found.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry
from lightprobe.calibrate import ring
from lightprobe.calibrate.files import CalibrationError
from lightprobe.calibrate.ring_pairs import Watch
from lightprobe.estimate import Estimate, EstimateFlag
from lightprobe.geometry import Array

#: Right, left, up and down of a sensor's direction by so much.
ASIDE_DEG = 3.0
_PLACES = ASIDE_DEG * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
#: Between estimates farther apart than this the light is not known; where orientation is known, the
#: box may also have turned by so little meanwhile that the light changes evenly.
_MOST_GAP_S, _MOST_GAP_DEG, _MOST_LONG_GAP_S = 0.2, 6.0, 1.0
#: Time constants of the LDRs, and how long until their state at the start is forgotten.
_RISE_S, _FALL_S = ring.NOMINAL_RISE_MS / 1000, ring.NOMINAL_FALL_MS / 1000
_SETTLE_S = 0.3
#: Of the estimates, at least so many must be fit.
_LEAST_FIT = 0.5
#: The light on a sensor, brightest to darkest: its exponent is told by that.
_LEAST_RANGE = 1.5
#: The box must have looked into so many of twelve sectors of 30 degrees.
_SECTORS, _LEAST_SECTORS = 12, 10
#: Why estimates are not fit, in words, and what to do about it.
_REASONS = {
    EstimateFlag.CLIPPED: "clipping: lamps are brighter than the shortest exposure shows: choose "
    "light without direct sun, or more exposures (--brackets)",
    EstimateFlag.FLICKER: "flicker: lamps flicker faster than the camera follows: choose daylight "
    "or lamps that do not",
    EstimateFlag.EXPOSURE_UNKNOWN: "exposures are not known: choose a camera that tells them, or "
    "set one with --exposure-us",
    EstimateFlag.UNDEREXPOSED: "darkness: switch lamps on",
    EstimateFlag.STALE: "the camera gives no frames",
}


@dataclass(frozen=True, eq=False)
class Samples:
    """Readings with the light of their times."""

    lux: Array  # (N, 5, 9): straight ahead, right, left, up, down by ASIDE_DEG
    level: Array  # (N, 9); NaN: dead


@dataclass
class Turning(Watch):
    """What camera and ring have seen while the box was turned."""

    _unfit = Watch._unfit | EstimateFlag.MOTION | EstimateFlag.COVERED | EstimateFlag.FLICKER

    _forward: list[Array] = field(default_factory=list)  # of the box, where that is known
    _flags: Counter[EstimateFlag] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        """Look aside, too."""
        self._directions = np.concatenate([
            ring.directions(np.tile(place, (ring.SENSORS, 1))) for place in _PLACES
        ])  # fmt: skip

    def estimate(self, estimate: Estimate, cd_m2_per_unit: float, now_ns: int) -> bool:
        """See :meth:`Watch.estimate`."""
        if not super().estimate(estimate, cd_m2_per_unit, now_ns):
            return False
        self._flags.update(flag for flag in _REASONS if estimate.flags & flag)
        forward = np.full(3, np.nan)
        if estimate.orientation is not None:
            x, y, z, w = estimate.orientation
            forward = geometry.rotate([w, x, y, z], [0.0, 0.0, -1.0])
        self._forward.append(forward)
        return True

    @property
    def sectors(self) -> int:
        """Into how many of twelve sectors around the vertical the box has looked so far."""
        forward = np.reshape(self._forward, (-1, 3))
        forward = forward[np.isfinite(forward[:, 0])]
        azimuth = np.arctan2(forward[:, 0], -forward[:, 2]) % (2 * np.pi)
        return len(set((azimuth / (2 * np.pi) * _SECTORS).astype(int).tolist()))

    def samples(self) -> Samples:
        """Give what can be compared; raises CalibrationError with the reason why it is too little.

        Reasons: no or unfit estimates (clipping, flicker, unknown exposures, darkness), no reading,
        too little turning, too little range of light.
        """
        self._refuse_unfit()
        times, lux = np.array(self._lux_times), np.array(self._lux)
        level_times, levels = np.array(self._level_times), np.array(self._levels)
        if not len(levels):
            raise CalibrationError("calibrate: ring: no reading has come from the ring")
        after = np.clip(np.searchsorted(times, level_times), 1, len(times) - 1)
        share = (level_times - times[after - 1]) / (times[after] - times[after - 1])
        ends = lux[after - 1], lux[after]
        known = (
            (share >= 0) & (share <= 1) & self._close(after - 1, after)
            & np.isfinite(ends[0]).all(axis=1) & np.isfinite(ends[1]).all(axis=1)
        )  # fmt: skip
        with np.errstate(invalid="ignore"):
            between = ends[0] + share[:, None] * (ends[1] - ends[0])
        felt, settled = _followed(level_times, between, known)
        samples = Samples(felt[settled].reshape(-1, len(_PLACES), ring.SENSORS), levels[settled])
        self._refuse_too_little(samples)
        return samples

    def _close(self, first: NDArray[np.intp], then: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether the light between two estimates is known by both."""
        gap_s = np.array(self._lux_times)[then] - np.array(self._lux_times)[first]
        forward = np.array(self._forward)
        cosine = np.einsum("ij,ij->i", forward[first], forward[then])
        with np.errstate(invalid="ignore"):
            slowly = cosine > np.cos(np.radians(_MOST_GAP_DEG))  # NaN: not known
        return np.asarray((gap_s < _MOST_GAP_S) | (slowly & (gap_s < _MOST_LONG_GAP_S)))

    def _refuse_unfit(self) -> None:
        total = len(self._lux)
        if total < 2:
            raise CalibrationError("calibrate: ring: no estimates have come from the probe")
        fit = sum(bool(np.isfinite(lux).all()) for lux in self._lux) / total
        if fit >= _LEAST_FIT:
            return
        unfit = (1 - fit) * total
        common = [flag for flag, number in self._flags.most_common() if number > unfit / 4]
        words = "; ".join(_REASONS[flag] for flag in common) or "the camera was covered or shaken"
        raise CalibrationError(
            f"calibrate: ring: only {100 * fit:.0f} % of {total} estimates can be used: {words}"
        )

    def _refuse_too_little(self, samples: Samples) -> None:
        if np.isfinite(self._forward).any() and self.sectors < _LEAST_SECTORS:
            raise CalibrationError(
                f"calibrate: ring: too little turning: the box has looked into {self.sectors} of "
                f"{_SECTORS} directions: turn it slowly around, twice, and up and down"
            )
        if not len(samples.lux):
            raise CalibrationError(
                "calibrate: ring: no reading has an estimate before and after it: does the probe "
                "give estimates all the time?"
            )
        around = samples.lux[:, 0, :8]
        span = float(np.median(around.max(axis=0) / np.maximum(around.min(axis=0), 1e-9)))
        if span < _LEAST_RANGE:
            raise CalibrationError(
                f"calibrate: ring: too little range of light: the brightest moment of a sensor is "
                f"{span:.1f} times the darkest, {_LEAST_RANGE:g} are needed: turn it towards and "
                "away from a window or a lamp"
            )


def _followed(times: Array, lux: Array, known: Array) -> tuple[Array, Array]:
    """What LDRs feel of lux (N, M) at times (N,), and where that has settled, (N,) bool."""
    felt = np.zeros_like(lux)
    settled = np.zeros(len(times), dtype=bool)
    since = np.inf
    for i, time in enumerate(times):
        step = time - times[i - 1] if i else np.inf
        if not known[i]:
            since = np.inf
            continue
        if not np.isfinite(since) or step > _MOST_GAP_S:
            felt[i], since = lux[i], time
        else:
            lag = np.where(lux[i] > felt[i - 1], _RISE_S, _FALL_S)
            felt[i] = felt[i - 1] + (lux[i] - felt[i - 1]) * (1 - np.exp(-step / lag))
        settled[i] = time - since >= _SETTLE_S
    return felt, settled
