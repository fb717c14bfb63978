"""Lamps on the mains: by how much each is brighter or darker than its mean, and when."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lightprobe.errors import UsageError
from lightprobe.geometry import Array

#: Below this many periods an exposure shows the moment, not a mean.
_MOMENT = 1e-6


def _sine(turns: Array) -> Array:
    return (1 - np.cos(2 * np.pi * turns)) / (2 * np.pi)


def _rectified(turns: Array) -> Array:
    whole = np.floor(turns)
    # ∫|sin πx| is 2/π per period; the wave is |sin| less its mean, by its mean.
    return np.asarray(whole + (1 - np.cos(np.pi * (turns - whole))) / 2 - turns)


def _square(turns: Array) -> Array:
    part = turns - np.floor(turns)
    return np.minimum(part, 1 - part)


#: Integrals of the waves over periods since a zero; each wave has mean 0 and depth 1 below it.
WAVES: dict[str, Callable[[Array], Array]] = {
    "sine": _sine,  # filament lamps
    "rectified": _rectified,  # LEDs and tubes without a buffer: |sin|
    "square": _square,  # dimmed by switching, half of the time on
}


@dataclass(frozen=True)
class Flicker:
    """How the lamps flicker. Lamp k takes entry k of each list; lists begin again at their end."""

    hz: float = 0.0  # 100 or 120: twice the mains'; 0: not at all
    depths: tuple[float, ...] = (0.0,)  # at its darkest a lamp loses this share
    phases: tuple[float, ...] = (0.0,)  # of a period; a third apart on the mains' three phases
    waves: tuple[str, ...] = ("sine",)  # of WAVES

    def __post_init__(self) -> None:
        """Check all; UsageError."""
        if not (self.depths and self.phases and self.waves):
            raise UsageError("flicker: a list is empty: give it an entry for the first lamp")
        if not all(0 <= depth <= 1 for depth in self.depths):
            raise UsageError(f"flicker: depths {_text(self.depths)}: expected shares, 0…1")
        if not np.all(np.isfinite(self.phases)):
            raise UsageError(f"flicker: phases {_text(self.phases)}: expected parts of a period")
        if unknown := [wave for wave in self.waves if wave not in WAVES]:
            raise UsageError(f"flicker: wave {unknown[0]}: expected {', '.join(WAVES)}")

    @property
    def is_on(self) -> bool:
        """True when anything flickers."""
        return self.hz > 0 and any(self.depths)

    def powers(self, lamps: int, t_s: ArrayLike, exposure_s: float) -> Array:
        """Mean powers (…, lamps) over exposures that start at `t_s` (…); 1 is a lamp's mean."""
        start = self.hz * np.asarray(t_s, dtype=np.float64)
        turns = max(self.hz * exposure_s, _MOMENT)
        columns = []
        for k in range(lamps):
            depth, phase = self.depths[k % len(self.depths)], self.phases[k % len(self.phases)]
            integral = WAVES[self.waves[k % len(self.waves)]]
            # Of large times only the part of a period counts; else digits were lost.
            begin = (start + phase) % 1
            mean = (integral(begin + turns) - integral(begin)) / turns
            columns.append(1 + depth * mean)
        return np.stack(columns, axis=-1) if columns else np.zeros((*start.shape, 0))


def _text(values: tuple[float, ...]) -> str:
    return ",".join(f"{value:g}" for value in values)
