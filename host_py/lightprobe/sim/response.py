"""Responses that a simulated camera can have: linear light (256, 3) of each code."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lightprobe.colour import srgb_table
from lightprobe.errors import UsageError
from lightprobe.geometry import Array
from lightprobe.imaging.camera import read_table

HELP = "srgb, srgb:POWER, gamma:G[,G,G], log:STOPS, film, or a FILE of 256 rows r g b"
_CODES = np.arange(256) / 255


def parse(text: str) -> Array:
    """Read a response by name; raises UsageError, or CameraError for a bad file.

    srgb:POWER: the light that sRGB says, to this power. gamma: light = code^G. log: equal steps
    of code for equal ratios of light, over so many stops. film: toe and shoulder, another
    gamma for each channel.
    """
    name, _, rest = text.partition(":")
    if text == "srgb":
        return np.repeat(srgb_table()[:, None], 3, 1)
    if name == "srgb":
        powers = _numbers(text, rest, 0.5, 2.0)
        if len(powers) == 1:
            return np.repeat(srgb_table()[:, None] ** powers[0], 3, 1)
    if text == "film":
        return np.stack([_film(gamma) for gamma in (0.55, 0.5, 0.45)], axis=1)
    if name == "gamma":
        gammas = _numbers(text, rest, 0.2, 5.0)
        if len(gammas) in (1, 3):
            return np.asarray(_CODES[:, None] ** np.broadcast_to(gammas, 3))
    if name == "log":
        stops = _numbers(text, rest, 1.0, 12.0)
        if len(stops) == 1:
            curve = (2 ** (stops[0] * _CODES) - 1) / (2 ** stops[0] - 1)
            return np.repeat(curve[:, None], 3, 1)
    if name in ("srgb", "gamma", "log") or not Path(text).exists():
        raise UsageError(f"simulate: --response {text}: expected {HELP}")
    return read_table(Path(text))


def _numbers(text: str, words: str, low: float, high: float) -> list[float]:
    try:
        values = [float(word) for word in words.split(",")]
    except ValueError:
        values = []
    if not values or not all(low <= value <= high for value in values):
        raise UsageError(f"simulate: --response {text}: expected numbers {low:g}…{high:g}")
    return values


def _film(gamma: float) -> Array:
    """Code over light: an S on a scale of light^gamma; turned around here."""
    light = np.linspace(0, 1, 4096)
    code = np.tanh(2.2 * (light**gamma - 0.5))
    code = (code - code[0]) / (code[-1] - code[0])
    return np.asarray(np.interp(_CODES, code, light))
