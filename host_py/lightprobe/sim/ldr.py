"""Nine light-dependent resistors as they are built into a ring: all that a ring's owner cannot see.

Sources. R10, gamma, dark resistance and lag: data sheet of the GL5528 (8–20 kΩ at 10 lx, gamma
0.7 ± 0.1). Multiplexer: 74HC4067, 80 Ω typical at 4.5 V. Seats: 2° (hw/README.md, "From tolerance
to error"). Light from aside: what the resin over the cell reflects, by Schlick's
approximation of Fresnel's equations ("An inexpensive BRDF model", 1994): 1 − (1 − cosine)^5 of what
enters from the front enters, whatever the index. Former light and temperature: makers of CdS cells
state that a cell which has rested in the dark has 1.1 (at 100–1000 lx) to 1.2 times (at 10 lx) the
resistance of one that has rested in light, over minutes to hours (Excelitas, "Photoconductive
cells", light history), and draw resistances within ±25 % over some ±25 K (Selco, CdS photocells).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lightprobe.calibrate import ring
from lightprobe.geometry import Array

#: Relative change of resistance by a kelvin, and by a decade of light above that of the last hour.
PER_KELVIN = 0.005
PER_DECADE = 0.04
_MOST_DECADES = 3.0
#: At which R10 and gamma are those of the data sheet.
REFERENCE_C = 25.0
_R10_OHM, _GAMMA, _SERIES_OHM = (8e3, 20e3), (0.6, 0.8), (65.0, 105.0)
_SEAT_SIGMA_DEG = 2.0
_INDOORS_C = (15.0, 35.0)
_OFFSET_LSB = 2.0  # of the ADC, of its 1023; a level has four to it


@dataclass(frozen=True, eq=False)
class Ldrs:
    """Nine LDRs, their multiplexer and ADC; arrays are (9,) unless they say otherwise."""

    r10_ohm: Array
    gamma: Array
    series_ohm: Array
    seats_deg: Array  # (9, 2): right and up of where they should look; see `ring.directions`
    adc_offset_lsb: float = 0.0

    @classmethod
    def draw(cls, rng: np.random.Generator, spread: float = 1.0) -> Ldrs:
        """Take parts; `spread` 1: as different as their data sheets allow, 0: nominal."""
        series = rng.uniform(*_SERIES_OHM) + rng.uniform(-4.5, 4.5, ring.SENSORS)
        least, most = np.log(np.array(_R10_OHM) / ring.NOMINAL_R10_OHM)
        r10 = rng.uniform(least, most, ring.SENSORS)
        gamma = rng.uniform(*_GAMMA, ring.SENSORS)
        return cls(
            r10_ohm=ring.NOMINAL_R10_OHM * np.exp(spread * r10),
            gamma=ring.NOMINAL_GAMMA + spread * (gamma - ring.NOMINAL_GAMMA),
            series_ohm=series,
            seats_deg=spread * _SEAT_SIGMA_DEG * rng.standard_normal((ring.SENSORS, 2)),
            adc_offset_lsb=float(rng.uniform(-_OFFSET_LSB, _OFFSET_LSB)),
        )

    def directions(self) -> Array:
        """Where the sensors look, (9, 3) in the probe frame."""
        return ring.directions(self.seats_deg)

    def level(
        self, lux: ArrayLike, temperature_c: float = REFERENCE_C, rested_lux: ArrayLike = np.nan
    ) -> Array:
        """Levels (…, 9) that the microcontroller reads, 0…4092, at illuminances (…, 9).

        `rested_lux`: of the last hour, or NaN: the same light as now.
        """
        lux = np.asarray(lux, dtype=np.float64)
        true = ring.Ring(
            r10_ohm=self.r10_ohm * drift(lux, temperature_c, rested_lux),
            gamma=self.gamma,
            series_ohm=self.series_ohm,
        )
        level = true.level(lux) + self.adc_offset_lsb * ring.FULL_SCALE / 1023
        return np.asarray(np.clip(np.round(level), 0, ring.FULL_SCALE))


def drift(lux: ArrayLike, temperature_c: float, rested_lux: ArrayLike = np.nan) -> Array:
    """Resistance against that of the data sheet: by temperature, and by the light of before."""
    with np.errstate(divide="ignore", invalid="ignore"):
        decades = np.log10(np.asarray(lux, dtype=np.float64) / np.asarray(rested_lux))
    decades = np.clip(np.nan_to_num(decades), -_MOST_DECADES, _MOST_DECADES)
    return np.asarray(np.exp(PER_KELVIN * (temperature_c - REFERENCE_C) + PER_DECADE * decades))


def indoors_c(rng: np.random.Generator) -> float:
    """Temperature of a ring that stands somewhere."""
    return float(rng.uniform(*_INDOORS_C))


def response(cosine: Array) -> Array:
    """max(0, cosine), less what the resin reflects beyond what it does of light from the front."""
    front = np.maximum(cosine, 0)
    aside = 1 - front
    squared = aside * aside
    return np.asarray(front * (1 - squared * squared * aside))
