"""A sheet polarizer on the wheel before the lens."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sheet:
    """A sheet polarizer: `transmission` of light along its axis plus that across it."""

    transmission: float = 0.84
    extinction_ratio: float = 500.0
    offset_deg: float = 0.0  # from the wheel's angle to its axis

    @property
    def is_possible(self) -> bool:
        """Transmission 0.01…1, extinction ratio 1…1e9 and offset -180…180."""
        return (
            0.01 <= self.transmission <= 1
            and 1 <= self.extinction_ratio <= 1e9
            and abs(self.offset_deg) <= 180
        )

    @property
    def unpolarized_gain(self) -> float:
        """Share of unpolarized light that passes."""
        return self.transmission / 2

    @property
    def diattenuation(self) -> float:
        """(r − 1) / (r + 1)."""
        return (self.extinction_ratio - 1) / (self.extinction_ratio + 1)
