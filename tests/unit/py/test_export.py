"""What `lightprobe export` writes: the same light as the estimate's, read by other libraries."""

import json
import struct

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe import geometry, reflection_map, sh
from lightprobe.estimate import Estimate, EstimateFlag, Light, SphericalHarmonics
from lightprobe.imaging import cube, gltf, image
from lightprobe.imaging.environment import environment_map
from lightprobe.imaging.image_based_light import rgbd
from lightprobe.reflection_map import ReflectionMap
from lightprobe.sim.scene import MapTruth

AMBIENT = np.array([[1.0, 1.2, 1.5], [0.3, 0.2, 0.4], [0.1, 0, 0], [0, 0.1, 0.2]])
LAMPS = (
    Light(4, geometry.direction_from_angles(30, 40), np.array([6.0, 5, 3]), 2.0),
    Light(9, geometry.direction_from_angles(-170, -5), np.array([1.0, 2, 4]), 0.01),
    Light(12, np.array([0.0, 1, 0]), np.array([0.5, 0.5, 0.5]), 5.0),
)


def estimate(kind="AMBIENT", lights=LAMPS, coefficients=AMBIENT, cd_m2_per_unit=None):
    order = round(len(coefficients) ** 0.5) - 1
    harmonics = SphericalHarmonics(kind, order, coefficients)
    return Estimate(1, 2, 3, 4, 500, EstimateFlag(0), lights, harmonics, 0.01, None, 1,
                    cd_m2_per_unit)  # fmt: skip


@pytest.mark.parametrize("width_px", [64, 512])
def test_a_map_lights_as_the_estimate_does(width_px):
    given_light = estimate()
    radiance, notes = environment_map(given_light, width_px)
    assert radiance.shape == (width_px // 2, width_px, 3)
    assert notes == []
    normals = geometry.sphere_normals()
    from_map = MapTruth(radiance).irradiance(normals)
    true = given_light.irradiance(normals)
    # The estimate's lamps are points; discs set softly, the more so where a pixel is large.
    assert np.abs(from_map - true).max() < (0.05 if width_px == 64 else 0.01) * true.max()


def test_a_tiny_lamp_is_where_it_is_in_a_coarse_map():
    lamp = Light(1, geometry.direction_from_angles(31.7, 12.3), np.ones(3), 0.01)
    dark = np.zeros((1, 3))
    radiance, _ = environment_map(estimate(lights=(lamp,), coefficients=dark), 256)
    weight = radiance[..., 1] * geometry.equirect_solid_angles(256, 128)[:, None]
    assert weight.sum() == pytest.approx(1, rel=1e-4)
    centre = (weight[..., None] * geometry.equirect_directions(256, 128)).sum(axis=(0, 1))
    assert geometry.angle_deg(centre, lamp.direction) < 0.1  # a pixel: 1.4°


def test_lamps_of_a_total_are_not_added_again():
    given_light = estimate()
    total = estimate("TOTAL", LAMPS, given_light.total().coefficients)
    radiance, _ = environment_map(total, 128)
    alone, _ = environment_map(estimate("TOTAL", (), given_light.total().coefficients), 128)
    assert np.array_equal(radiance, alone)


def bright_patch(towards, radius_deg):
    """SH of order 4 of a bright disc in a dim room: below zero in many directions."""
    patch = sh.lamp(towards, 4, radius_deg)[:, None] * np.array([3.0, 2, 1])
    patch[0] += 0.3
    return patch


def most_off(radiance, given_light):
    """Largest error of irradiance, relative to the largest one."""
    normals = geometry.sphere_normals()
    true = given_light.irradiance(normals)
    return np.abs(MapTruth(radiance).irradiance(normals) - true).max() / true.max()


def test_sh_below_zero_light_as_they_should():
    given_light = estimate(lights=(), coefficients=bright_patch([0.6, 0, 0.8], 20))
    directions = geometry.equirect_directions(256, 128)
    swinging = sh.radiance(given_light.sh.coefficients, directions)
    clipped = most_off(np.float32(np.maximum(swinging, 0)), given_light)
    radiance, notes = environment_map(given_light, 256)
    assert radiance.min() == 0
    assert notes == []
    # What is left is of bands above order 4, which the SH do not tell.
    assert most_off(radiance, given_light) < min(0.02, clipped / 3)


def test_sh_that_no_light_has_are_noted():
    swinging = np.array([[1.0] * 3, [0] * 3, [2.5] * 3, [0] * 3])
    radiance, (note,) = environment_map(estimate(lights=(), coefficients=swinging), 64)
    assert radiance.min() == 0
    assert "no light has these SH: irradiance is off by up to" in note


WINDOW = Light(3, np.array([1.0, 0, 0]), np.array([2.0, 2, 2]), 20.0,
               half_angle_deg=(32.0, 13.0), axis=np.array([0.0, 0, 1]))  # fmt: skip


def test_an_area_light_is_an_ellipse_and_its_light_is_not_lost():
    """What the packet takes out of AMBIENT is a point; the picture has the same light."""
    total = sh.lamp(WINDOW.direction, 4, 20.0)[:, None] * WINDOW.irradiance
    total[0] += 0.8
    ambient = total - sh.lamp(WINDOW.direction, 4)[:, None] * WINDOW.irradiance
    given_light = estimate(lights=(WINDOW,), coefficients=ambient)
    radiance, notes = environment_map(given_light, 256)
    assert notes == []

    def along(azimuth_deg, elevation_deg):
        towards = geometry.direction_from_angles(azimuth_deg, elevation_deg)
        column, row = geometry.equirect_pixel(towards, 256, 128)
        return radiance[int(row), int(column)].mean()

    assert along(90 + 28, 0) > 5 * along(90, 28)  # 32° to the sides, 13° up and down
    assert along(90, 10) > 5 * along(90, 16)
    expected = estimate("TOTAL", (), total)
    assert most_off(radiance, expected) < 0.02
    faces, _ = cube.cube_map(given_light, 64)
    wanted = expected.irradiance(geometry.sphere_normals())
    found = ReflectionMap(1, 2, 3, 4, "TOTAL", faces).irradiance(geometry.sphere_normals())
    assert np.abs(found - wanted).max() < 0.03 * wanted.max()


@pytest.mark.parametrize("suffix", [".hdr", ".exr", ".pfm"])
def test_files_are_read_back(suffix, tmp_path):
    radiance, _ = environment_map(estimate(), 128)
    path = tmp_path / f"x{suffix}"
    path.write_bytes(image.encode(suffix, radiance))
    back = image.read(path).radiance
    limit = {".hdr": 0.02, ".exr": 1e-3, ".pfm": 0}[suffix]  # .hdr: 8 bits, one exponent
    assert np.all(np.abs(back - radiance) <= limit * radiance.max(axis=2, keepdims=True))
    if suffix == ".hdr":  # and by a library that is not ours
        assert cv2.imread(str(path), cv2.IMREAD_UNCHANGED).shape == radiance.shape


def test_a_sun_is_not_cut_off_in_an_exr(tmp_path):
    sun = np.full((8, 16, 3), 1e6, np.float32)
    path = tmp_path / "sun.exr"
    path.write_bytes(image.encode(".exr", sun))
    assert image.read(path).radiance == pytest.approx(sun)


def parse_glb(data):
    """Document and buffer, from chunks as the specification lays them out."""
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    assert size % 4 == 0
    document, rest = json.loads(data[20 : 20 + size]), data[20 + size :]
    size, kind = struct.unpack_from("<I4s", rest)
    assert (size, kind) == (len(rest) - 8, b"BIN\0")
    assert document["buffers"] == [{"byteLength": size}]
    return document, rest[8:]


def glb(given):
    return parse_glb(gltf.glb(given, cube.cube_map(given, 32, lamps=False)[0]))


def turn(rotation, vector):
    """Vector turned by a quaternion x, y, z, w."""
    q, w = np.array(rotation[:3]), rotation[3]
    return vector + 2 * np.cross(q, np.cross(q, vector) + w * vector)


@settings(max_examples=20)
@given(st.floats(-180, 180), st.floats(-90, 90))
def test_lamps_of_a_glb_shine_along_minus_z_of_their_nodes(azimuth_deg, elevation_deg):
    direction = geometry.direction_from_angles(azimuth_deg, elevation_deg)
    lamp = Light(3, direction, np.array([8.0, 4, 2]), 1.0)
    document, _ = glb(estimate(lights=(lamp,), cd_m2_per_unit=2.5))
    (light,) = document["extensions"]["KHR_lights_punctual"]["lights"]
    assert (light["type"], light["color"], light["intensity"]) == (
        "directional",
        [1, 0.5, 0.25],
        20,
    )
    (node,) = document["nodes"]
    assert node["extensions"]["KHR_lights_punctual"]["light"] == 0
    travel = turn(node["rotation"], np.array([0, 0, -1.0]))
    assert travel == pytest.approx(-direction, abs=1e-6)
    assert np.linalg.norm(node["rotation"]) == pytest.approx(1)


def test_a_light_straight_behind_has_a_rotation_too():
    lamp = Light(3, np.array([0.0, 0, -1]), np.ones(3), 1.0)
    node = glb(estimate(lights=(lamp,)))[0]["nodes"][0]
    assert turn(node["rotation"], np.array([0, 0, -1.0])) == pytest.approx([0, 0, 1])


def test_a_glb_without_lamps_has_no_empty_lists():
    document, _ = glb(estimate(lights=()))
    assert "nodes" not in document
    assert "nodes" not in document["scenes"][0]
    assert document["extensionsUsed"] == ["EXT_lights_image_based"]
    assert document["scenes"][0]["extras"]["lightprobe"]["sh"]["order"] == 1


@pytest.mark.parametrize("cd_m2_per_unit", [None, 1000.0])
def test_the_environment_of_a_glb(cd_m2_per_unit):
    """Irradiance and the sharpest images are the estimate's; Babylon.js itself: tests/engines."""
    given_light = estimate(cd_m2_per_unit=cd_m2_per_unit)
    document, data = glb(given_light)
    (light,) = document["extensions"]["EXT_lights_image_based"]["lights"]
    assert document["scenes"][0]["extensions"] == {"EXT_lights_image_based": {"light": 0}}
    assert light["intensity"] == (1 if cd_m2_per_unit is None else 4)  # RGBD holds up to 255
    scale = (cd_m2_per_unit or 1) / light["intensity"]
    mean = np.array(light["irradianceCoefficients"][0])
    assert mean == pytest.approx(scale * np.pi * AMBIENT[0])
    assert np.shape(light["irradianceCoefficients"]) == (9, 3)
    assert np.shape(light["specularImages"]) == (2, 6)
    faces = []
    for index in light["specularImages"][0]:
        view = document["bufferViews"][document["images"][index]["bufferView"]]
        png = data[view["byteOffset"] :][: view["byteLength"]]
        pixels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
        rgba = cv2.cvtColor(pixels, cv2.COLOR_BGRA2RGBA) / 255
        assert rgba.shape == (light["specularImageSize"],) * 2 + (4,)
        faces.append(rgba[..., :3] ** 2.2 / rgba[..., 3:])
    shown = np.array(faces).mean(axis=(0, 1, 2))
    true = scale * cube.cube_map(given_light, 32, lamps=False)[0].mean(axis=(0, 1, 2))
    assert shown == pytest.approx(true, rel=0.01)


@given(st.floats(0.02, 255), st.floats(0, 1))
def test_rgbd_holds_two_digits(largest, share):
    radiance = np.float32([[largest, share * largest, 0]])
    rgba = rgbd(radiance) / 255
    off = np.abs(rgba[:, :3] ** 2.2 / rgba[:, 3:] - radiance)
    assert off.max() < 0.02 * largest


@pytest.mark.parametrize("size", [16, 64])
def test_a_cube_lights_as_the_estimate_does(size):
    given_light = estimate()
    radiance, notes = cube.cube_map(given_light, size)
    assert notes == []
    normals = geometry.sphere_normals()
    true = given_light.irradiance(normals)
    lit = ReflectionMap(1, 2, 3, 4, "TOTAL", radiance).irradiance(normals)
    assert np.abs(lit - true).max() < (0.05 if size == 16 else 0.01) * true.max()


def test_a_cross_is_seen_from_inside():
    size = 8
    picture = cube.cross(reflection_map.directions(size).astype(np.float32))
    assert picture.shape == (3 * size, 4 * size, 3)
    middle = {"left": (1, 0), "front": (1, 1), "right": (1, 2), "back": (1, 3), "top": (0, 1)}
    for name, (row, column) in middle.items():
        face = picture[row * size : (row + 1) * size, column * size : (column + 1) * size]
        towards = {"left": (-1, 0, 0), "front": (0, 0, -1), "right": (1, 0, 0), "back": (0, 0, 1),
                   "top": (0, 1, 0)}[name]  # fmt: skip
        assert geometry.angle_deg(face.mean(axis=(0, 1)), towards) < 1, name
    step = geometry.angle_deg(picture[1:, size : 2 * size], picture[:-1, size : 2 * size])
    assert step.max() < 15  # no jump from top to front to bottom; a texel has up to 14°
    step = geometry.angle_deg(picture[size : 2 * size, 1:], picture[size : 2 * size, :-1])
    assert step.max() < 15
    assert not picture[0, 0].any()


def test_rough_mirrors_by_sampling_the_lobe():
    """The levels against half vectors drawn from GGX (Walter et al. 2007, (35))."""
    size, levels = 64, 3
    towards = reflection_map.directions(size)
    bright = np.float32(np.exp(6 * (towards @ geometry.direction_from_angles(20, 30) - 1)))
    faces = np.repeat(bright[..., None], 3, axis=-1)
    rng = np.random.default_rng(1)
    u, turn = rng.uniform(size=(2, 400_000))
    for level, roughness in ((1, 0.5), (2, 1.0)):
        blurred = cube.ggx_levels(faces, levels)[level]
        assert blurred.shape == (6, size >> level, size >> level, 3)
        for face, row, column in ((5, 3, 4), (0, 8, 1), (3, 15, 15)):
            normal = reflection_map.directions(size >> level)[face, row, column]
            cosine = np.sqrt((1 - u) / (1 + (roughness**4 - 1) * u))
            sine, across = np.sqrt(1 - cosine**2), np.cross(normal, [0.6, 0, 0.8])
            across /= np.linalg.norm(across)
            local = np.stack([sine * np.cos(2 * np.pi * turn), sine * np.sin(2 * np.pi * turn)])
            half = np.outer(cosine, normal) + local.T @ [across, np.cross(normal, across)]
            light = 2 * cosine[:, None] * half - normal
            weight = np.maximum(light @ normal, 0)
            radiance = np.exp(6 * (light @ geometry.direction_from_angles(20, 30) - 1))
            expected = (weight * radiance).sum() / weight.sum()
            assert blurred[face, row, column, 1] == pytest.approx(expected, rel=0.02)


def test_uniform_light_stays_as_it_is_when_blurred():
    for level in cube.ggx_levels(np.full((6, 32, 32, 3), 7, np.float32), 2):
        assert level == pytest.approx(7, rel=1e-4)
