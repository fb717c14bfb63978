"""Two fisheye modules, 8 ms apart and 3 % different, are as good as one 360° camera."""

import pytest
import several

pytestmark = pytest.mark.many_frames


@pytest.mark.nightly
def test_two_modules_that_turn_are_as_good_as_one_camera():
    todo = several.cases(["room"], ["30"], ["reported"], ["one", "other"])
    one, two = (several.judged(case)[0].figures for case in todo)
    assert two.error_median < one.error_median + 0.005
    assert two.error_p90 < one.error_p90 + 0.005
    assert two.wrong_and_healthy == 0
    assert two.births_per_s < 0.5
    assert two.packets_per_s == pytest.approx(2 * one.packets_per_s, rel=0.05)
