"""Errors of what an app draws: none by the exact light, and what is known where it is not exact."""

import drawn
import numpy as np
import pytest
from drawn import Truth
from lightprobe import geometry, sh
from lightprobe.estimate import Estimate, EstimateFlag, Light, SphericalHarmonics
from lightprobe.reflection_map import ReflectionMap, directions

UP = geometry.normalize(np.array([0.3, 0.8, -0.5]))


def estimate(lamp, ambient, order=0):
    """A lamp of an irradiance, and even light around."""
    coefficients = np.zeros(((order + 1) ** 2, 3))
    coefficients[0] = ambient * np.sqrt(4 * np.pi)
    lights = (Light(1, UP, np.full(3, lamp), angular_radius_deg=3.0),) if lamp else ()
    kind = SphericalHarmonics("AMBIENT", order, coefficients)
    return Estimate(1, 1, 0, 0, 1000, EstimateFlag(0), lights, kind, None, None, 1, None)


def picture(lamp, ambient):
    """The same as a picture: a disc of 3 degrees."""
    towards = geometry.equirect_directions(drawn.WIDTH_PX, drawn.WIDTH_PX // 2)
    inside = geometry.angle_deg(towards, UP) < 3.0
    solid_angle = np.broadcast_to(
        geometry.equirect_solid_angles(drawn.WIDTH_PX, drawn.WIDTH_PX // 2)[:, None],
        inside.shape,
    )
    radiance = np.full((*inside.shape, 3), ambient)
    radiance[inside] += lamp / solid_angle[inside].sum()
    return radiance


@pytest.fixture(scope="module")
def truth():
    return Truth.of(estimate(3.0, 1.0).irradiance(drawn.NORMALS), picture(3.0, 1.0))


def test_the_exact_light_has_no_error(truth):
    errors = truth.errors(estimate(3.0, 1.0), None)
    assert errors["diffuse"] == pytest.approx(0, abs=1e-9)
    assert errors["shadows"] < 0.01
    assert errors["glossy"] < 0.005
    assert errors["mirrors"] < 0.01


def test_light_without_the_lamp_lacks_its_shadow_and_its_image(truth):
    """The same mean irradiance, but all of it from everywhere."""
    mean = 1.0 + 3.0 / 4 / np.pi
    errors = truth.errors(estimate(0.0, mean), None)
    assert errors["diffuse"] > 0.1
    assert errors["shadows"] > 0.05
    assert errors["glossy"] > 0.05
    assert errors["mirrors"] > 0.03


def test_twice_the_light_is_an_error_of_one(truth):
    errors = truth.errors(estimate(6.0, 2.0), None)
    relative = truth.irradiance.mean(axis=1)
    expected = np.sqrt(np.mean(relative**2)) / relative.mean()
    assert errors["diffuse"] == pytest.approx(expected, rel=1e-6)


def test_a_map_shows_what_the_picture_shows(truth):
    """Of 64 texels; the lamp's flux is spread over those within its disc."""
    inside = geometry.angle_deg(directions(64), UP) < 3.0
    faces = np.full((6, 64, 64, 3), 1.0)
    from lightprobe.reflection_map import solid_angles

    faces[inside] += 3.0 / solid_angles(64)[inside].sum()
    reflection = ReflectionMap(1, 1, 0, 1, "TOTAL", faces.astype(np.float32))
    errors = truth.errors(estimate(0.0, 0.5), reflection)
    assert errors["mirrors"] < 0.03
    assert errors["glossy"] < 0.005


def test_an_order_of_sh_is_drawn_as_it_is(truth):
    """A gradient of the first order, never below 0."""
    order1 = estimate(0.0, 1.0, order=1)
    order1.sh.coefficients[1] = 0.5
    light = drawn.of_packet(order1)
    back = sh.evaluate(1, light.directions).T @ light.flux
    assert back == pytest.approx([np.sqrt(4 * np.pi), 0.5, 0, 0], abs=2e-3)
