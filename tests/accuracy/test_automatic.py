"""Automatic exposure: light stays on one scale, and says how certainly."""

import automatic
import pytest


@pytest.fixture(scope="module")
def figures():
    """Of the furnished room."""
    todo = automatic.cases(["room"], ["still", "head", "lamps", "dark", "ignored"])
    return {one.condition: one for case in todo for one in automatic.judged(case)}


@pytest.mark.parametrize("condition", ["head", "ignored"])
def test_turning_leaves_the_scale(figures, condition):
    one = figures[condition]
    assert one.error_median < figures["still"].error_median + 0.02
    assert one.wrong_and_healthy == 0
    assert one.scale.off_worst < 0.02
    assert one.flags["EXPOSURE_UNKNOWN"] == 1


def test_a_lamp_is_not_taken_for_an_exposure(figures):
    one = figures["lamps"]
    assert one.error_median < 0.1  # lamps clip
    assert 0 < one.scale.sigma < 0.2


def test_all_light_at_once_is_doubtful(figures):
    one = figures["dark"]
    assert one.error_median < figures["still"].error_median + 0.02
    assert one.scale.sigma > 0.5
