"""Directions, solid angles, rotations and matching."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from lightprobe import geometry

finite = st.floats(-1, 1, allow_nan=False)
vectors = hnp.arrays(np.float64, 3, elements=finite).filter(lambda v: np.linalg.norm(v) > 0.05)
quaternions = hnp.arrays(np.float64, 4, elements=finite).filter(lambda q: np.linalg.norm(q) > 0.05)


def test_axes_of_the_equirectangular_image():
    width, height = 64, 32
    look = lambda c, r: geometry.equirect_direction(c, r, width, height)  # noqa: E731
    middle = (width - 1) / 2, (height - 1) / 2
    assert look(*middle) == pytest.approx([0, 0, -1], abs=1e-12)
    assert look(middle[0] + width / 4, middle[1]) == pytest.approx([1, 0, 0], abs=1e-12)
    assert look(0, -0.5) == pytest.approx([0, 1, 0], abs=1e-12)


def test_pixels_cover_the_sphere_exactly():
    assert geometry.equirect_solid_angles(100, 50).sum() * 100 == pytest.approx(
        4 * np.pi, rel=1e-14
    )


@given(vectors)
def test_direction_pixel_and_back(v):
    d = geometry.normalize(v)
    column, row = geometry.equirect_pixel(d, 640, 320)
    again = geometry.equirect_direction(column, row, 640, 320)
    assert geometry.angle_deg(d, again) < 1e-9


@given(vectors)
def test_angles_and_back(v):
    d = geometry.normalize(v)
    again = geometry.direction_from_angles(*geometry.angles_from_direction(d))
    assert geometry.angle_deg(d, again) < 1e-9


@given(st.floats(1e-6, 180))
def test_cap_radius_and_back(radius_deg):
    again = geometry.cap_radius_deg(geometry.cap_solid_angle_sr(radius_deg))
    assert again == pytest.approx(radius_deg, rel=1e-6)


def test_tiny_angles_are_not_lost():
    a = np.array([0, 0, -1.0])
    b = geometry.rotate(geometry.quaternion([0, 1, 0], 1e-7), a)
    assert geometry.angle_deg(a, b) == pytest.approx(1e-7, rel=1e-6)


@given(st.lists(quaternions, min_size=2, max_size=4), quaternions, vectors)
def test_many_rotations_at_once_are_as_one_by_one(many, q, v):
    matrices = geometry.rotation_matrix(geometry.turn_after(np.array(many), q))
    for matrix, one in zip(matrices, many, strict=True):
        assert matrix @ v == pytest.approx(geometry.rotate(one, geometry.rotate(q, v)), abs=1e-12)


@given(quaternions, vectors)
def test_rotation_keeps_lengths_and_undoes(q, v):
    turned = geometry.rotate(q, v)
    assert np.linalg.norm(turned) == pytest.approx(np.linalg.norm(v), rel=1e-12)
    assert geometry.rotate(geometry.inverse(q), turned) == pytest.approx(v, abs=1e-12)


def test_quaternion_turns_right_handed():
    up_90 = geometry.quaternion([0, 1, 0], 90)
    assert geometry.rotate(up_90, [0, 0, -1]) == pytest.approx([-1, 0, 0], abs=1e-12)


@pytest.mark.parametrize("bad", [[0, 0, 0, 0], [1, 0, 0], [np.nan, 0, 0, 0]])
def test_no_rotation(bad):
    with pytest.raises(ValueError, match="no rotation"):
        geometry.rotation_matrix(bad)


def test_a_number_is_no_rotation():
    with pytest.raises(ValueError, match="no rotation"):
        geometry.inverse(45)


def test_sphere_normals_are_even():
    normals = geometry.sphere_normals()
    assert normals.shape == (642, 3)
    assert normals.mean(axis=0) == pytest.approx([0, 0, 0], abs=1e-12)
    assert (normals.T @ normals / 642) == pytest.approx(np.eye(3) / 3, abs=1e-12)


@given(
    hnp.arrays(np.float64, (4, 3), elements=finite),
    hnp.arrays(np.float64, (3, 3), elements=finite),
)
def test_matching_is_the_best_of_all(a, b):
    """Against all ways of pairing, tried one by one."""
    if min(np.linalg.norm(a, axis=1).min(), np.linalg.norm(b, axis=1).min()) < 0.05:
        return
    a, b, limit = geometry.normalize(a), geometry.normalize(b), 40.0
    cost = geometry.angle_deg(a[:, None], b[None])
    pairs = geometry.match_directions(a, b, limit)
    got = sum(angle for *_, angle in pairs) + limit * (len(a) - len(pairs))
    choices = itertools.product([None, 0, 1, 2], repeat=4)
    best = min(
        sum(limit if j is None or cost[i, j] > limit else cost[i, j] for i, j in enumerate(choice))
        for choice in choices
        if len(used := [j for j in choice if j is not None]) == len(set(used))
    )
    assert got == pytest.approx(best, abs=1e-9)


def test_matching_leaves_the_distant_alone():
    true = [[0, 0, -1], [1, 0, 0]]
    pairs = geometry.match_directions(true, [[0, 1, 0], [0.01, 0, -1]])
    assert [(i, j) for i, j, _ in pairs] == [(0, 1)]
    assert geometry.match_directions([], [[0, 1, 0]]) == []
