"""The ring of nine light sensors: where they look, and what their voltages mean.

Each LDR goes from the supply through a channel of the multiplexer to a pin, and a resistor from
there to ground. With E the illuminance in lux, R = r10·(E / 10 lx)^−gamma (data sheet of the
GL5528; gamma = log10(R at 10 lx / R at 100 lx)), and the microcontroller reads
level = 4092 · divider / (divider + series + R). Levels are proportional to the supply, so the
supply does not matter. The series resistance matters in bright light: at 10 klx R is 110 Ω.
"""

from __future__ import annotations

import configparser
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe.calibrate.files import CalibrationError
from lightprobe.geometry import Array

SENSORS = 9
FULL_SCALE = 4092
VERSION = 2
#: Of a GL5528 and a 74HC4067, when nobody has calibrated them: 8–20 kΩ at 10 lx, gamma 0.7 ± 0.1,
#: 80 Ω typical at 4.5 V (data sheets).
NOMINAL_R10_OHM, NOMINAL_GAMMA, NOMINAL_SERIES_OHM = 14000.0, 0.7, 85.0
NOMINAL_SIGMA, NOMINAL_GAMMA_SIGMA, NOMINAL_SERIES_SIGMA_OHM = 0.4, 0.1, 25.0
#: An LDR's illuminance, as it drifts with temperature and with the light it has seen before.
DRIFT_SIGMA = 0.15
#: That part of it which is each sensor's own, and that which all nine have in common: they are as
#: warm as each other. Together DRIFT_SIGMA. Simulated rings drift by less than 5 % of their own
#: (tests/e2e/test_calibrate_ring_camera.py).
DRIFT_OWN_SIGMA = 0.05
DRIFT_COMMON_SIGMA = float(np.sqrt(DRIFT_SIGMA**2 - DRIFT_OWN_SIGMA**2))
#: A level: the ADC's offset (2 counts at most, data sheet of the ATmega328P) and its steps.
LEVEL_SIGMA = 6.0
DIVIDER_OHM = 3300.0
#: Limits of the calibration file: nine numbers of each, and one of each.
LIMITS = {
    "r10_ohm": (100, 1e6),
    "gamma": (0.3, 1.5),
    "series_ohm": (0, 1000),
    "sigma": (0, 10),
    "gamma_sigma": (0, 1),
    "series_sigma_ohm": (0, 1000),
    "pivot_lux": (1e-3, 1e6),
}
ALIKE_LIMITS = {"divider_ohm": (10, 1e6), "drift_sigma": (0, 10)}
#: Time constants of a GL5528 at 10 lx (data sheet); files may leave them out.
NOMINAL_RISE_MS, NOMINAL_FALL_MS = 20.0, 30.0
LAG_LIMITS = {"rise_ms": (0, 10000), "fall_ms": (0, 10000)}
#: These may be left out: nine numbers of each, and one.
SEAT_LIMITS = {"seat_right_deg": (-30, 30), "seat_up_deg": (-30, 30)}
COMMON_LIMITS = {"drift_common_sigma": (0, 10)}


def directions(seats_deg: ArrayLike = 0.0) -> Array:
    """Where the sensors look, (9, 3) in the probe frame: eight around, one up (docs).

    `seats_deg` (9, 2): how far they are turned to their right and up, as seen by somebody who looks
    along with them; the one on top has +X to its right, and +Z up.
    """
    azimuth = np.radians(45.0 * np.arange(8))
    around = np.stack([np.cos(azimuth), np.zeros(8), np.sin(azimuth)], axis=-1)
    forward = np.vstack([around, [0.0, 1.0, 0.0]])
    up = np.vstack([np.tile([0.0, 1.0, 0.0], (8, 1)), [0.0, 0.0, 1.0]])
    tilt = np.tan(np.radians(np.broadcast_to(seats_deg, (SENSORS, 2))))
    turned = forward + tilt[:, :1] * np.cross(forward, up) + tilt[:, 1:] * up
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def _nine(value: float) -> Callable[[], Array]:
    return lambda: np.full(SENSORS, value)


@dataclass(frozen=True, eq=False)
class Ring:
    """Nine LDRs, the resistances around them, and how well all that is known.

    The relative sigma of an illuminance is `sigma` at `pivot_lux`, where the fit knows it best, and
    grows away from there by what gamma may be off, and towards bright light by what the resistance
    in series may be off.
    """

    r10_ohm: Array = field(default_factory=_nine(NOMINAL_R10_OHM))
    gamma: Array = field(default_factory=_nine(NOMINAL_GAMMA))
    series_ohm: Array = field(
        default_factory=_nine(NOMINAL_SERIES_OHM)
    )  # the multiplexer's channel
    sigma: Array = field(default_factory=_nine(NOMINAL_SIGMA))  # relative, of the illuminance
    gamma_sigma: Array = field(default_factory=_nine(NOMINAL_GAMMA_SIGMA))
    series_sigma_ohm: Array = field(default_factory=_nine(NOMINAL_SERIES_SIGMA_OHM))
    pivot_lux: Array = field(default_factory=_nine(10.0))
    divider_ohm: float = DIVIDER_OHM
    drift_sigma: float = DRIFT_SIGMA
    rise_ms: float = NOMINAL_RISE_MS  # at 10 lx
    fall_ms: float = NOMINAL_FALL_MS
    drift_common_sigma: float = 0.0  # of all sensors together
    seat_right_deg: Array = field(default_factory=_nine(0.0))  # see `directions`
    seat_up_deg: Array = field(default_factory=_nine(0.0))

    @property
    def seats_deg(self) -> Array:
        """Seats (9, 2), as `directions` takes them."""
        return np.stack([self.seat_right_deg, self.seat_up_deg], axis=-1)

    def resistance_ohm(self, lux: ArrayLike) -> Array:
        """Resistance (…, 9) of the LDRs at illuminances (…, 9) above 0."""
        return np.asarray(self.r10_ohm * (np.asarray(lux, dtype=np.float64) / 10) ** -self.gamma)

    def level(self, lux: ArrayLike) -> Array:
        """Level (…, 9), 0…4092, not rounded, at illuminances (…, 9); 0 lx gives 0."""
        lux = np.asarray(lux, dtype=np.float64)
        with np.errstate(divide="ignore"):
            around = self.divider_ohm + self.series_ohm + self.resistance_ohm(lux)
            return np.asarray(FULL_SCALE * self.divider_ohm / around)

    def ldr_ohm(self, level: ArrayLike) -> Array:
        """Resistance (…, 9) of the LDRs at levels (…, 9) above 0; negative for one too high."""
        return total_ohm(level, self.divider_ohm) - self.series_ohm

    def lux(self, level: ArrayLike) -> Array:
        """Illuminance (…, 9) of levels (…, 9); NaN where there is none: 0, and full scale."""
        level = np.asarray(level, dtype=np.float64)
        usable = _usable(level)
        ohm, _ = self._ohm_and_sigma(np.where(usable, level, FULL_SCALE / 2))
        return np.where(usable, 10 * (self.r10_ohm / ohm) ** (1 / self.gamma), np.nan)

    def sigma_of(self, level: ArrayLike) -> Array:
        """Relative 1 sigma (…, 9) of the illuminance at levels (…, 9); NaN where there is none.

        Of each sensor by itself: what they have in common is `drift_common_sigma`.
        """
        level = np.asarray(level, dtype=np.float64)
        usable = _usable(level)
        ohm, ohm_sigma = self._ohm_and_sigma(np.where(usable, level, FULL_SCALE / 2))
        lux = 10 * (self.r10_ohm / ohm) ** (1 / self.gamma)
        away = np.log(lux / self.pivot_lux) * self.gamma_sigma
        variance = (np.hypot(away, ohm_sigma / ohm) / self.gamma) ** 2
        return np.where(usable, np.sqrt(variance + self.sigma**2 + self.drift_sigma**2), np.nan)

    def total_sigma_of(self, level: ArrayLike) -> Array:
        """Likewise, with what all sensors have in common."""
        return np.asarray(np.hypot(self.sigma_of(level), self.drift_common_sigma))

    def _ohm_and_sigma(self, level: Array) -> tuple[Array, Array]:
        """Resistance of the LDRs with its 1 sigma; at least half of it: no LDR has none."""
        slope = self.divider_ohm * FULL_SCALE / level**2
        sigma = np.hypot(slope * LEVEL_SIGMA, self.series_sigma_ohm)
        return np.maximum(self.ldr_ohm(level), np.maximum(sigma / 2, 1e-3)), sigma

    def text(self) -> str:
        """As a calibration file."""
        lines = ["[ring]", f"version = {VERSION}"]
        lines += [f"{name} = {getattr(self, name):.6g}" for name in (*ALIKE_LIMITS, *LAG_LIMITS)]
        for name in LIMITS:
            numbers = ", ".join(f"{value:.6g}" for value in getattr(self, name))
            lines.append(f"{name} = {numbers}")
        if self.drift_common_sigma:
            lines.append(f"drift_common_sigma = {self.drift_common_sigma:.6g}")
        if self.seats_deg.any():
            for name in SEAT_LIMITS:
                numbers = ", ".join(f"{value:.3g}" for value in getattr(self, name))
                lines.append(f"{name} = {numbers}")
        return "\n".join(lines) + "\n"


def _usable(level: Array) -> NDArray[np.bool_]:
    return (level > 0) & (level < FULL_SCALE)


def levels(counts: ArrayLike, dead: ArrayLike) -> Array:
    """Levels (9,) of a reading; NaN where a sensor is dead."""
    return np.where(dead, np.nan, np.asarray(counts, dtype=np.float64))


def total_ohm(level: ArrayLike, divider_ohm: float = DIVIDER_OHM) -> Array:
    """Resistance of an LDR and what is in series with it, from a level above 0."""
    return np.asarray(divider_ohm * (FULL_SCALE / np.asarray(level, dtype=np.float64) - 1))


def load(path: Path) -> Ring:
    """Read a calibration file; raises :class:`CalibrationError`."""
    config = configparser.ConfigParser(inline_comment_prefixes=(";", "#"))
    try:
        with open(path, encoding="utf-8") as file:
            config.read_file(file)
    except OSError as error:
        raise CalibrationError(
            f"ring: {path}: open: {error.strerror}: lightprobe calibrate ring writes one"
        ) from None
    except (configparser.Error, UnicodeDecodeError) as error:
        words = " ".join(str(error).split())
        raise CalibrationError(f"ring: {path}: parse: {words}") from None
    if not config.has_section("ring"):
        raise CalibrationError(f"ring: {path}: section [ring] is missing")
    section = dict(config["ring"])
    version = section.pop("version", "none")
    if version != str(VERSION):
        raise CalibrationError(
            f"ring: {path}: version {version}: this program reads version {VERSION}: calibrate "
            f"again"
        )
    values: dict[str, Any] = {
        name: _numbers(path, section, name, SENSORS, limits) for name, limits in LIMITS.items()
    }
    for name, limits in ALIKE_LIMITS.items():
        values[name] = float(_numbers(path, section, name, 1, limits)[0])
    for name, limits in SEAT_LIMITS.items():
        if name in section:
            values[name] = _numbers(path, section, name, SENSORS, limits)
    for name, limits in (LAG_LIMITS | COMMON_LIMITS).items():
        if name in section:
            values[name] = float(_numbers(path, section, name, 1, limits)[0])
    ring = Ring(**values)
    if section:
        raise CalibrationError(f"ring: {path}: unknown key {next(iter(section))}")
    return ring


def _numbers(
    path: Path, section: dict[str, str], key: str, count: int, limits: tuple[float, float]
) -> NDArray[np.float64]:
    """Take so many numbers of a key out of a section."""
    text = section.pop(key, "")
    try:
        values = np.array([float(word) for word in text.split(",")])
    except ValueError:
        values = np.array([])
    low, high = limits
    if len(values) != count or not np.all((values >= low) & (values <= high)):
        raise CalibrationError(
            f"ring: {path}: {key} = {text}: expected {count} numbers from {low:g} to {high:g}"
        )
    return values
