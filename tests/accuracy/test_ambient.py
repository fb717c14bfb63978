"""How ambient light at a place is judged: against exact light, with lamps listed and not."""

from dataclasses import replace

import ambient
import furnished
import furnished_rooms
import moving
import numpy as np
import places
import pytest
from judge import Packet
from lightprobe import geometry
from lightprobe.errors import UsageError
from lightprobe.estimate import Light
from lightprobe.sim.room import Room

HERE, THERE = np.zeros(3), np.array([0.5, 0.0, 0.2])
#: Order 2 leaves so much of the irradiance out.
LEFT_OUT = 0.012


def packet(estimate):
    return Packet(estimate, geometry.UNTURNED)


def test_exact_light_is_right_where_the_probe_is_and_wrong_beside_it():
    exact = packet(places.estimate(Room()))
    here, there = (ambient.judge(exact, HERE, moving.lit(Room(), at), 0) for at in (HERE, THERE))
    assert here.unchanged == here.moved < LEFT_OUT
    assert there.unchanged > 2 * here.unchanged
    assert not here.has_room


def test_a_lamp_that_is_not_listed_is_ambient_light():
    exact = places.estimate(Room())
    first, *others = exact.lights
    shape = places.sh.lamp(first.direction, exact.sh.order)
    coefficients = exact.sh.coefficients + shape[:, None] * first.irradiance
    fewer = replace(
        exact, lights=tuple(others), sh=replace(exact.sh, coefficients=coefficients)
    )  # fmt: skip
    lit = moving.lit(Room(), HERE)
    assert ambient.judge(packet(fewer), HERE, lit, 0).unchanged < 3 * LEFT_OUT
    dark = replace(fewer, sh=exact.sh)
    assert ambient.judge(packet(dark), HERE, lit, 0).unchanged > 5 * LEFT_OUT


def test_a_light_that_is_no_lamp_is_ambient_light():
    exact = places.estimate(Room())
    down = np.array([0.0, -1.0, 0.0])
    spot = Light(99, down, np.full(3, 0.2), 2.0)
    shape = places.sh.lamp(down, exact.sh.order)
    coefficients = exact.sh.coefficients - shape[:, None] * spot.irradiance
    listed = replace(
        exact, lights=(*exact.lights, spot), sh=replace(exact.sh, coefficients=coefficients)
    )  # fmt: skip
    lit = moving.lit(Room(), HERE)
    assert ambient.judge(packet(listed), HERE, lit, 0).unchanged < 2 * LEFT_OUT


def test_sigmas_are_counted_where_they_are_stated():
    some = [ambient.Ambient(0.5, 0.1, 0.1, ratio, True) for ratio in (None, 0.5, 2.0, 4.0)]
    figures = ambient.Ambients.of(some)
    assert figures.stated == 0.75
    assert (figures.within_1, figures.within_3) == pytest.approx((1 / 3, 2 / 3))


def furnished_room():
    nodes = np.arange(furnished_rooms.NODES)[:, None, None, None] * np.ones((1, 8, 16, 3))
    return furnished.FurnishedRoom("some", nodes.astype(np.float16))


def test_between_two_places_a_rendered_room_is_a_mixture_of_both():
    shares = furnished_rooms.node_shares()
    at = furnished_rooms.way_m((shares[10] + shares[11]) / 2)
    seen = furnished_room().seen_from(tuple(at.tolist())).render(16, 8).base
    assert np.allclose(seen, 10.5, atol=0.1)
    with pytest.raises(UsageError, match="beside its way"):
        furnished_room().seen_from((0.5, 0.5, 0.5))


def test_the_middle_of_the_way_is_where_places_are_measured_from():
    path = furnished.head_path()
    assert np.linalg.norm(path.place_m(furnished._JUDGED_AT_S)) < 1e-3
    furthest = np.abs(path.places_m).max(axis=0)
    assert np.allclose(furthest[[0, 2]], 0.25, atol=0.01)


def test_what_shines_in_a_render_is_told_apart():
    rays = geometry.equirect_directions(128, 64)
    centres = np.array([[0.0, 1.2, -1.5], [1.5, 1.2, 0.0]])
    unlit, lit = np.ones((64, 128, 3)), np.ones((64, 128, 3))
    for centre, radiance in zip(centres, (50.0, 20.0), strict=True):
        lit[geometry.angle_deg(rays, centre) < 6] = radiance
    renders = furnished_rooms.Renders(
        np.zeros((2, 8, 16, 3), np.float16), np.zeros((1, 3)), unlit[None], lit[None], centres
    )
    (found,) = furnished.lights("box", renders, 2.0)
    assert found.ambient == pytest.approx(2 * np.pi * np.ones_like(found.ambient), rel=0.01)
    size = geometry.cap_solid_angle_sr(6)
    strengths = found.lamps[:, :, 0].max(axis=-1)
    assert strengths == pytest.approx([2 * 49 * size, 2 * 19 * size], rel=0.1)
    assert found.radii_m == pytest.approx(np.linalg.norm(centres, axis=-1) * np.tan(0.105), rel=0.1)
