"""Colour temperature of a camera's white balance, as factors of linear Rec. 709 primaries."""

from __future__ import annotations

import numpy as np

from lightprobe.geometry import Array

#: XYZ to linear Rec. 709 (IEC 61966-2-1).
_TO_RGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.204, 1.057]])
NEUTRAL_K = 6500.0

Factors = tuple[float, float, float]


def _black_body_rgb(kelvin: float) -> Array:
    """RGB of a black body's chromaticity: the cubic fits of Kim et al. 2002 (US 7024034)."""
    t = 1e3 / kelvin
    if kelvin < 4000:
        x = -0.2661239 * t**3 - 0.2343589 * t**2 + 0.8776956 * t + 0.179910
        y = -0.9549476 * x**3 - 1.37418593 * x**2 + 2.09137015 * x - 0.16748867
    else:
        x = -3.0258469 * t**3 + 2.1070379 * t**2 + 0.2226347 * t + 0.240390
        y = 3.0817580 * x**3 - 5.87338670 * x**2 + 3.75112997 * x - 0.37001483
    return np.asarray(_TO_RGB @ [x / y, 1, (1 - x - y) / y])


def factors_of(kelvin: float) -> Factors:
    """Give the factors that make a wall in this light white; none at 6500 K. `kelvin` ≥ 2000."""
    ratio = _black_body_rgb(NEUTRAL_K) / np.maximum(_black_body_rgb(kelvin), 0.02)
    return _relative_to_green(ratio)


def automatic(mean_rgb: Array) -> Factors:
    """Factors of a camera that takes the mean of the scene (3,) for grey."""
    return _relative_to_green(1 / np.maximum(mean_rgb, 1e-9))


def _relative_to_green(factors: Array) -> Factors:
    red, green, blue = (float(f) for f in np.clip(factors / factors[1], 0.25, 4))
    return red, green, blue
