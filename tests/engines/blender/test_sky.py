"""Pictures of the world: directions, energy, turns. Numbers alone, nothing is rendered."""

import numpy as np
import pytest
from bl_ext.user_default.lightprobe import axes, sky, suns
from lightprobe import geometry, reflection_map, sh
from lightprobe.estimate import SphericalHarmonics
from lightprobe.reflection_map import ReflectionMap
from lightprobe.wire import decode
from lightprobe_proto import lightprobe_pb2 as pb
from probes import packet

RNG = np.random.default_rng(11)
NORMALS = geometry.sphere_normals(1)


def irradiance(picture, normals):
    """Irradiance (n, 3) of a picture at normals (n, 3) of the probe frame."""
    height, width, _ = picture.radiance.shape
    flux = picture.radiance * geometry.equirect_solid_angles(width, height)[:, None, None]
    towards = axes.to_probe(sky.directions(width))
    cosines = np.maximum(normals @ towards.reshape(-1, 3).T, 0)
    return cosines @ flux.reshape(-1, 3)


def map_of(radiance):
    return ReflectionMap(1, 7, 0, 1, "TOTAL", radiance.astype(np.float32))


@pytest.mark.parametrize("size", reflection_map.SIZES)
def test_a_map_keeps_its_light_wherever_a_lamp_is(size):
    worst = 0.0
    for texel in RNG.integers(0, 6 * size * size, 40):
        radiance = np.zeros((6 * size * size, 3))
        radiance[texel] = (3, 2, 1)
        found = map_of(radiance.reshape(6, size, size, 3))
        wanted = found.irradiance(NORMALS)
        off = np.abs(irradiance(sky.from_map(found), NORMALS) - wanted).max() / wanted.max()
        worst = max(worst, off)
    print(f"map of {size} texels, one lit: irradiance at most {100 * worst:.2f} % off")
    assert worst < 0.32 / size  # its place may be off by a part of a texel


@pytest.mark.parametrize("size", reflection_map.SIZES)
def test_a_map_of_a_room_keeps_its_light(size):
    found = map_of(RNG.uniform(0, 2, (6, size, size, 3)))
    wanted = found.irradiance(NORMALS)
    off = np.abs(irradiance(sky.from_map(found), NORMALS) - wanted).max() / wanted.max()
    print(f"map of {size} texels: irradiance at most {100 * off:.3f} % off")
    assert off < 0.002


def test_a_picture_of_sh_has_their_irradiance():
    coefficients = np.vstack([np.full((1, 3), 2.0), RNG.uniform(-0.1, 0.1, (24, 3))])
    picture = sky.from_harmonics(SphericalHarmonics("AMBIENT", 4, coefficients))
    wanted = sh.irradiance(coefficients, NORMALS)
    assert np.abs(irradiance(picture, NORMALS) - wanted).max() < 2e-3 * wanted.max()


def test_lamps_turn_with_the_probe():
    turn = np.array([0.1, -0.7, 0.3, 0.6403]) / np.linalg.norm([0.1, -0.7, 0.3, 0.6403])
    message = packet(lamps=[(1, (0.6, 0.8, 0), (1, 1, 1), 1)])
    message.orientation.extend(turn.tolist())
    estimate = decode(pb.FromProbe(estimate=message).SerializeToString())
    (sun,) = suns.suns(estimate, steady=True)
    x, y, z = geometry.rotate((turn[3], *turn[:3]), np.array([0.6, 0.8, 0]))
    assert np.allclose(sun.direction, (x, -z, y), atol=1e-6)
    (still,) = suns.suns(estimate, steady=False)
    assert np.allclose(still.direction, (0.6, 0, 0.8), atol=1e-6)


def test_sh_that_no_light_has_are_reported():
    impossible = np.zeros((9, 3))
    impossible[0], impossible[2] = 1, 3  # brighter on one side than light can be
    picture = sky.from_harmonics(SphericalHarmonics("AMBIENT", 2, impossible))
    assert picture.radiance.min() >= 0
    assert np.isfinite(picture.radiance).all()
    assert picture.irradiance_error > 0.05


def test_a_black_world_is_black():
    picture = sky.from_harmonics(SphericalHarmonics("AMBIENT", 2, np.zeros((9, 3))))
    assert not picture.radiance.any()
