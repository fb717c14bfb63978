"""`lightprobe demo`: which moment a picture is taken of."""

import numpy as np
import pytest
from lightprobe.cli.demo import Choice, report
from lightprobe.estimate import Estimate, EstimateFlag, SphericalHarmonics

FRAME = {"act": 0}


def moment(stated, number=1):
    """A moment whose packet states this error."""
    even = SphericalHarmonics("AMBIENT", 2, np.eye(9, 3))
    return Estimate(number, 2, 3, 4, 500, EstimateFlag(0), (), even, stated, None, 1, None), FRAME


def test_a_picture_waits_for_a_packet_that_knows_its_light():
    choice = Choice(3.0)
    assert choice.offer(10.0, None) is None
    assert choice.offer(11.0, moment(4.7)) is None
    assert choice.offer(13.9, moment(0.6)) is None
    known = moment(0.02)
    assert choice.offer(13.95, known) is known


def test_when_none_comes_the_best_of_the_wait_is_taken():
    choice = Choice(3.0)
    best = moment(0.4)
    assert choice.offer(100.0, moment(4.7)) is None
    assert choice.offer(101.0, best) is None
    assert choice.offer(102.0, moment(2.0)) is None
    assert choice.offer(102.9, None) is None
    assert choice.offer(103.0, None) is best


def test_no_moment_no_picture():
    choice = Choice(3.0)
    assert [choice.offer(t, None) for t in (0.0, 5.0, 500.0)] == [None] * 3


@pytest.mark.parametrize(("stated", "is_said"), [(0.02, False), (4.7, True)])
def test_the_report_says_which_light_was_not_known(capsys, stated, is_said):
    figures = {"relighting_mae": 0.1, "relighting_rmse": 0.1, "stated_error": stated}
    summary = {"estimates": 1, "estimates_per_s": 1.0, "wheel": None, "ring": None}
    report(summary | {"pictures": {"room.png": figures}}, as_json=False)
    assert ("not known well yet: the packet states ± 470 %" in capsys.readouterr().out) == is_said
