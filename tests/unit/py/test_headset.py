"""The simulated headset: its poses are those of the world, through the mount."""

import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.sim.headset import Headset
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.world import Behaviour, World

MOUNT = (0.18, -0.31, 0.05, np.sqrt(1 - 0.18**2 - 0.31**2 - 0.05**2))
WORLD = World([random_scene(1)], Behaviour(act_s=0, swing_deg=40, nod_deg=20))


def matrix(pose):
    x, y, z, w = pose
    return geometry.rotation_matrix([w, x, y, z])


def test_poses_turn_what_the_probe_sees_to_where_it_stays():
    """A lamp, as the probe sees it, through mount and pose, is always at the same place."""
    headset = Headset(MOUNT, noise_deg=0)
    places = []
    for number in range(0, 300, 37):
        t_s, pose = headset.pose(WORLD, number)
        seen = WORLD.at(t_s).truth().lamps[0].direction
        places.append(matrix(pose) @ matrix(MOUNT) @ seen)
    assert np.allclose(places, places[0], atol=1e-9)


def test_noise_delay_clock_and_jumps():
    plain = Headset(MOUNT, noise_deg=0)
    noisy = Headset(MOUNT, noise_deg=0.5)
    turns = [
        matrix(plain.pose(WORLD, k)[1]).T @ matrix(noisy.pose(WORLD, k)[1]) for k in range(300)
    ]
    angles_deg = [np.degrees(np.arccos(np.clip((np.trace(t) - 1) / 2, -1, 1))) for t in turns]
    assert np.sqrt(np.mean(np.square(angles_deg)) / 3) == pytest.approx(0.5, rel=0.1)
    late = Headset(MOUNT, noise_deg=0, late_ms=30, ahead_s=100)
    assert late.pose(WORLD, 72)[0] == pytest.approx(101.03)
    assert (late.pose(WORLD, 72)[1] == plain.pose(WORLD, 72)[1]).all()
    jumpy = Headset(MOUNT, noise_deg=0, jump_deg=15, jump_s=2)
    for number, jumped_deg in ((100, 0), (200, 15), (300, 30)):
        turn = matrix(jumpy.pose(WORLD, number)[1]) @ matrix(plain.pose(WORLD, number)[1]).T
        assert geometry.angle_deg(turn @ [0, 0, 1], [0, 0, 1]) == pytest.approx(jumped_deg)
