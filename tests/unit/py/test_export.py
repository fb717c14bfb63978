"""What `lightprobe export` writes: the same light as the estimate's, read by other libraries."""

import json
import struct

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe import geometry
from lightprobe.estimate import Estimate, EstimateFlag, Light, SphericalHarmonics
from lightprobe.imaging import gltf, image
from lightprobe.imaging.environment import environment_map
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


def test_sh_below_zero_are_noted():
    swinging = np.array([[1.0] * 3, [0] * 3, [2.5] * 3, [0] * 3])
    radiance, (note,) = environment_map(estimate(lights=(), coefficients=swinging), 64)
    assert radiance.min() == 0
    assert "SH below zero set to 0: adds" in note


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
    """Chunks as the specification lays them out: header, then JSON alone."""
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    assert size == len(data) - 20
    assert size % 4 == 0
    return json.loads(data[20:])


def turn(rotation, vector):
    """Vector turned by a quaternion x, y, z, w."""
    q, w = np.array(rotation[:3]), rotation[3]
    return vector + 2 * np.cross(q, np.cross(q, vector) + w * vector)


@given(st.floats(-180, 180), st.floats(-90, 90))
def test_lamps_of_a_glb_shine_along_minus_z_of_their_nodes(azimuth_deg, elevation_deg):
    direction = geometry.direction_from_angles(azimuth_deg, elevation_deg)
    lamp = Light(3, direction, np.array([8.0, 4, 2]), 1.0)
    document = parse_glb(gltf.glb(estimate(lights=(lamp,), cd_m2_per_unit=2.5)))
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
    node = parse_glb(gltf.glb(estimate(lights=(lamp,))))["nodes"][0]
    assert turn(node["rotation"], np.array([0, 0, -1.0])) == pytest.approx([0, 0, 1])


def test_a_glb_without_lamps_has_no_empty_lists():
    document = parse_glb(gltf.glb(estimate(lights=())))
    assert set(document) == {"asset", "scene", "scenes"}
    assert "nodes" not in document["scenes"][0]
    assert document["scenes"][0]["extras"]["lightprobe"]["sh"]["order"] == 1
