"""The simulated room: pictures on its walls, and cupboards that hide lamps."""

from dataclasses import replace

import numpy as np
from lightprobe import geometry
from lightprobe.sim.room import Cupboard, Room

SIZE = (512, 256)
BULB = Room().bulbs[0]
#: Before the first lamp, as seen from the middle of the room.
CUPBOARD = Cupboard((-0.8, 0.3, -1.1), (-0.5, 0.7, -0.8))


def seen(room):
    return room.render(*SIZE).compose(np.ones(len(room.bulbs)))


def at(picture, direction):
    column, row = geometry.equirect_pixel(np.array(direction), *SIZE)
    return picture[round(float(row)), round(float(column))]


def test_pictures_are_of_their_number_and_change_walls_alone():
    plain, one, other = (seen(Room(pictures=k)) for k in (0, 1, 2))
    assert np.array_equal(one, seen(Room(pictures=1)))
    changed = (one != plain).any(axis=-1)
    assert 0.1 < changed.mean() < 0.6
    assert (one != other).any()
    assert not changed[:60].any(), "the ceiling has none"
    lamp = geometry.normalize(np.array(BULB.position_m))
    assert np.allclose(at(one, lamp), BULB.radiance, rtol=0.1)


def test_pictures_stay_on_their_wall_as_the_probe_goes():
    """What is seen from two places of one point of a wall is of one colour."""
    places, point = ((0.0, 0.0, 0.0), (0.4, 0.1, -0.3)), np.array([-2.6, -0.6, 1.3])
    room = Room(pictures=3, shows_bulbs=False)
    shades = [at(seen(room.seen_from(place)), point - place) for place in places]
    assert np.allclose(*shades, rtol=0.02)


def test_a_cupboard_hides_a_lamp_and_shows_it_from_beside():
    room = Room(cupboards=(CUPBOARD,))
    for place, hidden in (((0.0, 0.0, 0.0), True), ((-1.2, 0.0, 0.0), False)):
        towards = np.array(BULB.position_m) - place
        there = room.seen_from(place)
        is_lit = at(seen(there), towards).mean() > 0.5 * np.mean(BULB.radiance)
        assert is_lit != hidden
        assert len(there.lamps) == len(Room().lamps)


def test_nobody_is_in_a_cupboard():
    room = Room(cupboards=(CUPBOARD,))
    assert list(room.contains(np.array([[0.0, 0, 0], [-0.6, 0.5, -1.0], [-2.7, 0, 0]]))) == [
        True, False, False,
    ]  # fmt: skip


def test_bulbs_that_are_not_shown_light_the_room_as_before():
    shown, unseen = seen(Room()), seen(replace(Room(), shows_bulbs=False))
    share = (shown != unseen).any(axis=-1).mean()
    assert 0 < share < 0.02
    assert unseen.max() < shown.max() / 5
