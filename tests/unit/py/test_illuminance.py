"""Light on the simulated ring against the truth of the scenes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe.calibrate import ring
from lightprobe.colour import luminance
from lightprobe.errors import UsageError
from lightprobe.sim import faults, scenes
from lightprobe.sim.box import thinned
from lightprobe.sim.illuminance import RingLight
from lightprobe.sim.motion import turned
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.world import Behaviour, State, World


@settings(max_examples=12)
@given(seed=st.integers(0, 100), yaw=st.floats(0, 360), drawn=st.integers(0, 99))
def test_it_is_the_truths_illuminance(seed: int, yaw: float, drawn: int) -> None:
    scene = random_scene(seed)
    world = World([scene])
    powers = np.random.default_rng(drawn).uniform(0, 1, len(scene.lamps))
    lux = RingLight(world, 2.5).lux(State(0, 0, scene, turned(yaw), powers))
    truth = 2.5 * luminance(scene.truth(powers, turned(yaw)).irradiance(ring.directions()))
    assert lux == pytest.approx(truth, rel=0.01, abs=0.003 * truth.max())


def test_of_maps_too() -> None:
    scene = scenes.load(["polished:room"])[0]
    world = World([scene], Behaviour(turn_deg_s=10, switch_s=1), 30.0)
    state = world.at(1.5)
    truth = luminance(state.truth().irradiance(ring.directions()))
    assert RingLight(world, 1).lux(state) == pytest.approx(truth, rel=0.01)


@given(start=st.floats(-20, 200), end=st.floats(-20, 200))
def test_fewer_angles_of_a_steady_motion_keep_its_mean(start: float, end: float) -> None:
    few = thinned(np.linspace(start, end, 9))
    assert 1 <= len(few) <= 9
    assert np.mean(few) == pytest.approx((start + end) / 2, abs=0.02)
    assert len(few) == 1 or np.ptp(few) < abs(end - start)


def test_faults_are_parted_between_camera_and_box() -> None:
    box = {"stuck", "slow"}
    assert faults.split("drop=0.5&stuck=1&slow=0.2", box) == ("drop=0.5", {"stuck": 1, "slow": 0.2})
    with pytest.raises(UsageError, match=r"unknown option broken.*of the box slow, stuck"):
        faults.split("broken=1", box)
    with pytest.raises(UsageError, match="stuck=much: expected a number"):
        faults.split("stuck=much", box)
