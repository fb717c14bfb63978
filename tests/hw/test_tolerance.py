"""The model behind the table of tolerances, against what can be said without it."""

import math

import numpy as np
import pytest
import tolerance
from hypothesis import given
from hypothesis import strategies as st

WHEEL = tolerance.WHEEL_DEG


def test_no_tolerance_no_error() -> None:
    for error in (
        tolerance.common_angle(0),
        tolerance.each_angle(0),
        tolerance.each_gain(0),
        tolerance.tilt(0, 60),
        tolerance.extinction(1e15),
    ):
        assert error.aolp_deg == pytest.approx(0, abs=1e-9)
        assert error.dolp == pytest.approx(0, abs=1e-12)
    assert tolerance.ring_error_deg(0, 0, trials=300) < 1e-4


def test_psi_of_a_pixel_straight_ahead_is_the_wheels_angle() -> None:
    psi = tolerance.psi_rad(tolerance.AHEAD, *tolerance.sheet(WHEEL))
    np.testing.assert_allclose(np.degrees(psi) % 180, WHEEL % 180, atol=1e-9)


@given(st.floats(-5, 5), st.floats(0.05, 1))
def test_an_error_common_to_all_angles_turns_aolp_and_leaves_dolp(
    error_deg: float, dolp: float
) -> None:
    found = tolerance.common_angle(error_deg, dolp)
    assert found.aolp_deg == pytest.approx(abs(error_deg), abs=1e-6)
    assert found.dolp == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("dolp", [0.2, 0.5, 0.9])
def test_errors_of_each_angle_are_those_of_first_order_theory(dolp: float) -> None:
    """dI_k = p sin 2(chi - psi_k) eps_k. For four angles 45 degrees apart S0 = sum I / 2 and
    S1, S2 = sum I cos, sin; averaged over chi: var S0 = var along = p^2 eps^2 / 2 without
    correlation, var across = 3/2 p^2 eps^2."""
    eps = math.radians(0.1)
    found = tolerance.each_angle(0.1, dolp)
    across = math.sqrt(1.5) * dolp * eps
    assert found.aolp_deg == pytest.approx(math.degrees(across / (2 * dolp)), rel=0.02)
    assert found.dolp == pytest.approx(dolp * eps * math.sqrt((1 + dolp**2) / 2), rel=0.02)


def test_extinction_scales_dolp() -> None:
    for ratio in (10, 50, 1000):
        loss = 0.5 * (1 - (ratio - 1) / (ratio + 1))
        assert tolerance.extinction(ratio).dolp == pytest.approx(loss, rel=1e-6)


def test_tilt_grows_off_axis_and_straight_ahead_is_of_second_order() -> None:
    assert tolerance.tilt(1, 0).aolp_deg < 0.02
    assert tolerance.tilt(1, 45).aolp_deg < tolerance.tilt(1, 70).aolp_deg
    assert tolerance.tilt(2, 45).aolp_deg == pytest.approx(
        2 * tolerance.tilt(1, 45).aolp_deg, rel=0.1
    )


def test_ring_errors_grow_with_their_causes() -> None:
    assert tolerance.ring_error_deg(1, 0, 300) < tolerance.ring_error_deg(2, 0, 300)
    assert tolerance.ring_error_deg(0, 0.03, 300) < tolerance.ring_error_deg(0, 0.25, 300)


def test_two_lenses_leave_no_gap(dim: dict[str, float]) -> None:
    """What the film's opening hides from the front lens the rear lens sees past the plate."""
    angles = [
        float(cell)
        for cell in tolerance.view_table(dim).split("|")
        if cell.strip().replace(".", "").isdigit()
    ]
    front, _, rear, _ = angles
    assert front + rear > 180
