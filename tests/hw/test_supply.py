"""The servo's switch by ngspice: what it draws, and what it does while nobody drives it."""

import re

import pytest
import supply
from circuit import load
from dimensions import ROOT

ON, STALLED, OFF, PLUGGED = supply.CASES
CORNERS = [0, 1, 2]
CONTINUOUS_W = 1.4  # AO3401A at 25 degrees
WARM_J = 0.1  # it stands for some milliseconds


@pytest.mark.parametrize("corner", CORNERS)
@pytest.mark.parametrize("case", supply.CASES, ids=lambda case: case.what)
def test_the_supply_hardly_notices(case: supply.Case, corner: int) -> None:
    """At most twice what the stalled servo draws; a computer beside it needs 4.75 V."""
    course = supply.run(case, load(), corner)
    assert course.peak_a() < 2 * supply.SUPPLY_V / supply.STALL_OHM
    assert course.lowest_v() > 4.9
    assert course.peak_w() < 2 * CONTINUOUS_W
    assert course.heat_j() < WARM_J


@pytest.mark.parametrize("corner", CORNERS)
def test_on_and_off(corner: int) -> None:
    on, stalled, off = (supply.run(case, load(), corner) for case in (ON, STALLED, OFF))
    assert on.servo_v[-1] > 5
    assert stalled.servo_v[-1] > 4.75
    assert abs(off.servo_v[-1]) < 0.1
    assert off.settled_s() < 0.3


@pytest.mark.parametrize("corner", CORNERS)
def test_the_servo_stays_off_while_the_nano_is_not_there(corner: int) -> None:
    assert supply.run(PLUGGED, load(), corner).servo_v.max() < 0.3


def test_the_servo_is_up_before_the_simulated_one_wakes() -> None:
    """And that one before the firmware moves it (firmware/wheel.c)."""
    world = (ROOT / "firmware/board/host/world.c").read_text()
    firmware = (ROOT / "firmware/wheel.c").read_text()
    wake_ms = float(re.search(r"\.servo_wake_ms = (\d+)", world)[1])
    waits_ms = float(re.search(r"#define WAKE_MS (\d+)", firmware)[1])
    slowest_ms = 1000 * max(supply.run(STALLED, load(), corner).settled_s() for corner in CORNERS)
    assert slowest_ms < wake_ms < waits_ms


def test_a_switch_that_is_hard_is_found() -> None:
    """The check can fail: 1000 uF behind a transistor that opens at once."""
    hard = supply.changed(load(), without=("C3", "C4"), R6="10k", R7="1k", C5="1000u")
    course = supply.run(ON, hard)
    assert course.peak_a() > 10
    assert course.lowest_v() < 4


def test_a_gate_that_nothing_pulls_up_is_found() -> None:
    loose = supply.changed(load(), without=("R6", "C3"))
    assert supply.run(PLUGGED, loose).servo_v.max() > 3
