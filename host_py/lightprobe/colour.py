"""Response of displays and pictures, and the one luminance; linear Rec. 709 primaries, D65."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Weights of linear R, G, B in luminance (Rec. 709).
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def luminance(rgb: ArrayLike) -> NDArray[Any]:
    """Luminance (…) of linear RGB (…, 3)."""
    return np.asarray(np.asarray(rgb) @ LUMINANCE)


def srgb_to_linear(encoded: ArrayLike) -> NDArray[Any]:
    """Linear light of sRGB values, both 0…1 (IEC 61966-2-1)."""
    v = np.asarray(encoded, dtype=np.float64)
    return np.where(v <= 0.04045, v / 12.92, ((np.maximum(v, 0) + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(linear: ArrayLike) -> NDArray[Any]:
    """Give sRGB values of linear light, both 0…1; clips what lies outside."""
    v = np.clip(np.asarray(linear, dtype=np.float64), 0, 1)
    return np.where(v <= 0.0031308, v * 12.92, 1.055 * v ** (1 / 2.4) - 0.055)


def srgb_table() -> NDArray[np.float64]:
    """Linear light of the 256 codes of an 8-bit sRGB picture."""
    return np.asarray(srgb_to_linear(np.arange(256) / 255))
