"""Spherical harmonics against independent libraries and exact integrals."""

import math

import numpy as np
import pytest
import scipy.integrate
import scipy.special
import sphericart
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from lightprobe import geometry, sh

finite = st.floats(-1, 1, allow_nan=False)
vectors = hnp.arrays(np.float64, 3, elements=finite).filter(lambda v: np.linalg.norm(v) > 0.05)
quaternions = hnp.arrays(np.float64, 4, elements=finite).filter(lambda q: np.linalg.norm(q) > 0.05)
coefficients = hnp.arrays(np.float64, (81, 2), elements=finite)
DIRECTIONS = geometry.normalize(np.random.default_rng(0).standard_normal((200, 3)))


def test_basis_is_sphericart_s():
    oracle = sphericart.SphericalHarmonics(sh.MAX_ORDER).compute(DIRECTIONS)
    assert sh.evaluate(sh.MAX_ORDER, DIRECTIONS) == pytest.approx(oracle, abs=1e-12)


def test_basis_is_scipy_s():
    theta = np.arccos(DIRECTIONS[:, 2])
    phi = np.arctan2(DIRECTIONS[:, 1], DIRECTIONS[:, 0])
    ours = sh.evaluate(sh.MAX_ORDER, DIRECTIONS)
    for degree in range(sh.MAX_ORDER + 1):
        for m in range(-degree, degree + 1):
            y = scipy.special.sph_harm_y(degree, abs(m), theta, phi)
            real = y.real if m >= 0 else y.imag
            oracle = real * (math.sqrt(2) * (-1) ** m if m else 1)
            assert ours[:, degree * (degree + 1) + m] == pytest.approx(oracle, abs=1e-12)


def test_basis_is_the_one_in_the_conventions():
    x, y, z = DIRECTIONS.T
    written = [
        0.282095 + 0 * x,
        0.488603 * y,
        0.488603 * z,
        0.488603 * x,
        1.092548 * x * y,
    ]
    written += [1.092548 * y * z, 0.315392 * (3 * z * z - 1), 1.092548 * x * z]
    written += [0.546274 * (x * x - y * y)]
    assert sh.evaluate(2, DIRECTIONS) == pytest.approx(np.stack(written, axis=-1), abs=2e-6)


@pytest.mark.parametrize("degree", range(sh.MAX_ORDER + 1))
def test_cosine_lobe_is_its_integral(degree):
    integral, _ = scipy.integrate.quad(
        lambda c: 2 * np.pi * c * scipy.special.eval_legendre(degree, c), 0, 1
    )
    assert sh.cosine_lobe(degree) == pytest.approx(integral, abs=1e-12)


@given(coefficients, quaternions, vectors)
def test_rotated_function_is_the_function_elsewhere(c, q, v):
    d = geometry.normalize(v)
    turned = sh.radiance(sh.rotate(c, q), geometry.rotate(q, d))
    assert turned == pytest.approx(sh.radiance(c, d), abs=1e-11)


@given(coefficients, quaternions)
def test_rotation_keeps_the_power_of_every_band(c, q):
    turned = sh.rotate(c, q)
    for degree in range(sh.MAX_ORDER + 1):
        band = slice(degree**2, (degree + 1) ** 2)
        assert np.linalg.norm(turned[band]) == pytest.approx(np.linalg.norm(c[band]), abs=1e-11)


@given(hnp.arrays(np.float64, (25, 3), elements=finite))
def test_projection_gives_the_coefficients_back(c):
    """Pixels are not quadrature nodes, so to the grid's resolution only."""
    image = sh.radiance(c, geometry.equirect_directions(128, 64))
    assert sh.project(image, 4) == pytest.approx(c, abs=2e-3 * max(1, np.abs(c).max()))


def test_projection_does_not_depend_on_the_block_of_rows():
    image = np.random.default_rng(1).random((96, 192, 3))
    basis = sh.evaluate(8, geometry.equirect_directions(192, 96))
    weight = geometry.equirect_solid_angles(192, 96)[:, None, None]
    whole = np.tensordot(basis * weight, image, axes=((0, 1), (0, 1)))
    assert sh.project(image, 8) == pytest.approx(whole, abs=1e-12)


@pytest.mark.parametrize("radius_deg", [0.25, 7.5, 60])
def test_disc_lamp_is_its_integral(radius_deg):
    """Against a picture of the disc at the zenith, where rows follow its rim."""
    height = 1440
    edge = round(radius_deg / 180 * height)
    image = np.zeros((height, 8, 1))
    image[:edge] = 1 / geometry.cap_solid_angle_sr(180 * edge / height)
    expected = sh.project(image, 4)[:, 0]
    got = sh.lamp([0, 1, 0], 4, 180 * edge / height)
    assert got == pytest.approx(expected, abs=1e-5)


def test_point_lamp_is_the_limit_of_a_disc():
    d = DIRECTIONS[0]
    assert sh.lamp(d, 8, 1e-4) == pytest.approx(sh.lamp(d, 8), abs=1e-9)


def test_unit_lamp_at_order_two_as_published():
    """1.0625 facing it, +0.06 behind it: the known ringing of a lamp left in the SH."""
    c = sh.lamp([0, 1, 0], 2)
    facing, behind = sh.irradiance(c, [[0, 1, 0], [0, -1, 0]])
    assert facing == pytest.approx(1.0625, abs=1e-9)
    assert behind == pytest.approx(0.0625, abs=1e-9)


def test_white_furnace():
    c = sh.project(np.full((32, 64, 3), 2.0), 3)
    assert sh.irradiance(c, DIRECTIONS) == pytest.approx(2 * np.pi, rel=1e-3)


@pytest.mark.parametrize("kind", ["hann", "lanczos"])
def test_window_damps_and_keeps_the_mean(kind):
    c = np.ones((9, 3))
    damped = sh.window(c, kind)
    assert damped[0] == pytest.approx(1)
    assert np.all(np.diff(damped[[0, 1, 4], 0]) < 0)
    rings = sh.lamp([0, 0, 1], 4)
    least = sh.radiance(rings, DIRECTIONS).min()
    assert sh.radiance(sh.window(rings, kind), DIRECTIONS).min() > 0.4 * least


@pytest.mark.parametrize("length", [0, 2, 8, 10])
def test_lengths_that_are_no_order(length):
    with pytest.raises(ValueError, match="coefficients"):
        sh.order_of(np.zeros((length, 3)))


def test_order_out_of_range():
    with pytest.raises(ValueError, match="order 9"):
        sh.evaluate(9, [0, 0, 1])
