"""Ambient light at a place in furnished rooms, the daemon end to end: the bounds.

Needs Mitsuba, and minutes: `make test-renderer`. More rooms: `make furnished`.
"""

import importlib.util

import furnished
import pytest

pytestmark = [
    pytest.mark.long,
    pytest.mark.many_frames,
    pytest.mark.skipif(
        importlib.util.find_spec("mitsuba") is None, reason="make test-renderer installs Mitsuba"
    ),
]  # fmt: skip
#: Median and worst error of the ambient light, of its maximum, by distance (m).
BOUNDS = {"0.5": (0.006, 0.015), "1": (0.010, 0.030)}
#: Above a desk: median error of that of the SH unchanged.
DESK = {"0.5": 1 / 4, "1": 1 / 3}


@pytest.fixture(scope="module", params=furnished.KINDS)
def case(request):
    """One room, an app whose poses are off by 0.1° and 5 mm."""
    (found,) = furnished.judge(furnished.Case(request.param, furnished.SEEDS[0], "place"))
    return found


def test_ambient_light_is_right_at_the_probe(case):
    """Otherwise nothing is right beside it."""
    assert furnished.summary([case])["0"].unchanged < 0.06


def test_a_box_makes_it_better_than_unchanged(case):
    """Of what subscribers get that ask for nothing: large lamps stay in the SH."""
    for distance, figures in furnished.summary([case], "within").items():
        assert figures.has_room > 0.9
        if distance != "0":
            assert figures.moved < 0.7 * figures.unchanged


@pytest.mark.xfail(
    strict=True,
    reason="the light at the probe is off by as much; boxes are, by desks and large lamps",
)
def test_ambient_light_is_right_at_a_place(case):
    for distance, figures in furnished.summary([case]).items():
        if distance == "0":
            continue
        if case.case.kind == "table":
            assert figures.moved <= DESK[distance] * figures.unchanged
        else:
            median, worst = BOUNDS[distance]
            assert figures.moved <= median
            assert figures.moved_worst <= worst
