"""The orientation that simulated frames carry, and how it goes wrong."""

import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.imaging import camera as lenses
from lightprobe.sim import orientation
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.faults import Faults
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.world import Behaviour, World

SCENE, SHOT = random_scene(1), Shot(1000)


def camera(turn_deg_s=80.0, **more):
    world = World([SCENE], Behaviour(act_s=0, turn_deg_s=turn_deg_s))
    return SimulatedCamera(world, lenses.equirect(), (256, 128), rate_hz=10, **more)


def matrix(simulated, frame, faults=None):
    x, y, z, w, _ = orientation.reading(simulated, frame, SHOT, faults or Faults())
    return geometry.rotation_matrix([w, x, y, z])


def between_deg(a, b):
    return np.degrees(np.arccos(np.clip((np.trace(a.T @ b) - 1) / 2, -1, 1)))


@pytest.mark.parametrize("row_time_us", [0.0, 500.0])
def test_it_turns_what_the_camera_sees_to_where_it_is(row_time_us):
    simulated = camera(row_time_us=row_time_us)
    for frame in range(5):
        state = simulated.state(frame, SHOT)
        seen = SCENE.truth([1, 1], simulated.true_yaw_deg(state)).lamps
        for lamp, there in zip(seen, SCENE.truth([1, 1]).lamps, strict=True):
            turned = matrix(simulated, frame) @ lamp.direction
            assert turned == pytest.approx(there.direction, abs=1e-9)


def test_a_still_camera_says_the_same_to_the_bit():
    simulated = camera(0)
    assert len({orientation.reading(simulated, frame, SHOT, Faults()) for frame in range(9)}) == 1


def test_noise_is_what_it_states():
    faults = Faults(orientation_noise_deg=0.5)
    simulated = camera()
    errors = [
        between_deg(matrix(simulated, frame), matrix(simulated, frame, faults))
        for frame in range(400)
    ]
    assert np.sqrt(np.mean(np.square(errors)) / 3) == pytest.approx(0.5, rel=0.1)
    assert orientation.reading(simulated, 0, SHOT, faults)[4] == 0.5
    assert 0 < orientation.reading(simulated, 0, SHOT, Faults())[4] <= 0.01


@pytest.mark.parametrize("late_ms", [200, -300])
def test_late_readings_are_of_another_time(late_ms):
    late = matrix(camera(), 5, Faults(orientation_late_ms=late_ms))
    assert between_deg(late, matrix(camera(), 5 - late_ms // 100)) < 1.5  # whole pixels


def test_jumps_stay_and_add_up():
    faults = Faults(orientation_jump_s=0.5, orientation_jump_deg=10)
    off_deg = [
        between_deg(matrix(camera(), frame), matrix(camera(), frame, faults)) for frame in range(12)
    ]
    assert off_deg[:5] == pytest.approx([0] * 5, abs=1e-6)
    assert off_deg[5:10] == pytest.approx([10] * 5)
    assert off_deg[10] != pytest.approx(10, abs=0.1)


def test_some_readings_are_missing():
    simulated = camera()
    known = [
        np.isfinite(orientation.reading(simulated, frame, SHOT, Faults(orientation_drop=0.3))[0])
        for frame in range(300)
    ]
    assert np.mean(known) == pytest.approx(0.7, abs=0.1)
    assert np.all(np.isnan(orientation.reading(simulated, 0, SHOT, Faults(hide_orientation=1))))
