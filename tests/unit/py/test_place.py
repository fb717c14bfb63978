"""Light beside the probe: as the same bulbs are from there, and golden for all clients."""

import json
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe import geometry, sh
from lightprobe.colour import luminance
from lightprobe.estimate import (
    Estimate,
    EstimateFlag,
    Light,
    LightFlag,
    Room,
    SphericalHarmonics,
)
from lightprobe.place import EMISSION_CHANGE_PER_RAD, light_at
from lightprobe.reflection_map import ReflectionMap, _between, directions
from lightprobe.sim.room import Bulb
from place_vectors import EXPECTED, light_of, vectors

offsets = st.tuples(*[st.floats(-1, 1)] * 3)


def seen(bulb, **changes):
    """Give a bulb as a packet lists it, its distance known."""
    lamp = bulb.lamp()
    distance_m = float(np.linalg.norm(bulb.position_m))
    light = Light(1, lamp.direction, lamp.irradiance, lamp.radius_deg, distance_m=distance_m)
    return replace(light, **changes)


def estimate(*lights, sigma=0.01, kind="AMBIENT"):
    sh = SphericalHarmonics(kind, 1, np.array([[1.0] * 3] + [[0.0] * 3] * 3))
    return Estimate(1, 1, 0, 0, 1000, EstimateFlag(0), lights, sh, None, None, 1, None,
                    relighting_sigma=sigma)  # fmt: skip


@given(offsets)
def test_a_bulb_is_as_seen_from_there(offset_m):
    bulb = Bulb((1.1, 0.9, -2.4), 0.08, (30.0, 20.0, 10.0))
    there = seen(bulb.seen_from(offset_m))
    moved = light_at(seen(bulb), offset_m)
    assert geometry.angle_deg(moved.direction, there.direction) < 1e-6
    assert moved.distance_m == pytest.approx(there.distance_m)
    assert moved.angular_radius_deg == pytest.approx(there.angular_radius_deg)
    assert moved.irradiance == pytest.approx(there.irradiance, rel=0.01)


@given(offsets, offsets)
def test_two_steps_are_one(first_m, second_m):
    light = seen(Bulb((1.1, 1.9, -2.4), 0.08, (30.0, 20.0, 10.0)))
    twice = light_at(light_at(light, first_m), second_m)
    once = light_at(light, np.add(first_m, second_m))
    assert twice.direction == pytest.approx(once.direction, abs=1e-9)
    assert twice.irradiance == pytest.approx(once.irradiance)


@pytest.mark.parametrize("offset_m", [(0.3, 0, 0), (0.5, -0.3, 0.2), (-1.0, 0.2, 0.0)])
def test_sigmas_hold_what_an_uncertain_distance_moves(offset_m):
    rng = np.random.default_rng(3)
    bulb = Bulb((0.6, 0.9, -1.4), 0.05, (30.0, 20.0, 10.0))
    true = light_at(seen(bulb), offset_m)
    stated = light_at(
        seen(bulb, distance_sigma=0.1, direction_sigma_deg=0.0, irradiance_sigma=np.zeros(3)),
        offset_m,
    )
    tried = [
        light_at(seen(bulb, distance_m=seen(bulb).distance_m * f), offset_m)
        for f in 1 + 0.1 * rng.normal(size=4000)
    ]
    turned = np.array([geometry.angle_deg(one.direction, true.direction) for one in tried])
    lit = np.array([one.irradiance[0] / true.irradiance[0] for one in tried])
    assert np.median(turned) * 1.48 / np.sqrt(2) == pytest.approx(
        stated.direction_sigma_deg, rel=0.25
    )
    spread = (np.percentile(lit, 84) - np.percentile(lit, 16)) / 2
    aside = np.radians(geometry.angle_deg(true.direction, seen(bulb).direction))
    both = np.hypot(spread, EMISSION_CHANGE_PER_RAD * aside)
    assert both == pytest.approx(stated.irradiance_sigma[0] / true.irradiance[0], rel=0.1)


@pytest.mark.parametrize("beside_m", [0.3, 0.5, 1.0])
def test_a_flat_panel_shines_within_the_sigma(beside_m):
    """Under a ceiling: as strong to each side as the cosine of its angle (Lambert)."""
    off = []
    for turn in np.arange(8) * np.pi / 4:
        panel_m = np.array([0.9, 1.2, 0.0])
        place_m = beside_m * np.array([np.cos(turn), 0.1, np.sin(turn)])
        light = seen(Bulb(tuple(panel_m), 0.05, (30.0, 20.0, 10.0)), distance_sigma=0.01,
                     irradiance_sigma=np.full(3, 1e-3))  # fmt: skip
        stated = light_at(light, place_m)
        down = [v[1] / np.linalg.norm(v) for v in (panel_m, panel_m - place_m)]
        true = stated.irradiance[0] * down[1] / down[0]
        off.append(abs(stated.irradiance[0] - true) / stated.irradiance_sigma[0])
    assert max(off) < 3
    assert 0.2 < np.sqrt(np.mean(np.square(off))) < 1.5


def test_what_is_not_known_says_so():
    light = seen(Bulb((0, 3, 0), 0.1, (9.0, 9, 9)), distance_m=None,
                 direction_sigma_deg=0.1, irradiance_sigma=np.full(3, 0.01))  # fmt: skip
    moved = light_at(light, (0.5, 0, 0))
    assert (moved.direction_sigma_deg, moved.irradiance_sigma) == (None, None)
    assert moved.direction == pytest.approx(light.direction)
    assert estimate(light).at((0.5, 0, 0)).relighting_sigma is None
    far = light_at(replace(light, nearest_m=30.0), (0.5, 0, 0))
    assert far.direction_sigma_deg == pytest.approx(np.hypot(0.1, np.degrees(0.5 / 90)))
    assert estimate(replace(light, nearest_m=30.0)).at((0.5, 0, 0)).relighting_sigma > 0.05


def test_within_a_lamp_the_light_is_that_of_its_surface():
    light = seen(Bulb((0, 0.3, 0), 0.1, (9.0, 9, 9)))
    for offset_m in ((0, 0.3, 0), (0, 0.25, 0), (0.0, 0.3, 1e-9)):
        moved = light_at(light, offset_m)
        assert np.isfinite(moved.direction).all()
        assert moved.angular_radius_deg == pytest.approx(90)
        assert moved.irradiance == pytest.approx(9 * light.irradiance, rel=1e-6)


def test_lights_are_sorted_anew_and_their_shadows_too():
    near = seen(Bulb((0.5, 0.5, 0), 0.02, (50.0, 50, 50)), id=1, shadow_strength=0.1)
    bright = seen(Bulb((0, 3, 0), 0.3, (40.0, 40, 40)), id=2, shadow_strength=0.5)
    here = estimate(bright, near)
    there = here.at((0.45, 0.4, 0))
    assert [light.id for light in there.lights] == [1, 2]
    up = luminance(there.irradiance([0, 1, 0]))
    for light in there.lights:
        share = light.direction[1] * luminance(light.irradiance) / up
        assert light.shadow_strength == pytest.approx(share)


def test_an_area_light_keeps_its_shape():
    light = replace(
        seen(Bulb((0, 2, 0), 0.5, (4.0, 4, 4))), flags=LightFlag.EXTENDED,
        half_angle_deg=(20.0, 10.0), axis=np.array([1.0, 0, 0]),
    )  # fmt: skip
    moved = light_at(light, (0.5, 1.0, 0))
    assert abs(float(moved.axis @ moved.direction)) < 1e-9
    assert moved.half_angle_deg[0] > 30 > 20 > moved.half_angle_deg[1] > 10


@pytest.mark.parametrize("place", [(1, 2), (np.nan, 0, 0), (0, np.inf, 0)])
def test_what_is_no_place_is_refused(place):
    with pytest.raises(ValueError, match="x, y, z in metres"):
        estimate().at(place)


def test_a_total_cannot_be_moved():
    with pytest.raises(ValueError, match="subscribe to AMBIENT"):
        estimate(kind="TOTAL").at((1, 0, 0))


def test_at_the_probe_nothing_changes():
    here = estimate(seen(Bulb((0, 2, 0), 0.5, (4.0, 4, 4))))
    assert here.at((0, 0, 0)) is here


WALLS_M = np.array([2.0, 2.5, 1.2, 1.5, 3.0, 1.0])
TILT = (0.48, 0.0, 0.64, 0.6)


def paint(offset_m, rays):
    """Give the radiance (…, 3) that a place within a tilted box of painted walls sees."""
    box = geometry.inverse((TILT[3], *TILT[:3]))
    there = geometry.rotate(box, offset_m)
    rays = geometry.rotate(box, rays)
    walls_m = np.where(rays > 0, WALLS_M[1::2], -WALLS_M[::2])
    hit = there + np.min((walls_m - there) / rays, axis=-1, keepdims=True) * rays
    shades = np.stack(
        [1 + 0.5 * np.sin(hit @ k) for k in ((1, 0, 1), (0, 1.5, 0.5), (0.5, 1, 0))], axis=-1
    )
    return shades + 2 * (hit[..., 1:2] > WALLS_M[3] - 1e-9)  # a bright ceiling


BOX = Room(WALLS_M, np.full(6, 0.1), np.array(TILT), 0.02)


def painted(offset_m, order=4, size=64):
    """Give the light within that box, as a probe at a place sees it."""
    columns, rows = np.arange(2 * size)[None, :], np.arange(size)[:, None]
    image = paint(offset_m, geometry.equirect_direction(columns, rows, 2 * size, size))
    light = SphericalHarmonics("AMBIENT", order, sh.project(image, order))
    return replace(estimate(), sh=light, room=BOX)


@pytest.mark.parametrize(("order", "share"), [(4, 0.25), (2, 0.5)])
@pytest.mark.parametrize("offset_m", [(0.5, 0, 0), (0.2, -0.4, 0.3), (-0.6, 0.1, 0.6)])
def test_ambient_light_is_as_seen_from_there(offset_m, order, share):
    normals = np.random.default_rng(1).normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    here = painted((0, 0, 0), order)
    true = luminance(painted(offset_m).irradiance(normals))

    def error(light):
        return np.median(np.abs(luminance(light.irradiance(normals)) - true))

    assert error(here.at(offset_m)) < share * error(here)


def test_the_room_goes_with_the_place():
    here = painted((0, 0, 0))
    assert here.at((0, 0, 0)) is here
    near = here.at((0.2, -0.4, 0.3))
    assert near.room.size_m == pytest.approx(here.room.size_m)
    back = near.room.walls_m[::2] - here.room.walls_m[::2]
    assert geometry.rotate((TILT[3], *TILT[:3]), back) == pytest.approx([0.2, -0.4, 0.3])
    outside = here.at((40.0, 9.0, -3.0))
    assert np.isfinite(outside.sh.coefficients).all()
    assert (outside.room.walls_m > 0.049).all()
    assert replace(here, room=None).at((0.2, 0, 0)).sh is here.sh


def test_a_known_room_says_how_well_the_ambient_light_is_known():
    here = painted((0, 0, 0))
    assert here.at((0, 0, 2)).relighting_sigma == pytest.approx(np.hypot(0.01, 0.04))
    unknown = replace(here, room=None).at((0, 0, 2))
    assert unknown.relighting_sigma == pytest.approx(np.hypot(0.01, 0.2))


def mirrored(offset_m, size=32, turn=(1.0, 0.0, 0.0, 0.0)):
    """Give the reflection map at a place of that box, of a probe turned by w, x, y, z."""
    looks = geometry.rotate(turn, directions(size))
    orientation = np.array([*turn[1:], turn[0]])
    radiance = np.float32(paint(offset_m, looks))
    return ReflectionMap(1, 1, 0, 1, "AMBIENT", radiance, orientation)


def off(found, wanted):
    """Give the mean difference of two maps over the mean radiance."""
    return np.abs(found.radiance - wanted.radiance).mean() / wanted.radiance.mean()


@pytest.mark.parametrize("size", [16, 32, 64])
@pytest.mark.parametrize(
    "offset_m", [(0.5, 0, 0), (0.2, -0.4, 0.3), (-0.6, 0.1, 0.6), (0.3, -0.8, 0.5)]
)
def test_a_mirror_shows_the_room_from_where_it_stands(offset_m, size):
    here, true = mirrored((0, 0, 0), size), mirrored(offset_m, size)
    there = here.at(BOX, offset_m, "PROBE")
    share = off(there, true) / off(here, true)
    print(f"{np.linalg.norm(offset_m):.1f} m, {size}: {off(here, true):.3f}, {share:.3f} of it")
    assert share < 0.2
    assert (there.sequence, there.kind, there.radiance.dtype) == (1, "AMBIENT", np.float32)


def test_a_map_of_a_turned_probe_is_moved_in_the_world():
    turn = geometry.normalize(np.array([0.5, 0.4, -0.7, 0.3]))
    offset_m = (0.2, -0.4, 0.3)
    here, true = mirrored((0, 0, 0), turn=turn), mirrored(offset_m, turn=turn)
    assert off(here.at(BOX, offset_m, "WORLD"), true) < 0.2 * off(here, true)
    # The same room and place in the axes of the probe give the same map.
    back = geometry.inverse(turn)
    axes = geometry.turn_after(back, (TILT[3], *TILT[:3]))
    room = replace(BOX, orientation=np.array([*axes[1:], axes[0]]))
    inside = here.at(room, geometry.rotate(back, offset_m), "PROBE")
    assert inside.radiance == pytest.approx(here.at(BOX, offset_m, "WORLD").radiance, abs=1e-5)


def test_where_a_map_cannot_be_moved():
    here = mirrored((0, 0, 0), 16)
    assert here.at(BOX, (0, 0, 0), "PROBE") is here
    assert np.isfinite(here.at(BOX, (40.0, 9.0, -3.0), "PROBE").radiance).all()
    with pytest.raises(ValueError, match="x, y, z in metres"):
        here.at(BOX, (np.nan, 0, 0), "PROBE")
    with pytest.raises(ValueError, match="orientation in the WORLD"):
        replace(here, orientation=None).at(BOX, (0.5, 0, 0), "WORLD")


def test_a_map_has_no_seams():
    """Where nothing moves, each texel is found again; between texels nothing jumps."""
    here, far = mirrored((0, 0, 0), 16), replace(BOX, walls_m=np.full(6, 1e6))
    still = here.at(far, (0.5, 0, 0), "PROBE")
    assert still.radiance == pytest.approx(here.radiance, rel=1e-3)
    edge = np.array([[1, 1, k] for k in np.linspace(-1, 1, 401)])
    for axis, signs in product(range(3), product((1, -1), repeat=3)):
        line, beside = signs * np.roll(edge, axis + 1, axis=1), 1e-9 * np.eye(3)[(axis + 1) % 3]
        one, other = (_between(here.radiance, line + way * beside) for way in (1, -1))
        assert one == pytest.approx(other, abs=1e-6)


def test_the_golden_vectors_are_as_ever():
    assert json.loads(EXPECTED.read_text()) == json.loads(json.dumps(vectors()))


def test_golden_lamps_are_read_as_written():
    for vector in json.loads(EXPECTED.read_text())["lamps"]:
        assert light_of(vector["light"]).distance_m == vector["light"]["distance_m"]
