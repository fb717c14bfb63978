"""Radiance that is nowhere negative, from SH that are."""

import numpy as np
from lightprobe import geometry, not_negative, sh

RNG = np.random.default_rng(11)


def test_light_that_is_somewhere_below_zero_is_mended_without_a_change_of_irradiance():
    """SH of real light: a few bright lamps in the dark, cut off at order 4."""
    worst_before = worst = 0.0
    for _ in range(30):
        directions = geometry.normalize(RNG.normal(size=(3, 3)))
        light = sum(sh.lamp(d, 4, 20.0) * e for d, e in zip(directions, (3, 1, 1), strict=True))
        coefficients = np.repeat(light[:, None], 3, axis=1)
        coefficients[0] += 0.5
        clipped = not_negative.irradiance_error(coefficients, coefficients)
        worst_before = max(worst_before, clipped)
        fitted = not_negative.fit(coefficients)
        worst = max(worst, not_negative.irradiance_error(coefficients, fitted))
    print(
        f"irradiance off at most: set to 0 {100 * worst_before:.1f} %, mended {100 * worst:.2f} %"
    )
    assert worst_before > 0.02
    assert worst < 0.001
