"""The ring of nine light sensors: where they look, and what their voltages mean.

Each LDR goes from the supply to its pin, a resistor from there to ground. With E the illuminance
in lux, R = r10·(E / 10 lx)^−gamma (data sheet of the GL5528; gamma = log10(R at 10 lx / R at
100 lx)), and the microcontroller reads level = 4092 · divider / (divider + R). Levels are
proportional to the supply, so the supply does not matter.
"""

from __future__ import annotations

import configparser
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe.calibrate.files import CalibrationError
from lightprobe.geometry import Array

SENSORS = 9
FULL_SCALE = 4092
VERSION = 1
#: Of a GL5528, when nobody has calibrated it: 8–20 kΩ at 10 lx, gamma 0.7 ± 0.1.
NOMINAL_R10_OHM, NOMINAL_GAMMA, NOMINAL_SIGMA = 14000.0, 0.7, 1.0
DIVIDER_OHM = 3300.0
#: Limits of the calibration file.
R10_OHM, GAMMA, SIGMA, DIVIDER_LIMITS_OHM = (100, 1e6), (0.3, 1.5), (0, 10), (10, 1e6)


def directions() -> Array:
    """Where the sensors look, (9, 3) in the probe frame: eight around, one up (docs)."""
    azimuth = np.radians(45.0 * np.arange(8))
    around = np.stack([np.cos(azimuth), np.zeros(8), np.sin(azimuth)], axis=-1)
    return np.vstack([around, [0.0, 1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class Ring:
    """Nine LDRs and their resistors."""

    r10_ohm: Array = field(default_factory=lambda: np.full(SENSORS, NOMINAL_R10_OHM))
    gamma: Array = field(default_factory=lambda: np.full(SENSORS, NOMINAL_GAMMA))
    sigma: Array = field(default_factory=lambda: np.full(SENSORS, NOMINAL_SIGMA))  # relative
    divider_ohm: float = DIVIDER_OHM

    def resistance_ohm(self, lux: ArrayLike) -> Array:
        """Resistance (…, 9) of the LDRs at illuminances (…, 9) above 0."""
        return np.asarray(self.r10_ohm * (np.asarray(lux, dtype=np.float64) / 10) ** -self.gamma)

    def level(self, lux: ArrayLike) -> Array:
        """Level (…, 9), 0…4092, not rounded, at illuminances (…, 9); 0 lx gives 0."""
        lux = np.asarray(lux, dtype=np.float64)
        with np.errstate(divide="ignore"):
            return FULL_SCALE * self.divider_ohm / (self.divider_ohm + self.resistance_ohm(lux))

    def lux(self, level: ArrayLike) -> Array:
        """Illuminance (…, 9) of levels (…, 9); NaN where there is none: 0, and full scale."""
        level = np.asarray(level, dtype=np.float64)
        usable = (level > 0) & (level < FULL_SCALE)
        ohm = ldr_ohm(np.where(usable, level, 1), self.divider_ohm)
        return np.where(usable, 10 * (self.r10_ohm / ohm) ** (1 / self.gamma), np.nan)

    def text(self) -> str:
        """As a calibration file."""
        lines = ["[ring]", f"version = {VERSION}", f"divider_ohm = {self.divider_ohm:.6g}"]
        for name in ("r10_ohm", "gamma", "sigma"):
            numbers = ", ".join(f"{value:.6g}" for value in getattr(self, name))
            lines.append(f"{name} = {numbers}")
        return "\n".join(lines) + "\n"


def ldr_ohm(level: ArrayLike, divider_ohm: float = DIVIDER_OHM) -> Array:
    """Resistance of an LDR from its level, above 0 and below full scale."""
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
        raise CalibrationError(f"ring: {path}: version {version}: this program reads {VERSION}")
    ring = Ring(
        r10_ohm=_numbers(path, section, "r10_ohm", SENSORS, R10_OHM),
        gamma=_numbers(path, section, "gamma", SENSORS, GAMMA),
        sigma=_numbers(path, section, "sigma", SENSORS, SIGMA),
        divider_ohm=float(_numbers(path, section, "divider_ohm", 1, DIVIDER_LIMITS_OHM)[0]),
    )
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
            f"ring: {path}: {key} = {text}: want {count} numbers from {low:g} to {high:g}"
        )
    return values
