"""Where lamps are, from directions: errors as large as they are said to be, near and far."""

import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.triangulate import Sighting, triangulate

SIGMA_DEG, SIGMA_M = 0.3, 0.01


def sightings(rng, lamp_m, places_m):
    """Give directions to a lamp, each with an error of its own, from places that err too."""
    found = []
    for k, place_m in enumerate(places_m):
        true_m = place_m + (SIGMA_M * rng.normal(size=3) if k else 0)
        error = np.radians(SIGMA_DEG) * rng.normal(size=3)
        seen = geometry.normalize(lamp_m - true_m)
        seen = geometry.normalize(seen + np.cross(error, seen))
        found.append(Sighting(place_m, seen, SIGMA_DEG, SIGMA_M if k else 0.0))
    return found


@pytest.mark.parametrize("places", [2, 4])
@pytest.mark.parametrize("distance_m", [0.7, 3.0, 12.0, 45.0, 1e7])
def test_errors_are_as_stated(distance_m, places):
    rng = np.random.default_rng(5)
    offs, chi2 = [], []
    for _ in range(150):
        lamp_m = distance_m * geometry.normalize(rng.normal(size=3))
        way = [geometry.normalize(rng.normal(size=3)) for _ in range(places - 1)]
        place = triangulate(sightings(rng, lamp_m, [np.zeros(3), *way]))
        off = place.inverse_distance_per_m - 1 / distance_m
        offs.append(abs(off) / place.inverse_distance_sigma_per_m)
        chi2.append(place.chi2 / place.degrees_of_freedom)
        assert place.distance_m is None or place.distance_m < 100
    assert 0.55 <= np.mean(np.array(offs) < 1) <= 0.8
    assert np.mean(np.array(offs) < 3) >= 0.97
    # Of lamps without end, what lies behind by chance counts once more.
    assert 0.7 < np.mean(chi2) < (1.3 if distance_m < 100 else 1.6)


def test_from_one_metre_apart_a_lamp_at_three_is_known_within_centimetres():
    rng = np.random.default_rng(6)
    lamp_m = np.array([0.5, 2.0, -2.2])
    places = [np.zeros(3), np.array([1.0, 0, 0])]
    offs = [
        triangulate(sightings(rng, lamp_m, places)).distance_m - np.linalg.norm(lamp_m)
        for _ in range(200)
    ]
    assert np.median(np.abs(offs)) < 0.08


def test_without_a_baseline_nothing_is_known():
    lamp = geometry.normalize([1, 2, 3])
    place = triangulate([Sighting(np.zeros(3), lamp, 0.3, 0.01)] * 2)
    assert place.distance_m is None
    assert place.nearest_m < 0.1


def test_along_the_line_between_the_places_nothing_is_known():
    places = [np.zeros(3), np.array([1.0, 0, 0])]
    lamp = np.array([1.0, 0, 0])
    place = triangulate([Sighting(at, lamp, 0.3, 0.01) for at in places])
    assert place.distance_m is None


def test_lines_that_miss_each_other_are_told_by_chi2():
    a = Sighting(np.zeros(3), geometry.normalize([1, 1, -2]), 0.3, 0.01)
    b = Sighting(np.array([1.0, 0, 0]), geometry.normalize([1, -1, -2]), 0.3, 0.01)
    assert triangulate([a, b]).chi2 > 100


def test_a_lamp_that_would_lie_behind_a_place_is_none_of_its():
    a = Sighting(np.zeros(3), geometry.normalize([-1, 0, -1]), 0.3, 0.01)
    b = Sighting(np.array([1.0, 0, 0]), geometry.normalize([1, 0, -1]), 0.3, 0.01)
    assert triangulate([a, b]).chi2 > 100


def test_one_sighting_is_refused():
    with pytest.raises(ValueError, match="two sightings"):
        triangulate([Sighting(np.zeros(3), np.array([0, 1.0, 0]), 0.3)])
