"""Pairs of illuminance and level, from a probe's estimates and its ring, matched by their times.

Estimates and readings arrive late, each by its own delay, and the longer the busier the machine is.
Both carry the time of their light by a clock of their own, which is what they are matched by.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from lightprobe.calibrate import ring
from lightprobe.clock_offset import ClockOffset
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, EstimateFlag
from lightprobe.geometry import Array

#: A pair is the mean of so long a moment.
_MOMENT_S = 0.4
#: The ring must have seen the same light for so long before: LDRs take some 30 ms and more in the
#: dark; the daemon took up to 1.5 s until its exposures had found a lamp that was switched on
#: (simulated rooms, 20 frames a second).
_REST_S = 2.0
#: The same light: all values within such a share of their mean.
_STEADY = 0.03
#: Estimates that tell less light than there is, or light of another moment.
_UNFIT = (
    EstimateFlag.STALE | EstimateFlag.EXPOSURE_UNKNOWN | EstimateFlag.CLIPPED
    | EstimateFlag.UNDEREXPOSED | EstimateFlag.BRACKET_INCOMPLETE | EstimateFlag.PARTIAL_VIEW
    | EstimateFlag.INVALID_INPUT | EstimateFlag.NO_LIGHT
)  # fmt: skip
_WRAP_US = 1 << 32  # of the microcontroller's clock


@dataclass
class Watch:
    """What camera and ring have seen; times in seconds of our monotonic clock."""

    #: Estimates with one of these flags are not used.
    _unfit: ClassVar[EstimateFlag] = _UNFIT

    _levels: list[Array] = field(default_factory=list)
    _level_times: list[float] = field(default_factory=list)
    _lux: list[Array] = field(default_factory=list)
    _lux_times: list[float] = field(default_factory=list)
    _mcu_clock: ClockOffset = field(default_factory=ClockOffset)
    _probe_clock: ClockOffset = field(default_factory=ClockOffset)
    _directions: Array = field(default_factory=ring.directions)  # (N, 3), that lux is of
    _mcu_us: int = 0  # of the newest reading, not wrapped
    _captured_unix_ns: int = -1  # of the newest estimate

    def ring(self, t_us: int, levels: Array, now_ns: int) -> None:
        """Note a reading of `t_us` that arrived at `now_ns`; they come in the order of their times.

        `levels` (9,): NaN for a sensor that is dead.
        """
        self._mcu_us += (t_us - self._mcu_us) % _WRAP_US
        self._mcu_clock.arrived(1000 * self._mcu_us, now_ns)
        self._level_times.append(1e-9 * self._mcu_clock.ours_ns(1000 * self._mcu_us))
        self._levels.append(levels)

    def estimate(self, estimate: Estimate, cd_m2_per_unit: float, now_ns: int) -> bool:
        """Note an estimate that arrived at `now_ns`.

        False: it is of the same moment as the one before. A probe whose frames are late says the
        last one again and again, as STALE.
        """
        self._probe_clock.arrived(estimate.send_time_unix_ns, now_ns)
        if estimate.capture_time_unix_ns == self._captured_unix_ns:
            return False
        self._captured_unix_ns = estimate.capture_time_unix_ns
        self._lux_times.append(1e-9 * self._probe_clock.ours_ns(estimate.capture_time_unix_ns))
        fit = not estimate.flags & self._unfit
        lux = cd_m2_per_unit * luminance(estimate.irradiance(self._directions))
        self._lux.append(lux if fit else np.full(len(self._directions), np.inf))
        return True

    def pairs(self) -> tuple[Array, Array]:
        """Illuminances and levels (N, 9) of the moments at which the light was the same for both.

        NaN: a level of a sensor that was dead.
        """
        level_times, lux_times = np.array(self._level_times), np.array(self._lux_times)
        lux, level = [], []
        first = level_times[0] + _REST_S if self._levels else 0.0
        last = level_times[-1] if self._levels else 0.0
        for start in np.arange(first, last - _MOMENT_S, _MOMENT_S):
            moment = (lux_times >= start) & (lux_times < start + _MOMENT_S)
            rest = (level_times >= start - _REST_S) & (level_times < start + _MOMENT_S)
            during = rest & (level_times >= start)
            seen, read = np.array(self._lux)[moment], np.array(self._levels)[rest]
            if during.sum() >= 2 and _steady(seen) and _steady(read):
                lux.append(seen.mean(axis=0))
                level.append(np.array(self._levels)[during].mean(axis=0))
        shape = (len(lux), ring.SENSORS)
        return np.reshape(lux, shape), np.reshape(level, shape)


def _steady(values: Array) -> bool:
    """Whether values (N, 9) are two or more, and the same; NaN: a sensor that does not count."""
    if len(values) < 2 or np.isinf(values).any():
        return False
    known = values[:, ~np.isnan(values).any(axis=0)]
    return bool(np.all(np.ptp(known, axis=0) <= _STEADY * np.abs(known.mean(axis=0))))
