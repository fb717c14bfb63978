"""The room of `lightprobe.testing`, without a daemon: what it shows and what it refuses."""

import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.calibrate import ring
from lightprobe.colour import luminance
from lightprobe.errors import UsageError
from lightprobe.geometry import equirect_directions, equirect_solid_angles
from lightprobe.sim.textured import TexturedScene, pattern
from lightprobe.sim.world import Behaviour
from lightprobe.testing import CD_M2_PER_UNIT, Room


def test_a_lamp_casts_the_irradiance_that_was_asked_for() -> None:
    room = Room(ambient=0)
    lamp = room.lamp(40, 30, irradiance=100, colour=(2, 1, 0.5))
    (true,) = room.truth().lamps
    assert luminance(true.irradiance) == pytest.approx(100)
    assert true.irradiance / true.irradiance[1] == pytest.approx([2, 1, 0.5])
    assert geometry.angles_from_direction(true.direction) == pytest.approx((40, 30))
    facing = room.truth().irradiance([lamp.direction])[0]
    assert luminance(facing) == pytest.approx(100, rel=0.01)


def test_each_change_begins_an_act_and_shows_at_once() -> None:
    room = Room()
    acts = [room.world.at(0.0).act]
    lamp = room.lamp(40, 30)
    for change in (lambda: lamp.move(0, 0), lambda: lamp.switch(False), lambda: lamp.dim(3)):
        acts.append(room.world.at(0.0).act)
        change()
    assert acts == sorted(set(acts))
    assert room.world.at(5.0).scene.lamps == ()
    lamp.switch(True)
    assert len(room.world.at(5.0).scene.lamps) == 1
    lamp.remove()
    assert room.lamps == []


def test_the_ring_is_lit_as_the_truth_says_and_turns_with_the_probe() -> None:
    room = Room(ambient=30, behaviour=Behaviour(act_s=0, turn_deg_s=90))
    room.lamp(0, 0, irradiance=200)
    now, later = room.world.at(0.0), room.world.at(2.0)
    normals = ring.directions()
    true = luminance(room.truth().irradiance(normals))
    assert room.lux(now) == pytest.approx(CD_M2_PER_UNIT * true)
    opposite = luminance(room.truth().irradiance(geometry.rotate(later.rotation, normals)))
    assert room.lux(later) == pytest.approx(CD_M2_PER_UNIT * opposite)
    assert np.abs(room.lux(later) - room.lux(now)).max() > 500


def test_a_lens_cap_leaves_the_ring_its_light() -> None:
    room = Room()
    before = room.lux(room.world.at(0.0)).copy()
    room.cover_lens()
    assert room.world.at(0.0).movers
    assert room.lux(room.world.at(0.0)) == pytest.approx(before)
    room.cover_lens(False)
    assert not room.world.at(0.0).movers


def test_the_walls_mean_is_what_was_asked_for() -> None:
    seen = pattern(equirect_directions(256, 128))
    assert seen.min() >= 0.6
    assert seen.max() <= 1.4
    mean = float((seen * equirect_solid_angles(256, 128)[:, None]).sum() / (4 * np.pi))
    assert mean == pytest.approx(1, abs=0.05)
    scene = TexturedScene("room", np.array([30.0, 20.0, 10.0]), ())
    assert scene.render(64, 32).base == pytest.approx(
        pattern(equirect_directions(64, 32))[..., None] * [30.0, 20.0, 10.0], rel=1e-6
    )
    assert scene.scaled(2).ambient == pytest.approx([60, 40, 20])


@pytest.mark.parametrize(
    "numbers",
    [(0, 91), (float("nan"), 0), (0, 0, -1), (0, 0, 1, 0), (0, 0, 1, 60), (0, 0, float("inf"))],
)
def test_lamps_that_cannot_be_are_refused_and_leave_the_room_as_it_is(numbers) -> None:
    room = Room()
    with pytest.raises(UsageError, match="room: lamp at"):
        room.lamp(*numbers)
    assert room.lamps == []
    lamp = room.lamp(40, 30)
    with pytest.raises(UsageError, match="room: lamp at"):
        lamp.move(0, 95)
    assert (lamp.azimuth_deg, lamp.elevation_deg) == (40, 30)


def test_light_that_cannot_be_is_refused() -> None:
    room = Room()
    with pytest.raises(UsageError, match="room: ambient -1"):
        room.ambient(-1)
    with pytest.raises(UsageError, match="room: colour"):
        room.lamp(0, 0, colour=(0, 0, 0))
    with pytest.raises(UsageError, match="room: colour"):
        room.ambient(1, (1, 1))
