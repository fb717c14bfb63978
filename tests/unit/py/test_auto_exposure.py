"""Automatic exposure of the simulated camera."""

import numpy as np
import pytest
from lightprobe.imaging import camera as lenses
from lightprobe.sim.auto_exposure import AutoExposure
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.exposure import ExposureLimits
from lightprobe.sim.room import Room
from lightprobe.sim.scene import ProceduralScene
from lightprobe.sim.world import Behaviour, World

RATE_HZ = 30.0


def products(world, frames, limits=None):
    """Exposure times gain of so many frames, in microseconds."""
    camera = SimulatedCamera(
        world, lenses.equirect(), (64, 32), rate_hz=RATE_HZ, limits=limits,
    )  # fmt: skip
    loop = AutoExposure(camera)
    return np.array([shot.exposure_us * shot.gain for shot in map(loop.shot, range(frames))])


@pytest.fixture
def bright():
    return World([Room()], Behaviour(act_s=0), 30).scenes[0]


def test_it_rests_where_the_light_rests(bright):
    us = products(World([bright], Behaviour(act_s=0)), 90)
    assert len(set(us[45:])) == 1


def test_it_follows_the_light_late_and_in_steps(bright):
    us = products(World([bright, bright.scaled(4)], Behaviour(act_s=2)), 120)
    before, change = us[59], 60
    assert np.all(us[change : change + 2] == before)  # nobody has metered the new light yet
    steps = np.abs(np.diff(np.log2(us[change + 1 :])))
    assert 0.2 < steps[0] <= 0.55  # half a stop, and what exposures are rounded to
    assert us[-1] == pytest.approx(before / 4, rel=0.15)


def test_turning_changes_it():
    """Half of the weight looks ahead."""
    uneven = ProceduralScene("uneven", np.array([[4.0], [0], [2], [0]]) * np.ones(3), ())
    us = products(World([uneven], Behaviour(act_s=0, turn_deg_s=60), 30), 240)
    assert us[60:].max() > 1.1 * us[60:].min()


def test_gain_where_time_does_not_suffice(bright):
    dark = World([bright.scaled(0.02)], Behaviour(act_s=0))
    camera = SimulatedCamera(dark, lenses.equirect(), (64, 32), rate_hz=RATE_HZ)
    loop = AutoExposure(camera)
    shot = [loop.shot(frame) for frame in range(60)][-1]
    assert shot.exposure_us == camera.limits.most_us
    assert 1 < shot.gain <= 8


def test_limits_hold(bright):
    limits = ExposureLimits(1000, 2000)
    us = products(World([bright.scaled(100)], Behaviour(act_s=0)), 30, limits)
    assert us.min() == 1000
