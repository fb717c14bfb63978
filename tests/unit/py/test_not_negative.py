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


def test_sh_that_no_light_has_give_light_that_is_close_and_not_without_end():
    """Brighter to one side than all light together: as noise has it, or a move to a place."""
    for share in (0.7, 1.0, 2.0, 10.0):
        coefficients = np.zeros((25, 3))
        coefficients[0] = 1.0
        coefficients[3] = share * np.sqrt(3)
        coefficients[6] = -share
        fitted = not_negative.fit(coefficients)
        basis, solid_angles_sr = not_negative._nodes(4)
        radiance = np.maximum(basis @ fitted, 0)
        mean = radiance.T @ solid_angles_sr / (4 * np.pi) * np.sqrt(4 * np.pi)
        print(f"{share}: mean radiance {mean[0]:.2f} of 1, largest {radiance.max():.1f}")
        assert (mean < 1.6 * max(1, share)).all()
        error = not_negative.irradiance_error(coefficients, fitted)
        assert error < 0.7
