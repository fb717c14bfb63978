"""All light as a number of lights: lightprobe.imaging.constellation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe import geometry, sh
from lightprobe.colour import luminance
from lightprobe.errors import UsageError
from lightprobe.estimate import Estimate, EstimateFlag, Light, SphericalHarmonics
from lightprobe.evaluate.metrics import relighting_relative
from lightprobe.imaging.constellation import CUTS, constellation
from lightprobe.reflection_map import ReflectionMap, directions

NORMALS = geometry.sphere_normals(2)
LAMPS = (
    Light(4, geometry.direction_from_angles(30, 40), np.array([6.0, 5, 3]), 2.0),
    Light(9, geometry.direction_from_angles(-170, -5), np.array([1.0, 2, 4]), 0.5),
)


def estimate(coefficients, lights=LAMPS, kind="AMBIENT"):
    order = round(len(coefficients) ** 0.5) - 1
    harmonics = SphericalHarmonics(kind, order, np.asarray(coefficients, float))
    return Estimate(1, 2, 3, 4, 500, EstimateFlag(0), lights, harmonics, 0.01, None, 1, None)


def around(seed, order=2):
    """SH of light that is nowhere negative."""
    random = np.random.default_rng(seed).normal(size=((order + 1) ** 2, 3))
    random[0] = 0
    swing = -sh.radiance(random, geometry.sphere_normals(4)).min()
    random[0] = 1.1 * swing * np.sqrt(4 * np.pi)
    return random


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("count", [1, 2, 3, 5, 16, 64])
@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 1000))
def test_no_light_is_lost_or_made(cut, count, seed):
    given_light = estimate(around(seed))
    found, notes = constellation(given_light, count, cut)
    assert notes == []
    assert len(found.lights) == count
    assert not found.sh.coefficients.any()
    whole = sum(np.asarray(light.irradiance) for light in found.lights) / 4
    expected = given_light.irradiance(geometry.sphere_normals(4)).mean(axis=0)
    assert whole == pytest.approx(expected, rel=0.01)
    assert len({light.id for light in found.lights}) == count
    assert all(0 <= light.angular_radius_deg <= 90 for light in found.lights)


@pytest.mark.parametrize("cut", CUTS)
def test_more_lights_are_more_exact(cut):
    given_light = estimate(around(3))
    true = given_light.irradiance(NORMALS)
    errors = [
        relighting_relative(true, constellation(given_light, count, cut)[0].irradiance(NORMALS))
        for count in (4, 16, 64)
    ]
    assert errors[0] > 1.5 * errors[1] > 3 * errors[2]
    assert errors[2] < 0.02


def test_lamps_stay_and_those_too_many_join_the_rest():
    found, _ = constellation(estimate(around(1)), 16)
    kept = {light.id: light for light in found.lights}
    assert kept[4].direction is LAMPS[0].direction
    assert kept[9].irradiance is LAMPS[1].irradiance
    faint = Light(12, np.array([0.0, 1, 0]), np.full(3, 0.01), 5.0)
    found, _ = constellation(estimate(around(1), (*LAMPS, faint)), 8)
    assert {4, 9} < {light.id for light in found.lights}
    assert len(found.lights) == 8
    assert not any(light.irradiance is faint.irradiance for light in found.lights)
    (one,) = constellation(estimate(np.zeros((1, 3))), 1)[0].lights
    assert geometry.angle_deg(one.direction, LAMPS[0].direction) < 45
    assert one.irradiance == pytest.approx([7, 7, 7], rel=1e-6)


def test_an_area_light_is_cut_in_its_place():
    towards = geometry.direction_from_angles(-60, 10)
    window = Light(7, towards, np.full(3, 8.0), 20.0, half_angle_deg=(25.0, 15.0),
                   axis=np.array([0.0, 1.0, 0.0]))  # fmt: skip
    drawn = estimate(np.zeros((1, 3)), (window,))
    found, _ = constellation(drawn, 12)
    assert len(found.lights) == 12
    whole = sum(np.asarray(light.irradiance) for light in found.lights)
    assert whole == pytest.approx([8, 8, 8], rel=0.01)
    off_deg = [float(geometry.angle_deg(light.direction, towards)) for light in found.lights]
    strong = [off for off, light in zip(off_deg, found.lights, strict=True)
              if luminance(light.irradiance) > 0.1]  # fmt: skip
    assert len(strong) > 5
    assert max(strong) < 27


def test_a_total_has_its_lamps_in_the_regions():
    total = estimate(around(1)).total()
    found, _ = constellation(estimate(total.coefficients, (), "TOTAL"), 8)
    assert found.sh.kind == "AMBIENT"
    assert len(found.lights) == 8


def test_a_map_is_cut_where_it_shines():
    """A window of 10 degrees in a dark room is a few lights there, as wide as it is."""
    towards = geometry.direction_from_angles(50, 20)
    window = geometry.angle_deg(directions(64), towards) < 10
    faces = np.full((6, 64, 64, 3), 0.01, np.float32)
    faces[window] = 100.0
    mirrored = ReflectionMap(1, 1, 0, 1, "AMBIENT", faces)
    found, _ = constellation(estimate(np.zeros((1, 3)), ()), 2, "variance", mirrored)
    strongest = found.lights[0]
    assert geometry.angle_deg(strongest.direction, towards) < 1
    assert 10 < strongest.angular_radius_deg < 13  # and what else is in its half
    more, _ = constellation(estimate(np.zeros((1, 3)), ()), 16, "variance", mirrored)
    there = [light for light in more.lights if geometry.angle_deg(light.direction, towards) < 11]
    assert len(there) >= 8


def test_darkness_has_no_lights():
    found, _ = constellation(estimate(np.zeros((9, 3)), ()), 16)
    assert found.lights == ()


@pytest.mark.parametrize("count", [0, 65, -1])
def test_numbers_that_make_no_sense_are_refused(count):
    with pytest.raises(UsageError, match=f"constellation: {count} lights: expected 1…64"):
        constellation(estimate(around(0)), count)
