"""Every contestant meets every picture, those that run seldom, too."""

import pytest
import timing


@pytest.mark.parametrize("pictures", range(1, 13))
def test_slow_rounds_meet_every_picture(pictures):
    rounds = range(pictures * timing.SELDOM)
    slow = [number % pictures for number in rounds if timing.is_slow_round(number, pictures)]
    assert sorted(slow) == list(range(pictures))
