"""The orientation that simulated frames carry, and how it goes wrong."""

import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.imaging import camera as lenses
from lightprobe.sim import orientation
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.faults import Faults
from lightprobe.sim.motion import way_deg
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.world import Behaviour, World

SCENE, SHOT = random_scene(1), Shot(1000)


def camera(turn_deg_s=80.0, nod_deg=0.0, **more):
    world = World([SCENE], Behaviour(act_s=0, turn_deg_s=turn_deg_s, nod_deg=nod_deg, nod_hz=0.4))
    more = {"rate_hz": 10} | more
    return SimulatedCamera(world, lenses.equirect(), (256, 128), **more)


def matrix(simulated, frame, faults=None):
    x, y, z, w, _ = orientation.reading(simulated, frame, SHOT, faults or Faults())
    return geometry.rotation_matrix([w, x, y, z])


def between_deg(a, b):
    return np.degrees(np.arccos(np.clip((np.trace(a.T @ b) - 1) / 2, -1, 1)))


@pytest.mark.parametrize("nod_deg", [0.0, 30.0])
@pytest.mark.parametrize("row_time_us", [0.0, 500.0])
def test_it_turns_what_the_camera_sees_to_where_it_is(row_time_us, nod_deg):
    simulated = camera(row_time_us=row_time_us, nod_deg=nod_deg)
    for frame in range(5):
        state = simulated.state(frame, SHOT)
        seen = SCENE.truth([1, 1], simulated.true_rotation(state)).lamps
        for lamp, there in zip(seen, SCENE.truth([1, 1]).lamps, strict=True):
            turned = matrix(simulated, frame) @ lamp.direction
            assert turned == pytest.approx(there.direction, abs=1e-9)


def test_a_nodding_camera_sees_lamps_where_the_truth_has_them():
    """And looks up while its nod is above 0: a lamp ahead then comes down in the picture."""
    simulated = camera(nod_deg=30.0, pixel_format="RGBF")
    for frame in (2, 6, 9):
        state = simulated.state(frame, SHOT)
        nod_deg = state.angles_deg[1]
        assert abs(nod_deg) > 5
        picture = np.frombuffer(simulated.frame(frame, SHOT), "<f4").reshape(128, 256, 3)
        directions = geometry.equirect_directions(256, 128)
        weight = picture.sum(axis=-1) * geometry.equirect_solid_angles(256, 128)[:, None]
        for lamp in state.truth().lamps:
            near = geometry.angle_deg(directions, lamp.direction) < lamp.radius_deg + 3
            inside = geometry.angle_deg(directions, lamp.direction) < lamp.radius_deg * 0.5 + 1
            assert weight[inside].mean() > 5 * np.median(weight)
            seen = geometry.normalize(np.sum((near * weight)[..., None] * directions, axis=(0, 1)))
            assert geometry.angle_deg(seen, lamp.direction) < 0.7
        ahead = geometry.rotate(state.rotation, [0.0, 0, -1])
        assert ahead[1] == pytest.approx(np.sin(np.radians(nod_deg)))


def test_nodding_smears_a_long_exposure():
    """The light of 90 ms is the mean of twelve moments in them."""
    slow = camera(0.0, nod_deg=40.0, pixel_format="RGBF", rate_hz=1 / 0.09)
    long = picture(slow, 0, 90_000)
    fast = camera(0.0, nod_deg=40.0, pixel_format="RGBF", rate_hz=12 / 0.09)
    moments = np.stack([picture(fast, k, 7_500) for k in range(12)])
    smear = np.abs(moments[5] - moments.mean(axis=0)).mean()
    assert np.abs(long - moments.mean(axis=0)).mean() < 0.3 * smear


def picture(simulated, frame, exposure_us):
    return np.frombuffer(simulated.frame(frame, Shot(exposure_us)), "<f4")


def test_each_row_of_a_nodding_camera_is_of_its_own_time():
    """A rolling shutter: the rows of one picture, one by one, are those of pictures taken then."""
    rolling = camera(0.0, nod_deg=30.0, pixel_format="RGBF", row_time_us=700.0)
    shot = Shot(10.0)
    state = rolling.state(1, shot)
    rows = rolling.world.rows(state, rolling._rows_s, 1e-5)
    of_rows = geometry.turn_after(rows.turned, state.rotation)
    assert way_deg(of_rows) > 1
    first = rolling.world.at(rolling.start_s(1, shot), 1e-5).rotation
    assert of_rows[0] == pytest.approx(first, abs=1e-12)
    whole = camera(0.0, nod_deg=30.0, pixel_format="RGBF")
    whole.state = lambda frame, shot: rolling.world.at(
        rolling.start_s(1, shot), 1e-5
    )  # as the first row
    first, single = (np.frombuffer(c.frame(1, shot), "<f4") for c in (rolling, whole))
    assert (first[: 256 * 3] == single[: 256 * 3]).all()
    assert (first[-256 * 300 :] != single[-256 * 300 :]).any()


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
