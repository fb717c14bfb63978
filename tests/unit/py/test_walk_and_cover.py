"""A camera that is carried across a room, and one that somebody covers."""

from pathlib import Path

import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.errors import UsageError
from lightprobe.imaging import camera as lenses
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.room import Room
from lightprobe.sim.world import Behaviour, World

SIZE, SHOT = (256, 128), Shot(1000)
SQUARE = (260, 260)
CAMERAS = Path(__file__).resolve().parents[3] / "packaging/cameras"
WALK = Behaviour(act_s=0, walk_m=1.5, walk_m_s=1.0)


def camera(scene, behaviour, pixel_format="RGBF"):
    return SimulatedCamera(
        World([scene], behaviour), lenses.equirect(), SIZE, rate_hz=10, pixel_format=pixel_format
    )


def floats(simulated, number):
    return np.frombuffer(simulated.frame(number, SHOT), "<f4").reshape(SIZE[1], SIZE[0], 3)


def test_lamps_pass_by_and_near_ones_are_brighter():
    world = World([Room()], WALK)
    there, here = Room().lamps, world.at(1.5).truth().lamps
    angles = [
        float(geometry.angle_deg(a.direction, b.direction))
        for a, b in zip(there, here, strict=True)
    ]
    assert max(angles) > 30
    assert max(angles) > 2 * min(angles)
    place = np.array(world.at(1.5).place_m)
    for bulb, lamp, seen in zip(Room().bulbs, there, here, strict=True):
        far, near = np.linalg.norm(bulb.position_m), np.linalg.norm(bulb.position_m - place)
        ratio = seen.irradiance[1] / lamp.irradiance[1]
        assert ratio == pytest.approx((far / near) ** 2, rel=0.02)


def test_the_walls_stand_still_while_the_probe_walks():
    """A corner of the room is seen where it is; the light that a wall gives does not change."""
    base = Room().seen_from((1.0, 0.0, -1.0)).render(1024, 512).compose(np.ones(4))
    still = Room().render(1024, 512).compose(np.ones(4))
    point = np.array([2.2, -0.5, 0.9])  # of the door

    def seen(radiance, place):
        direction = geometry.normalize(point - place)
        column, row = geometry.equirect_pixel(direction, 1024, 512)
        return radiance[round(float(row)), round(float(column))]

    moved = seen(base, np.array([1.0, 0, -1.0]))
    assert moved == pytest.approx(seen(still, np.zeros(3)), rel=0.03)


def test_pictures_and_truth_walk_together():
    simulated = camera(Room(), WALK)
    for number in (0, 7):
        state = simulated.state(number, SHOT)
        wanted = Room().seen_from(state.place_m).render(*SIZE).compose(np.ones(4))
        assert floats(simulated, number) == pytest.approx(wanted)
    assert not np.array_equal(floats(simulated, 0), floats(simulated, 7))
    codes = camera(Room(), WALK, "GREY")
    assert codes.frame(0, Shot(20000)) != codes.frame(7, Shot(20000))


def test_only_rooms_can_be_walked_in():
    with pytest.raises(UsageError, match="procedural-1: nobody can walk in it"):
        World([Room(), random_scene(1)], WALK)
    with pytest.raises(UsageError, match="outside its walls"):
        Room().seen_from((3.0, 0.0, 0.0))


def test_a_hand_before_lenses_that_do_not_see_all_around():
    """Corners of the picture that no lens fills stay dark, and colours as they are balanced."""
    behaviour = Behaviour(act_s=0, cover_to_s=1)
    lens = lenses.load(str(CAMERAS / "module_ahead.camera"))
    shown = {}
    for pixel_format in ("RGBF", "YUYV"):
        simulated = SimulatedCamera(
            World([Room()], behaviour, 30.0), lens, SQUARE, pixel_format=pixel_format,
            white_balance=(1.0, 1.0, 0.3),
        )  # fmt: skip
        shown[pixel_format] = simulated.frame(0, Shot(3000))
    radiance = np.frombuffer(shown["RGBF"], "<f4").reshape(*SQUARE, 3)
    directions, illumination = lens.look(*SQUARE)
    right = np.nan_to_num(directions[..., 0])
    assert np.isfinite(radiance).all()
    assert radiance[right > 0.11].max() < 0.04 * radiance[right < -0.11].mean()
    assert np.all(radiance[illumination == 0] < 0.04 * radiance.mean())
    blue = np.frombuffer(shown["YUYV"], np.uint8).reshape(*SQUARE, 2)[:, ::2, 1]
    assert blue[(right < -0.11)[:, ::2]].mean() < 122  # of 128: as much as of the others


@pytest.mark.parametrize("turn_deg_s", [0, 50])
def test_half_of_the_view_is_covered_for_a_while(turn_deg_s):
    behaviour = Behaviour(act_s=0, turn_deg_s=turn_deg_s, cover_from_s=0.3, cover_to_s=0.6)
    free = Behaviour(act_s=0, turn_deg_s=turn_deg_s)
    covered, uncovered = camera(Room(), behaviour), camera(Room(), free)
    right = geometry.equirect_directions(*SIZE)[..., 0]
    for number in range(8):
        seen, all_of_it = floats(covered, number), floats(uncovered, number)
        if 3 <= number < 6:
            hidden, open_ = right > 0.11, right < -0.11  # the rim is soft
            assert np.all(seen[hidden] < 0.031 * all_of_it.mean())
            assert np.all(np.ptp(seen[hidden], axis=0) < 1e-5)  # no detail
            assert np.all(seen[hidden] > 0)  # some light passes through a hand
            assert np.array_equal(seen[open_], all_of_it[open_])
        else:
            assert np.array_equal(seen, all_of_it)
    truth = [World([Room()], b).at(0.4).truth().total for b in (behaviour, free)]
    assert np.array_equal(*truth)
    codes = np.frombuffer(camera(Room(), behaviour, "GREY").frame(4, Shot(50000)), np.uint8)
    codes = codes.reshape(SIZE[1], SIZE[0])
    assert codes[right > 0.11].mean() < 0.2 * codes[right < -0.11].mean()
