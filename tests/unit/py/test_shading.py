"""lightprobe.shading: reflectance, energy, reciprocity, and limits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe import geometry, shading
from lightprobe.geometry import Array

UP = np.array([0.0, 1.0, 0.0])
RIGHT = np.array([1.0, 0.0, 0.0])
ANGLES_DEG = [0.0, 20.0, 45.0, 70.0, 85.0]


def toward(polar_deg: float, azimuth_deg: float = 30.0) -> Array:
    polar, azimuth = np.radians([polar_deg, azimuth_deg])
    return np.array(
        [
            np.sin(polar) * np.cos(azimuth),
            np.cos(polar),
            np.sin(polar) * np.sin(azimuth),
        ]
    )


def hemisphere(rows: int = 400, columns: int = 400) -> tuple[Array, Array]:
    """Directions above UP, and their solid angles; rows of equal cosine."""
    cosine = (np.arange(rows) + 0.5) / rows
    azimuth = 2 * np.pi * (np.arange(columns) + 0.5) / columns
    sine = np.sqrt(1 - cosine**2)
    directions = np.stack(
        [
            sine[:, None] * np.cos(azimuth),
            np.broadcast_to(cosine[:, None], (rows, columns)),
            sine[:, None] * np.sin(azimuth),
        ],
        axis=-1,
    )
    return directions, np.full((rows, columns), 2 * np.pi / (rows * columns))


MODELS = {
    "Lambert": lambda n, light, view: shading.lambert(1.0) * (shading._dot(n, light) > 0),
    "Blinn-Phong 1": lambda n, light, view: shading.blinn_phong(n, light, view, 1),
    "Blinn-Phong 60": lambda n, light, view: shading.blinn_phong(n, light, view, 60),
    "Ashikhmin-Shirley": lambda n, light, view: shading.ashikhmin_shirley(
        n, light, view, RIGHT, (10, 150), 1.0
    ),
    "Premoze": lambda n, light, view: shading.ashikhmin_premoze(
        n, light, view, RIGHT, (10, 150), 1.0
    ),
    "Premoze, dull": lambda n, light, view: shading.ashikhmin_premoze(
        n, light, view, RIGHT, (1, 3), 1.0
    ),
}


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("angle_deg", ANGLES_DEG)
def test_no_surface_reflects_more_than_it_gets(name: str, angle_deg: float) -> None:
    lights, solid_angle = hemisphere()
    reflected = MODELS[name](UP, lights, toward(angle_deg)) * lights[..., 1] * solid_angle
    assert 0.01 < reflected.sum() < 1.001


def test_a_sharp_lobe_reflects_all_of_it_straight_on() -> None:
    """What normalizes a model is right when a mirror-like lobe loses nearly nothing."""
    lights, solid_angle = hemisphere(3000, 400)
    for model in (shading.ashikhmin_shirley, shading.ashikhmin_premoze):
        brdf = model(UP, lights, UP, RIGHT, (2000, 2000), 1.0)
        assert (brdf * lights[..., 1] * solid_angle).sum() == pytest.approx(1, abs=0.01)
    brdf = shading.blinn_phong(UP, lights, UP, 2000)
    assert (brdf * lights[..., 1] * solid_angle).sum() == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("name", MODELS)
@given(st.floats(0, 89), st.floats(0, 89), st.floats(0, 360))
def test_light_and_eye_may_change_places(name: str, one: float, other: float, turn: float) -> None:
    a, b = toward(one, 0), toward(other, turn)
    assert MODELS[name](UP, a, b) == pytest.approx(MODELS[name](UP, b, a), rel=1e-9)


@pytest.mark.parametrize("name", [name for name in MODELS if name != "Lambert"])
def test_nothing_is_seen_from_below(name: str) -> None:
    assert MODELS[name](UP, toward(95), toward(10)) == 0
    assert MODELS[name](UP, toward(10), toward(95)) == 0


def test_the_lobe_has_its_limit_on_the_axis() -> None:
    """The exponent of [AS] is 0/0 where the half vector is the normal."""
    near = shading.ashikhmin_shirley(UP, toward(1e-4), UP, RIGHT, (10, 150), 0.9)
    assert shading.ashikhmin_shirley(UP, UP, UP, RIGHT, (10, 150), 0.9) == pytest.approx(near)


def test_an_anisotropic_highlight_is_long_across_the_larger_power() -> None:
    along = shading.ashikhmin_shirley(UP, toward(30, 0), UP, RIGHT, (10, 150), 0.9)
    across = shading.ashikhmin_shirley(UP, toward(30, 90), UP, RIGHT, (10, 150), 0.9)
    assert along > 20 * across


@given(st.floats(0, 89.9), st.floats(0.3, 3))
def test_refraction_obeys_snell(angle_deg: float, ratio: float) -> None:
    seen = shading.refract(toward(angle_deg), UP, ratio)
    sine = ratio * np.sin(np.radians(angle_deg))
    if sine > 1:
        assert np.isnan(seen).all()
    elif sine < 1 - 1e-9:
        assert np.linalg.norm(seen) == pytest.approx(1)
        assert np.hypot(seen[0], seen[2]) == pytest.approx(sine, abs=1e-9)
        assert seen[1] < 0


def test_fresnel() -> None:
    ratio = 1 / 1.5
    straight = shading.fresnel_dielectric(1.0, ratio)
    assert straight == pytest.approx(0.04)
    assert shading.fresnel_dielectric(0.0, ratio) == pytest.approx(1)
    assert shading.fresnel_dielectric(np.cos(np.radians(42)), 1.5) == 1.0  # beyond 41.8°
    cosines = np.linspace(0, 1, 200)
    exact = shading.fresnel_dielectric(cosines, ratio)
    assert np.abs(shading.fresnel_schlick(cosines, straight) - exact).max() < 0.05


@given(st.floats(0, 89), st.floats(0, 360))
def test_a_mirror_shows_the_light_whose_half_vector_is_the_normal(
    polar: float, turn: float
) -> None:
    view = toward(polar, turn)
    seen = shading.reflect(view, UP)
    np.testing.assert_allclose(shading.half_vector(seen, view), UP, atol=1e-7)
    assert geometry.normalize(seen) == pytest.approx(seen)
