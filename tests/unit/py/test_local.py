"""lightprobe.local: the ground by a camera's picture, against a ground that is known everywhere."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe import geometry, local, reflection_map
from lightprobe.estimate import Estimate, EstimateFlag, SphericalHarmonics
from lightprobe.local import ArCamera, LocalError
from lightprobe.reflection_map import ReflectionMap

WIDTH_PX, HEIGHT_PX = 640, 480
MATRIX = np.array([[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]])
HEIGHT_M = 0.7  # of the table


def table(x, z):
    """Radiance (…, 3) of the table at places in metres: smooth, of all colours."""
    waves = [0.5 + 0.3 * np.sin(9 * x + k) * np.cos(7 * z - 2 * k) for k in range(3)]
    return np.stack(waves, axis=-1)


def camera_at(place_m, target_m):
    """Looks from a place to another, upright."""
    place = np.asarray(place_m, float)
    forward = geometry.normalize(np.asarray(target_m, float) - place)
    right = geometry.normalize(np.cross(forward, [0, 1, 0.01]))
    return ArCamera(MATRIX, np.column_stack([right, np.cross(forward, right), forward]), place)


def picture_of(camera):
    """What it sees: a table without an end, and black above the horizon."""
    x, y = np.meshgrid(np.arange(WIDTH_PX) + 0.5, np.arange(HEIGHT_PX) + 0.5)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(MATRIX).T @ camera.rotation.T
    down = rays[..., 1] < -1e-3
    along = np.where(down, (camera.place_m[1] - HEIGHT_M) / np.where(down, -rays[..., 1], 1), 0)
    met = camera.place_m + along[..., None] * rays
    return np.where(down[..., None], table(met[..., 0], met[..., 2]), 0.0)


def map_of(level, size=16):
    """Everything around of one radiance."""
    faces = np.full((6, size, size, 3), level, np.float32)
    return ReflectionMap(1, 1, 0, 1, "TOTAL", faces)


def seen_from(azimuth_deg=30.0, elevation_deg=40.0, distance_m=0.9, centre=(0.1, HEIGHT_M, -0.2)):
    away = geometry.direction_from_angles(azimuth_deg, elevation_deg)
    camera = camera_at(np.asarray(centre) + distance_m * away, centre)
    return camera, picture_of(camera)


@settings(max_examples=30, deadline=None)
@given(
    azimuth=st.floats(-180, 180), elevation=st.floats(25, 89), distance=st.floats(0.5, 2.0),
    side=st.floats(0.1, 0.4),
)  # fmt: skip
def test_the_ground_is_as_it_is_from_anywhere(azimuth, elevation, distance, side):
    camera, picture = seen_from(azimuth, elevation, distance)
    ground = local.sample(picture, camera, [0.1, HEIGHT_M, -0.2], side, size=24)
    place = ((np.arange(24) + 0.5) / 24 - 0.5) * side
    x, z = np.meshgrid(0.1 + place, -0.2 + place)
    assert ground.seen.mean() > 0.3
    assert np.abs(ground.radiance - table(x, z))[ground.seen].max() < 0.01


def test_texels_are_means_over_their_area():
    """A board finer than a texel is grey, not a pattern of its own."""
    camera = camera_at([0, 0.5 + HEIGHT_M, 0], [0, HEIGHT_M, 0])
    picture = np.indices((HEIGHT_PX, WIDTH_PX)).sum(axis=0)[..., None] % 2 * np.ones(3)
    ground = local.sample(picture, camera, [0, HEIGHT_M, 0], 0.3, size=16)
    assert ground.radiance == pytest.approx(0.5, abs=0.1)


def test_rays_that_meet_the_ground_take_its_light():
    camera, picture = seen_from()
    centre = np.array([0.1, HEIGHT_M, -0.2])
    ground = local.sample(picture, camera, centre, 0.5, size=96)
    foot = centre + np.random.default_rng(1).uniform(-0.15, 0.15, (200, 3)) * [1, 0, 1]
    point = centre + np.array([0.02, 0.1, 0.03])
    light = local.radiance(ground, map_of(9.0), point, geometry.normalize(foot - point))
    assert np.abs(light - table(foot[:, 0], foot[:, 2])).max() < 0.01


def test_other_rays_take_the_map_and_nothing_jumps_in_between():
    camera, picture = seen_from(distance_m=1.2)
    centre = np.array([0.1, HEIGHT_M, -0.2])
    ground = local.sample(picture, camera, centre, 0.3)
    point = np.add(centre, [0, 0.1, 0])
    angles = np.radians(np.linspace(0, 180, 4000))  # from straight down to straight up
    rays = np.stack([np.sin(angles), -np.cos(angles), 0 * angles], axis=-1)
    light = local.radiance(ground, map_of(3.0), point, rays)
    beside = np.tan(angles) * 0.1 > 0.15
    assert light[beside | (angles > np.pi / 2)] == pytest.approx(3.0)
    assert np.abs(light[0] - table(0.1, -0.2)).max() < 0.01
    assert np.abs(np.diff(light, axis=0)).max() < 0.05


def test_what_the_camera_does_not_see_is_the_map():
    camera = camera_at([0.1, 0.5 + HEIGHT_M, -0.2], [0.5, HEIGHT_M, -0.2])  # the left is cut off
    centre = np.array([0.1, HEIGHT_M, -0.2])
    ground = local.sample(picture_of(camera), camera, centre, 0.8)
    assert 0.3 < ground.seen.mean() < 0.9
    hidden = np.add(centre, [-0.3, 0, 0])
    point = np.add(centre, [0, 0.1, 0])
    ray = geometry.normalize(hidden - point)
    assert local.radiance(ground, map_of(3.0), point, ray) == pytest.approx(3.0)


@given(factor=st.floats(1e-6, 1e6))
@settings(max_examples=20, deadline=None)
def test_light_comes_in_the_probes_units_whatever_the_cameras(factor):
    camera, picture = seen_from(elevation_deg=70)
    ground = local.sample(factor * picture, camera, [0.1, HEIGHT_M, -0.2], 0.3, size=16)
    by_map = local.by_reflection_map(ground, map_of(2.5), [0.1, HEIGHT_M + 0.3, -0.2])
    assert by_map.radiance.mean() == pytest.approx(2.5, rel=0.02)
    assert by_map.radiance / by_map.radiance.mean() == pytest.approx(
        ground.radiance / ground.radiance.mean()
    )


def test_by_albedo_the_ground_gives_its_share_of_the_light():
    even = SphericalHarmonics("AMBIENT", 0, np.full((1, 3), np.sqrt(4 * np.pi)))  # radiance 1
    estimate = Estimate(1, 1, 0, 0, 0, EstimateFlag(0), (), even, None, None, 1, None)
    camera, picture = seen_from(elevation_deg=70)
    ground = local.sample(picture, camera, [0.1, HEIGHT_M, -0.2], 0.3, size=16)
    light = local.by_albedo(ground, estimate, 0.4).mean().mean()
    assert light == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("place", "target"),
    [
        ([0, 2, 0], [0, 3, 0]),  # looks away
        ([0, 0.2, 0.5], [0, HEIGHT_M, 0]),  # from below
    ],
)
def test_a_picture_without_the_ground_says_what_to_do(place, target):
    camera = camera_at(place, target)
    with pytest.raises(LocalError, match="point the camera at the object's foot"):
        local.sample(np.ones((HEIGHT_PX, WIDTH_PX, 3)), camera, [0, HEIGHT_M, 0], 0.3)


def test_black_ground_and_a_probe_below_it_are_named():
    camera, picture = seen_from()
    ground = local.sample(picture, camera, [0.1, HEIGHT_M, -0.2], 0.3, size=8)
    with pytest.raises(LocalError, match="not above the ground"):
        local.by_reflection_map(ground, map_of(1.0), [0, 0, 0])
    with pytest.raises(LocalError, match="black"):
        local.by_reflection_map(ground.scaled(0), map_of(1.0), [0, 2, 0])


def test_scale_and_ground_agree_with_a_map_that_shows_the_same_table():
    """As the probe beside the object sees it, its own texels coarse towards the horizon."""
    camera, picture = seen_from(elevation_deg=80)
    probe_m = np.array([0.25, HEIGHT_M + 0.2, -0.1])
    towards = reflection_map.directions(64)
    along = 0.2 / np.maximum(-towards[..., 1], 0.02)
    met = probe_m + along[..., None] * towards
    around = map_of(0.0, 64)
    around.radiance[...] = table(met[..., 0], met[..., 2])
    ground = local.sample(7 * picture, camera, [0.1, HEIGHT_M, -0.2], 0.4, size=32)
    found = local.by_reflection_map(ground, around, probe_m)
    assert found.radiance[ground.seen] == pytest.approx(ground.radiance[ground.seen] / 7, rel=0.03)


def test_where_everything_is_alike_everything_stays_alike():
    """At the border of the square, and at the picture's, too."""
    camera = camera_at([0.1, 0.5 + HEIGHT_M, -0.2], [0.5, HEIGHT_M, -0.2])  # the left is cut off
    centre = np.array([0.1, HEIGHT_M, -0.2])
    ground = local.sample(np.ones((HEIGHT_PX, WIDTH_PX, 3)), camera, centre, 0.8)
    assert 0.3 < ground.seen.mean() < 0.9
    scaled = local.by_reflection_map(ground, map_of(2.5), np.add(centre, [0, 0.3, 0]))
    light = local.radiance(
        scaled, map_of(2.5), np.add(centre, [0, 0.1, 0]), geometry.sphere_normals(4)
    )
    assert light == pytest.approx(2.5, rel=1e-5)
