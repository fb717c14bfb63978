"""Probes at known places: which lamps are the same, and what they are told to be."""

from dataclasses import replace

import numpy as np
import pytest
from lightprobe import geometry, sh
from lightprobe.box_fit import BoxFit
from lightprobe.cli import view
from lightprobe.cli.field import Still
from lightprobe.estimate import Estimate, EstimateFlag, Light, LightFlag, SphericalHarmonics
from lightprobe.field import Station, join, with_room
from lightprobe.sim.room import Bulb, Room

FLAT = SphericalHarmonics("AMBIENT", 1, np.array([[1.0] * 3] + [[0.0] * 3] * 3))
PLACES = ((0.0, 0.0, 0.0), (0.8, 0.1, -0.5), (-1.2, 0.0, 0.6))
YAWS = (0.0, 70.0, -160.0)


def stations(number, yaw_sigma_deg=3.0):
    return [
        Station(f"tcp:probe:{i}", np.array(PLACES[i]), YAWS[i], 0.01, yaw_sigma_deg, 0.3)
        for i in range(number)
    ]


def with_distances(probes, base, others):
    return join(probes, base, others).estimate


def estimate(*lights):
    return Estimate(1, 1, 0, 0, 1000, EstimateFlag(0), lights, FLAT, None, None, 1, None)


def seen_by(station, bulbs, rng=None):
    """Give what a probe that is turned, and stands nearly where it is said to, sees of bulbs."""
    place_m, turn = station.place_m, geometry.inverse(station.turn_wxyz)
    if rng is not None:
        place_m = place_m + 0.01 * rng.normal(size=3)
        error_rad = station.turn_sigma_rad * rng.normal(size=3)
        error_deg = np.degrees(np.linalg.norm(error_rad))
        turn = geometry.turn_after(turn, geometry.quaternion(error_rad, error_deg))
    lights = []
    for i, bulb in enumerate(bulbs):
        lamp = bulb.seen_from(tuple(place_m)).lamp()
        lights.append(Light(
            100 * len(station.uri) + i, geometry.rotate(turn, lamp.direction), lamp.irradiance,
            lamp.radius_deg, direction_sigma_deg=0.05, irradiance_sigma=0.02 * lamp.irradiance,
        ))  # fmt: skip
    return estimate(*lights)


@pytest.mark.parametrize("number", [2, 3])
def test_lamps_of_a_room_get_their_distances(number):
    rng, bulbs = np.random.default_rng(2), Room().bulbs
    offs, stated = [], []
    for _ in range(30):
        probes = stations(number)
        base, *others = [
            seen_by(probe, bulbs, rng if i else None) for i, probe in enumerate(probes)
        ]
        for light, bulb in zip(with_distances(probes, base, others).lights, bulbs, strict=True):
            if light.distance_m is not None:
                offs.append(light.distance_m / np.linalg.norm(bulb.position_m) - 1)
                stated.append(light.distance_sigma)
    assert len(offs) > 80  # of 120
    errors = np.abs(offs) / stated
    assert np.median(np.abs(offs)) < 0.05
    assert np.mean(errors < 3) >= 0.97


def test_a_lamp_that_the_other_does_not_see_has_no_distance():
    probes, bulbs = stations(2), Room().bulbs
    base, other = seen_by(probes[0], bulbs), seen_by(probes[1], bulbs[1:])
    lights = with_distances(probes, base, [other]).lights
    assert lights[0].distance_m is None
    assert lights[0].nearest_m is None
    # One lies nearly on the line between the probes.
    assert [light.distance_m is None for light in lights[1:]] == [False, False, True]
    assert 0.2 < lights[3].nearest_m < np.linalg.norm(bulbs[3].position_m)


def test_two_lamps_that_may_be_exchanged_have_no_distance():
    """Both lie in one plane with the probes, and are equally strong."""
    probes = [replace(station, yaw_deg=0.0) for station in stations(2)]
    probes[1] = replace(probes[1], place_m=np.array([1.0, 0, 0]))
    bulbs = (Bulb((-0.2, 1.5, -1.5), 0.1, (9.0, 9, 9)), Bulb((1.2, 1.5, -1.5), 0.1, (9.0, 9, 9)))
    base, other = (seen_by(probe, bulbs) for probe in probes)
    for light in with_distances(probes, base, [other]).lights:
        known = light.distance_m is not None
        assert not known or abs(light.distance_m - 2.13) < 0.2


def row(*metres):
    """Give equal lamps in a row that is parallel to the line between two probes."""
    return tuple(Bulb((x, 1.5, -1.5), 0.1, (9.0, 9, 9)) for x in metres)


@pytest.mark.parametrize(
    ("first", "second"), [((0.2, 1.4), (-1.0,)), ((0.2,), (1.4, -1.0)), ((-1.0, 0.2), (1.4,))]
)
def test_of_a_row_of_equal_lamps_none_is_taken_for_its_neighbour(first, second):
    """Each probe sees others of them: directions agree on places where nothing hangs."""
    probes = [Station("a", np.zeros(3)), Station("b", np.array([1.2, 0, 0]))]
    base, other = seen_by(probes[0], row(*first)), seen_by(probes[1], row(*second))
    lights = with_distances(probes, base, [other]).lights
    assert [light.distance_m for light in lights] == [None] * len(first)


@pytest.mark.parametrize(("cd_m2_per_unit", "placed"), [(25.0, 3), (1.0, 0)])
def test_units_of_light_may_differ_where_both_are_calibrated(cd_m2_per_unit, placed):
    """Four times as bright numbers are the same lamps where a number is a quarter of the light."""
    probes, bulbs = stations(2), Room().bulbs
    base, other = (seen_by(probe, bulbs) for probe in probes)
    other = replace(other, cd_m2_per_unit=cd_m2_per_unit, lights=tuple(
        replace(light, irradiance=4 * light.irradiance) for light in other.lights
    ))  # fmt: skip
    lights = with_distances(probes, replace(base, cd_m2_per_unit=100.0), [other]).lights
    assert sum(light.distance_m is not None for light in lights) == placed


def test_units_of_light_may_differ_where_none_is_calibrated():
    probes, bulbs = stations(2), Room().bulbs
    base, other = (seen_by(probe, bulbs) for probe in probes)
    brighter = replace(other.sh, coefficients=40 * other.sh.coefficients)
    other = replace(other, sh=brighter, lights=tuple(
        replace(light, irradiance=40 * light.irradiance, irradiance_sigma=None)
        for light in other.lights
    ))  # fmt: skip
    lights = with_distances(probes, base, [other]).lights
    assert sum(light.distance_m is not None for light in lights) >= 2


def test_lamps_without_light_are_no_error():
    probes, bulbs = stations(2), Room().bulbs
    base, other = (seen_by(probe, bulbs) for probe in probes)
    black = replace(base.lights[0], irradiance=np.zeros(3), irradiance_sigma=None)
    lights = with_distances(probes, replace(base, lights=(black,)), [other]).lights
    assert lights[0].distance_m is None


def test_what_is_far_away_is_told_by_the_least_distance():
    probes, sun = stations(2), (Bulb((0.0, 8e4, -6e4), 500.0, (9.0, 9, 9)),)
    base, other = (seen_by(probe, sun) for probe in probes)
    (light,) = with_distances(probes, base, [other]).lights
    assert light.distance_m is None
    assert 5 < light.nearest_m < 1000


def test_mirror_images_and_areas_are_left_alone():
    probes, bulbs = stations(2), Room().bulbs[:1]
    for flag in (LightFlag.REFLECTION, LightFlag.EXTENDED):
        base, other = (seen_by(probe, bulbs) for probe in probes)
        base = replace(base, lights=(replace(base.lights[0], flags=flag),))
        assert with_distances(probes, base, [other]).lights == base.lights


def test_a_yaw_that_is_five_degrees_off_is_found():
    probes, bulbs = stations(2), Room().bulbs
    base, other = (seen_by(probe, bulbs) for probe in probes)
    probes[1] = replace(probes[1], yaw_deg=YAWS[1] - 5)
    joined = join(probes, base, [other])
    found = geometry.turn_after(geometry.inverse(probes[1].turn_wxyz), joined.turns_wxyz[1])
    off_deg = np.degrees(2 * np.arcsin(abs(found[2]))) - 5
    assert abs(off_deg) < 3 * joined.yaw_sigma_deg[1] < 5
    for light, bulb in zip(joined.estimate.lights, bulbs, strict=True):
        if light.distance_m is not None:
            off = light.distance_m / np.linalg.norm(bulb.position_m) - 1
            assert abs(off) < 3 * light.distance_sigma


def test_without_the_others_nothing_changes():
    probes, bulbs = stations(3), Room().bulbs
    base = seen_by(probes[0], bulbs)
    assert with_distances(probes, base, [None, None]).lights == base.lights
    assert with_distances(probes, base, [estimate(), None]).lights == base.lights


def test_a_probe_that_is_turned_wrong_places_nothing():
    """Its yaw is 20 degrees off: directions disagree by much more than is said."""
    probes, bulbs = stations(2), Room().bulbs
    base, other = (seen_by(probe, bulbs) for probe in probes)
    probes[1] = replace(probes[1], yaw_deg=YAWS[1] + 20)
    lights = with_distances(probes, base, [other]).lights
    for light, bulb in zip(lights, bulbs, strict=True):
        off = light.distance_m and abs(light.distance_m / np.linalg.norm(bulb.position_m) - 1)
        assert off is None or off < 3 * light.distance_sigma


def test_a_probe_that_is_turned_after_the_start_counts_no_more():
    still, turned = Still(), geometry.quaternion([0.2, 1, 0], 2.0)
    start = replace(estimate(), orientation=np.array([0, 0, 0, 1.0]))
    w, x, y, z = turned
    later = replace(start, orientation=np.array([x, y, z, w]))
    assert still.look(None) is None
    assert still.look(start) is start
    assert still.look(later) is None
    assert still.is_turned
    assert still.look(start) is start
    assert not still.is_turned
    restarted = replace(later, boot_id=2)
    assert still.look(restarted) is restarted
    unknown = replace(start, orientation=None)
    assert still.look(unknown) is unknown


def test_watch_shows_distances_where_they_are_known():
    near = Light(1, np.array([0, 1.0, 0]), np.ones(3), 1.0, distance_m=2.314, distance_sigma=0.012)
    far = Light(2, np.array([1.0, 0, 0]), np.ones(3), 1.0, nearest_m=31.26)
    unknown = Light(3, np.array([0, 0, 1.0]), np.ones(3), 1.0)
    assert [view.distance_words(one) for one in (near, far, unknown)] == [
        "2.31 m ±1.2%", "> 31.3 m", "–",
    ]  # fmt: skip
    headers = [
        [str(column.header) for column in view.lights_table(estimate(*lights)).columns]
        for lights in ((near, unknown), (unknown,))
    ]
    assert ["distance" in one for one in headers] == [True, False]


def lit_room(station, scale=1.0, unlisted=()):
    """Give what a probe sees of a room with pictures; its unit of light is 1 / scale."""
    room = Room(pictures=3).seen_from(tuple(station.place_m.tolist()))
    whole = room.render(256, 128).compose(np.ones(len(room.bulbs))).astype(np.float64)
    turn = geometry.inverse(station.turn_wxyz)
    coefficients, lights = sh.project(whole, 4), []
    for i, lamp in enumerate(room.lamps):
        if i not in unlisted:
            coefficients -= sh.lamp(lamp.direction, 4)[:, None] * lamp.irradiance
            lights.append(Light(
                100 * len(station.uri) + i, geometry.rotate(turn, lamp.direction),
                scale * lamp.irradiance, lamp.radius_deg, direction_sigma_deg=0.05,
                irradiance_sigma=0.02 * scale * lamp.irradiance,
            ))  # fmt: skip
    turned = SphericalHarmonics("AMBIENT", 4, scale * sh.rotate(coefficients, turn))
    return replace(estimate(*lights), sh=turned, relighting_sigma=0.01)


def roomed(probes, base, others, search=None):
    return with_room(probes, join(probes, base, others), others, search or BoxFit()).estimate


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_two_probes_tell_the_room(scale):
    probes = stations(2)
    probes[1] = replace(probes[1], place_m=np.array([0.6, 0.2, -0.7]))
    base = lit_room(probes[0])
    found = roomed(probes, base, [lit_room(probes[1], scale)])
    assert found.room is not None
    normals = geometry.sphere_normals(2)
    offs = []
    for place in ([0.5, 0, 0], [-0.4, 0.1, 0.3], [0, -0.4, 0.8], [0.2, 0.3, -0.9]):
        there = lit_room(replace(probes[0], place_m=np.array(place)))
        true, *tried = (
            sh.irradiance(one.sh.coefficients, normals) for one in (there, found.at(place), base)
        )
        off, unchanged = (np.sqrt(np.mean((one - true) ** 2)) / true.mean() for one in tried)
        assert off < 3 * np.linalg.norm(place) * found.room.error_per_m
        offs.append((off, unchanged))
    moved, unmoved = np.mean(offs, axis=0)
    assert moved < 0.6 * unmoved


def test_a_lamp_that_has_no_place_is_ambient_light_of_both():
    """One of the probes does not list it: else its light would seem to come and go."""
    probes = stations(2)
    base, other = lit_room(probes[0]), lit_room(probes[1], unlisted=(2,))
    found = roomed(probes, base, [other])
    assert found.room is not None
    assert found.room.error_per_m < 0.5


def test_where_nothing_is_known_of_the_room():
    probes = stations(2)
    base, other = lit_room(probes[0]), lit_room(probes[1])
    low = replace(other, sh=FLAT)
    far = replace(base, sh=SphericalHarmonics("AMBIENT", 4, base.sh.coefficients))
    assert roomed(probes, base, [None]).room is None
    assert roomed(probes, base, [low]).room is None  # too coarse
    assert roomed(probes, replace(base, lights=()), [other]).room is None  # no lamp tells the yaw
    dark = replace(other, sh=SphericalHarmonics("AMBIENT", 4, 0 * other.sh.coefficients))
    assert roomed(probes, base, [dark]).room is None
    same = roomed(probes, base, [replace(far, lights=other.lights)])
    assert same.room is None or same.room.walls_m.min() > 1.0


def test_the_room_stays_as_it_was_found():
    """Each look begins where the one before has ended, and tries another start."""
    probes, search = stations(2), BoxFit()
    base, other = lit_room(probes[0]), lit_room(probes[1])
    first, *later = (roomed(probes, base, [other], search).room for _ in range(4))
    for one in later:
        assert one.error_per_m <= first.error_per_m * 1.01


def test_a_probe_that_comes_and_goes_is_no_error():
    probes, search = stations(3), BoxFit()
    base, *others = (lit_room(probe) for probe in probes)
    for heard in ([others[0], None], others, [None, others[1]], others):
        found = roomed(probes, base, heard, search)
        assert found.room is not None
        assert np.isfinite(found.room.walls_sigma_m).all()


def test_a_first_probe_with_coarse_light_gets_no_room_of_another():
    probes = stations(3)
    base, *others = (lit_room(probe) for probe in probes)
    coarse = SphericalHarmonics("AMBIENT", 2, base.sh.coefficients[:9])
    assert roomed(probes, replace(base, sh=coarse), others).room is None
