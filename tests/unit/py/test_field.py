"""Probes at known places: which lamps are the same, and what they are told to be."""

from dataclasses import replace

import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.estimate import Estimate, EstimateFlag, Light, LightFlag, SphericalHarmonics
from lightprobe.field import Station, with_distances
from lightprobe.sim.room import Bulb, Room

FLAT = SphericalHarmonics("AMBIENT", 1, np.array([[1.0] * 3] + [[0.0] * 3] * 3))
PLACES = ((0.0, 0.0, 0.0), (0.8, 0.1, -0.5), (-1.2, 0.0, 0.6))
YAWS = (0.0, 70.0, -160.0)


def stations(number, turn_sigma_deg=0.3):
    return [
        Station(f"tcp:probe:{i}", np.array(PLACES[i]), YAWS[i], 0.01, turn_sigma_deg)
        for i in range(number)
    ]


def estimate(*lights):
    return Estimate(1, 1, 0, 0, 1000, EstimateFlag(0), lights, FLAT, None, None, 1, None)


def seen_by(station, bulbs, rng=None):
    """Give what a probe that is turned, and stands nearly where it is said to, sees of bulbs."""
    place_m, turn = station.place_m, geometry.inverse(station.turn_wxyz)
    if rng is not None:
        place_m = place_m + 0.01 * rng.normal(size=3)
        turn = geometry.turn_after(geometry.quaternion(rng.normal(size=3), 0.3), turn)
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
    assert 0.5 < lights[3].nearest_m < np.linalg.norm(bulbs[3].position_m)


def test_two_lamps_that_may_be_exchanged_have_no_distance():
    """Both lie in one plane with the probes, and are equally strong."""
    probes = [replace(station, yaw_deg=0.0) for station in stations(2)]
    probes[1] = replace(probes[1], place_m=np.array([1.0, 0, 0]))
    bulbs = (Bulb((-0.2, 1.5, -1.5), 0.1, (9.0, 9, 9)), Bulb((1.2, 1.5, -1.5), 0.1, (9.0, 9, 9)))
    base, other = (seen_by(probe, bulbs) for probe in probes)
    for light in with_distances(probes, base, [other]).lights:
        known = light.distance_m is not None
        assert not known or abs(light.distance_m - 2.13) < 0.2


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
