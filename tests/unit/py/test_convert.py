"""Every adapter against its target's own shader, written down independently of ours."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from lightprobe import convert, geometry, sh

finite = st.floats(-1, 1, allow_nan=False)
tables = hnp.arrays(np.float64, (9, 3), elements=finite)
vectors = hnp.arrays(np.float64, 3, elements=finite).filter(lambda v: np.linalg.norm(v) > 0.05)
NAMES = sorted(convert.ADAPTERS)
A = np.array([np.pi] + [2 * np.pi / 3] * 3 + [np.pi / 4] * 5)


def positive_basis(n):
    x, y, z = n
    return np.array([0.282095, 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y,
                     1.092548 * y * z, 0.315392 * (3 * z * z - 1), 1.092548 * x * z,
                     0.546274 * (x * x - y * y)])  # fmt: skip


def signed_basis(n):
    """With the Condon–Shortley sign: odd m negated."""
    return positive_basis(n) * [1, -1, 1, -1, 1, -1, 1, -1, 1]


def polynomials(n):
    x, y, z = n
    return np.array([1, y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y])


def shade_sh9(c, n):
    """Unity's ShadeSH9 via its SphericalHarmonicsL2.Evaluate: polynomials alone."""
    return polynomials(n) @ c


# What the target's renderer computes at a normal in its own axes, scaled to irradiance.
def majored(f):
    return lambda flat, n: f(np.reshape(flat, (9, 3)), n)


def planar(f):
    return lambda flat, n: f(np.reshape(flat, (3, 9)).T, n)


def positive(c, n):
    return (positive_basis(n) * A) @ c


def signed(c, n):
    return (signed_basis(n) * A) @ c


TARGETS = {
    "webxr": majored(positive),
    "threejs": majored(positive),
    "filament-radiance": majored(signed),
    "filament-irradiance": majored(lambda c, n: np.pi * polynomials(n) @ c),
    "unity": planar(lambda c, n: np.pi * shade_sh9(c, n)),
    "unreal": planar(signed),
    "z-up": majored(positive),
    "arcore-positive": majored(positive),
    "arcore-signed": majored(signed),
    "arkit": planar(positive),
}


def test_every_adapter_has_its_target():
    assert set(TARGETS) == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_one_lamp_straight_up_lights_what_faces_up(name):
    adapter = convert.adapter(name)
    flat = adapter.coefficients(sh.lamp([0, 1, 0], 2)[:, None] * [3.0, 2.0, 1.0])
    up = adapter.direction([0, 1, 0])
    normals = adapter.direction(geometry.sphere_normals(2))
    lit = np.array([TARGETS[name](flat, n) for n in normals])
    assert geometry.angle_deg(normals[np.argmax(lit[:, 0])], up) < 1e-6
    assert TARGETS[name](flat, up) == pytest.approx(1.0625 * np.array([3, 2, 1]), rel=1e-5)


@pytest.mark.parametrize("name", NAMES)
@given(c=tables, v=vectors)
def test_target_s_shader_sees_our_irradiance(name, c, v):
    adapter, n = convert.adapter(name), geometry.normalize(v)
    theirs = TARGETS[name](adapter.coefficients(c), adapter.direction(n))
    assert theirs == pytest.approx(sh.irradiance(c, n), abs=1e-4)


@pytest.mark.parametrize("name", NAMES)
@given(c=tables, v=vectors)
def test_there_and_back(name, c, v):
    adapter = convert.adapter(name)
    assert adapter.from_coefficients(adapter.coefficients(c)) == pytest.approx(c, abs=1e-12)
    assert adapter.from_direction(adapter.direction(v)) == pytest.approx(v, abs=1e-12)
    assert adapter.from_light(adapter.light(v)) == pytest.approx(v, abs=1e-12)


def test_axes_as_documented():
    v = np.array([1.0, 2.0, 3.0])
    assert convert.adapter("unity").direction(v).tolist() == [1, 2, -3]
    assert convert.adapter("unreal").direction(v).tolist() == [-3, 1, 2]
    assert convert.adapter("z-up").direction(v).tolist() == [1, -3, 2]


def test_unity_light_and_sh_agree():
    """Unity divides by π in neither: a lamp in the SH and as a light lights alike."""
    unity = convert.adapter("unity")
    up = np.array([0.0, 1, 0])
    in_sh = shade_sh9(
        np.reshape(unity.coefficients(np.outer(sh.lamp(up, 2), [1, 1, 1])), (3, 9)).T,
        up,
    )
    assert in_sh == pytest.approx(1.0625 * unity.light([1, 1, 1]), rel=1e-6)


def test_lower_orders_and_wrong_shapes():
    webxr = convert.adapter("webxr")
    assert webxr.coefficients(np.ones((4, 3))).tolist() == [1.0] * 12 + [0.0] * 15
    assert webxr.coefficients(np.ones((25, 3))).shape == (27,)
    for bad in (np.ones((5, 3)), np.ones((9, 4)), np.ones(27)):
        with pytest.raises(ValueError, match="shape"):
            webxr.coefficients(bad)
    with pytest.raises(ValueError, match="27"):
        webxr.from_coefficients(np.ones(9))
    with pytest.raises(KeyError, match="unity"):
        convert.adapter("godot")


@given(hnp.arrays(np.float64, 3, elements=st.floats(0, 1e6)))
def test_threejs_light_keeps_the_product(irradiance):
    colour, intensity = convert.threejs_light(irradiance)
    assert colour.max() <= 1 + 1e-12
    assert colour * intensity == pytest.approx(irradiance)
