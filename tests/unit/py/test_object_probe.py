"""Lights of a cube, what an object hides of them, and how they are found."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe.bake import visibility
from lightprobe.errors import UsageError
from lightprobe.geometry import fibonacci_sphere
from lightprobe.probe import cube, object_samples, shadow_maps

number = st.floats(-1, 1)


@given(st.tuples(number, number, number).filter(lambda d: np.linalg.norm(d) > 1e-3))
def test_a_direction_is_in_the_texel_that_is_nearest_to_it(direction):
    unit = np.array([direction]) / np.linalg.norm(direction)
    texels, _ = cube.texels()
    near_deg = np.degrees(np.arccos(np.clip(texels @ unit[0], -1, 1)))
    # Along a texel's diagonal another middle may be a little nearer.
    assert near_deg[cube.nearest(unit)[0]] < near_deg.min() + 3


def test_texels_cover_the_sphere_once_and_are_opposite_in_pairs():
    directions, sr = cube.texels()
    assert sr.sum() == pytest.approx(4 * np.pi)
    assert np.allclose(directions[:192], -directions[192:])
    assert (cube.nearest(directions) == np.arange(384)).all()
    fine = cube.nearest(cube.texels(16)[0])
    assert (np.bincount(fine) == 4).all()


def test_neighbours_share_an_edge_and_a_side_of_the_horizon():
    directions, _ = cube.texels()
    pairs = cube.neighbours()
    assert len(pairs) == 384 * 2 - 32
    apart = np.degrees(np.arccos(np.sum(directions[pairs[:, 0]] * directions[pairs[:, 1]], axis=1)))
    assert apart.max() < 15
    assert np.all(directions[pairs[:, 0], 1] * directions[pairs[:, 1], 1] > 0)


def prior():
    return cube.Prior(0.5, np.ones((384, 3)), np.full(384, 1e-2))


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 1000))
def test_light_is_never_negative_and_found_where_it_is_seen(seed):
    random = np.random.default_rng(seed)
    light = np.full((384, 3), 0.5)
    light[random.integers(0, 384, 5)] += 20.0
    made = np.maximum(random.normal(size=(600, 3)) @ cube.texels()[0].T, 0) / 100
    made += random.uniform(0, 0.01, made.shape)
    found = cube.solve(made.T @ made * 1e6, made.T @ (made @ light) * 1e6, prior())
    assert found.min() >= 0
    assert np.abs(made @ (found - light)).max() < 0.02 * (made @ light).max()


def test_what_nothing_tells_is_expected_and_its_covariance_wide():
    gram = np.zeros((384, 384))
    gram[0, 0] = 1e4  # below the horizon
    above = int(cube.texels()[0][:, 1].argmax())
    found = cube.solve(gram, np.zeros((384, 3)), prior())
    assert np.allclose(found[above], 1, atol=0.1)
    spread = cube.covariance(gram, found, prior())
    assert spread[0, 0] < 1.1e-4 < spread[above, above]


def box():
    s = np.array([[x, y, z] for x in (-1, 1) for y in (0, 2) for z in (-1, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return s, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def test_shadow_maps_are_near_what_exact_rays_say():
    vertices, triangles = box()
    which, share = shadow_maps.strewn(vertices, triangles, shadow_maps.POINTS)
    assert share.min() >= 0
    assert np.allclose(share.sum(axis=1), 1)
    surface = np.einsum("nk,nki->ni", share, vertices[triangles[which]])
    x, z = (part.ravel() for part in np.meshgrid(np.arange(-4, 4, 0.21), np.arange(-4, 4, 0.21)))
    beside = (np.abs(x) > 1.05) | (np.abs(z) > 1.05)
    places = np.stack([x, 0 * x, z], axis=1)[beside]
    up = np.tile([0.0, 1.0, 0.0], (len(places), 1))
    towards = fibonacci_sphere(60)
    towards = towards[towards[:, 1] > 0.2]
    maps = shadow_maps.seen(surface, places, up, towards, np.ones(len(places), bool))
    exact = visibility.visible(vertices, triangles, towards, points=places)[: len(towards)]
    assert 0 <= maps.min() < 0.01 < 0.99 < maps.max() <= 1
    assert np.abs(maps - exact).mean() < 0.03
    assert maps.mean() == pytest.approx(exact.mean(), abs=0.02)


@given(st.text(max_size=40))
def test_any_text_is_an_object_or_refused(text):
    try:
        shape = object_samples.parse(f"object:{text}")
    except UsageError:
        return
    assert shape.unit_mm > 0
    assert shape.albedo is None or 0 < shape.albedo <= 1
