"""Reflection maps: the faces are OpenGL's, texels are RGB9E5, and the light is all there."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from lightprobe import geometry, reflection_map, wire
from lightprobe.reflection_map import SIZES, ReflectionMap
from lightprobe_proto import lightprobe_pb2 as pb

SH = pb.SphericalHarmonics


def uniform(size, rgb=(1.0, 2.0, 4.0)):
    radiance = np.broadcast_to(np.float32(rgb), (6, size, size, 3))
    return ReflectionMap(1, 2, 3, 4, "TOTAL", radiance)


@pytest.mark.parametrize("size", SIZES)
def test_texels_cover_the_sphere_once(size):
    assert reflection_map.solid_angles(size).sum() == pytest.approx(4 * math.pi)
    face, row, column = reflection_map.texels(reflection_map.directions(size), size)
    everywhere = np.indices((6, size, size))
    assert np.array_equal(np.stack([face, row, column]), everywhere)


# Where the first texel of the first row of each face looks, by OpenGL 4.6, table 8.19.
CORNERS = [(1, 1, 1), (-1, 1, -1), (-1, 1, -1), (-1, -1, 1), (-1, 1, 1), (1, 1, -1)]


def test_faces_are_those_of_opengl():
    first = reflection_map.directions(64)[:, 0, 0]
    assert (geometry.angle_deg(first, geometry.normalize(CORNERS)) < 1).all()
    axes = np.vstack([[sign * row for sign in (1, -1)] for row in np.eye(3)])
    assert np.array_equal(reflection_map.texels(axes, 32)[0], range(6))


@pytest.mark.parametrize("size", SIZES)
def test_uniform_light_lights_everything_alike(size):
    normals = geometry.sphere_normals(1)
    lit = uniform(size).irradiance(normals)
    assert lit == pytest.approx(np.broadcast_to(np.pi * np.array([1, 2, 4]), lit.shape), rel=0.01)


def test_environment_map_looks_where_the_faces_do():
    size = 32
    radiance = np.zeros((6, size, size, 3), np.float32)
    radiance[5] = 1  # -Z: forward, the centre of the picture
    radiance[2, :, :, 0] = 7  # +Y: row 0
    picture = ReflectionMap(1, 2, 3, 4, "TOTAL", radiance).environment_map(256)
    assert picture.shape == (128, 256, 3)
    assert (picture[64, 128] == 1).all()
    assert picture[0, 0, 0] == 7
    assert not picture[-1].any()


@given(st.lists(st.tuples(*[st.integers(0, 511)] * 3, st.integers(0, 31)), min_size=1))
def test_texels_decode_by_definition(texels):
    data = b"".join((r | g << 9 | b << 18 | e << 27).to_bytes(4, "little") for r, g, b, e in texels)
    values = reflection_map.decode_rgb9e5(data, 0.5)
    expected = [[0.5 * m * 2.0 ** (e - 24) for m in rgb] for *rgb, e in texels]
    assert np.array_equal(values, np.float32(expected))


def message(**fields):
    whole = pb.FromProbe()
    part = whole.reflection_map
    part.kind, part.size, part.scale = SH.TOTAL, 16, 0.25
    part.texels = bytes(4 * 6 * 16 * 16)
    for name, value in fields.items():
        setattr(part, name, value)
    return whole.SerializeToString()


def test_a_map_arrives():
    found = wire.decode(message(sequence=9, subscription=3))
    assert isinstance(found, ReflectionMap)
    assert (found.sequence, found.subscription, found.kind, found.size) == (
        9,
        3,
        "TOTAL",
        16,
    )
    assert found.orientation is None


@pytest.mark.parametrize(
    "fields",
    [
        {"size": 17}, {"size": 0}, {"size": 32}, {"texels": b"1234"}, {"kind": 0}, {"scale": 0},
        {"scale": math.nan}, {"scale": math.inf}, {"scale": -1},
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(fields):
    with pytest.raises(wire.WireError):
        wire.decode(message(**fields))


@pytest.mark.parametrize(
    "wrong",
    [
        {"reflection_map_size": 8}, {"reflection_map_size": 128}, {"reflection_map_rate_hz": 31},
        {"reflection_map_rate_hz": math.nan}, {"reflection_map_kind": "KEY"},
    ],
)  # fmt: skip
def test_wishes_are_checked(wrong):
    with pytest.raises(wire.SubscriptionError, match=next(iter(wrong))):
        wire.Subscription(**wrong)


def test_a_wish_travels():
    wish = wire.Subscription(reflection_map_size=32, reflection_map_rate_hz=2)
    sent = pb.FromClient.FromString(wire.encode_subscription(wish)[1:])
    assert sent.subscribe.reflection_map.size == 32
    assert sent.subscribe.reflection_map.rate_hz == 2
    assert sent.subscribe.reflection_map.kind == SH.TOTAL
    none = pb.FromClient.FromString(wire.encode_subscription(wire.Subscription())[1:])
    assert not none.subscribe.HasField("reflection_map")


@given(
    arrays(np.float64, (7, 3), elements=st.just(0.0) | st.floats(1e-6, 1e6)),
    st.floats(1e-12, 1e12),
)
def test_what_is_encoded_is_decoded(values, factor):
    """Each channel within half a step of its texel's exponent: 1/511 of the brightest channel."""
    radiance = values * factor
    texels, scale = reflection_map.encode_rgb9e5(radiance)
    found = reflection_map.decode_rgb9e5(texels, scale)
    # Below 2^-32 of the brightest texel there is no smaller exponent.
    step = np.maximum(radiance.max(axis=1), radiance.max() * 2.0**-31)
    assert (np.abs(found - radiance) <= 1.001 * step[:, None] / 511).all()
