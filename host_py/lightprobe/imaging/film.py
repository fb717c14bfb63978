"""A sheet polarizer on the wheel before the lens."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sheet:
    """A sheet polarizer: `transmission` of light along its axis plus that across it, head-on.

    `index`: refractive, of its two surfaces; 1: they do nothing; one between 1 and 1.5 describes an
    antireflection coating.
    """

    transmission: float = 0.84
    extinction_ratio: float = 500.0
    offset_deg: float = 0.0  # from the wheel's angle to its axis
    index: float = 1.5

    @property
    def is_possible(self) -> bool:
        """Transmission 0.01…1, extinction ratio 1…1e9, offset -180…180 and index 1…2."""
        return (
            0.01 <= self.transmission <= 1
            and 1 <= self.extinction_ratio <= 1e9
            and abs(self.offset_deg) <= 180
            and 1 <= self.index <= 2
        )

    @property
    def unpolarized_gain(self) -> float:
        """Share of unpolarized light that passes along its normal."""
        return self.transmission / 2

    @property
    def diattenuation(self) -> float:
        """(r − 1) / (r + 1)."""
        return (self.extinction_ratio - 1) / (self.extinction_ratio + 1)
