"""People and things that move are a change of what they hide alone."""

from dataclasses import replace

import movers
import numpy as np
import pytest
import recording
from judge import Light
from lightprobe.estimate import EstimateFlag
from lightprobe.evaluate.metrics import relighting
from lightprobe.sim.room import Room

pytestmark = pytest.mark.many_frames
SMALL_PX = (960, 480)
#: Of AMBIENT, more than it truly steps.
STEP = 0.01


def check(one: movers.Moving, seconds: float) -> None:
    """What is promised of whatever moves."""
    figures = one.figures
    assert figures.packets > 20 * seconds
    assert figures.births_per_s * seconds <= max(1, 0.2 * seconds)
    assert figures.ambient_step < one.true_step + STEP
    assert figures.error_p90 < 0.03
    assert figures.wrong_and_healthy == 0
    assert figures.relighting.within_3 is not None
    assert figures.relighting.within_3 > 0.95
    assert "COVERED" not in figures.flags
    assert "MOTION" not in figures.flags
    assert one.lamps_off_deg is not None
    assert one.lamps_off_deg < 0.3


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    ("what", "motion"),
    [
        ("walkers", "head"),
        ("near", "still"),
        ("walkers", "still"),
        ("near", "head"),
        ("door", "still"),
        ("leaves", "still"),
        ("screen", "still"),
        ("screen", "head"),
    ],
)
def test_what_moves_is_a_change_of_what_it_hides_alone(what: str, motion: str) -> None:
    """They walk before the room's standing lamp, in dark and in light clothes."""
    case = movers.case(Room(), what, motion, size_px=SMALL_PX, judged_s=4.0)
    for one in movers.judged(case):
        check(one, 4.0)


def test_who_stands_before_a_lamp_and_goes_on_leaves_it_as_it_was() -> None:
    """After five seconds the lamp shines again, and the light is the same."""
    case = movers.case(Room(), "stands", "still", size_px=SMALL_PX, judged_s=8.0)
    for one in movers.judged(case):
        check(one, 8.0)


@pytest.mark.nightly_rows
@pytest.mark.parametrize("albedo", [0.05, 0.7])
def test_a_person_before_a_quarter_of_the_sphere_is_flagged_or_seen(albedo: float) -> None:
    """Dark clothes are taken for a hand, and then the map holds what is behind; never both."""
    case = movers.case(Room(), "quarter", "still", size_px=SMALL_PX, judged_s=4.0)
    moving = replace(case.run.behaviour.movers, walker_albedo=(albedo,))
    run = replace(case.run, behaviour=replace(case.run.behaviour, movers=moving))
    recorded = recording.record(run)
    truth, without = movers.Truth(run, recorded.world), Light.of(recorded.world.scenes[0])
    flagged, seen = [], []
    for packet in recorded.packets["raw"]:
        found = packet.estimate.irradiance(without.normals)
        if packet.estimate.flags & EstimateFlag.COVERED:
            flagged.append(relighting(without.irradiance, found)[0])
        else:
            light = truth.light(packet.captured_s)
            seen.append(relighting(light.irradiance, found)[0])
    assert np.quantile(flagged or [0.0], 0.9) < 0.05
    assert np.quantile(seen, 0.9) < 0.05
    assert len(flagged) > 30 if albedo < 0.1 else not flagged
    assert len(seen) > 30
