"""At the edge of what may come: the cases of cases.py, and what holds for any input."""

import numpy as np
import pytest
from cases import CASES, SIZE_PX, constant, estimate_floats
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe import geometry, sh

IDS = [f"{case.name}: {case.error}" for case in CASES]


@pytest.mark.parametrize("case", CASES, ids=IDS)
def test_within_its_bound(case, tmp_path):
    result = case.measure(tmp_path)
    assert case.must <= result.flags
    assert result.error <= case.bound


@pytest.mark.parametrize("preset", ["balanced", "accurate"])
def test_many_suns_in_one_cell_are_one_lamp(tmp_path, preset):
    """64 pixels of the sun's strength in eight by eight, more than are remembered: their sum."""
    width, height = SIZE_PX
    omega = geometry.equirect_solid_angles(width, height)
    radiance = constant(1.0)
    radiance[200:208, 400:408] += 1e5
    estimate = estimate_floats(tmp_path, radiance, preset=preset)
    (light,) = estimate.lights
    true = 8 * 1e5 * omega[200:208].sum()
    assert np.allclose(light.irradiance, true, rtol=1e-3)
    middle = geometry.equirect_direction(403.5, 203.5, width, height)
    assert geometry.angle_deg(light.direction, middle) < 0.01


@pytest.mark.parametrize("preset", ["balanced", "accurate"])
def test_more_suns_than_are_remembered(tmp_path, preset):
    """64 suns all around: eight are listed; the others are in the SH, by their cells."""
    width, height = SIZE_PX
    omega = geometry.equirect_solid_angles(width, height)
    radiance = constant(1.0)
    for k in range(64):
        row, column = 60 + 50 * (k // 8), 30 + 120 * (k % 8) + 7 * (k // 8)
        radiance[row, column] += 1e5 * omega[height // 2] / omega[row]
    estimate = estimate_floats(tmp_path, radiance, preset=preset)
    assert 0 < len(estimate.lights) <= 8
    assert "MORE_LIGHTS" in estimate.to_json()["flags"]
    true, total = sh.project(radiance, 4), estimate.total().coefficients
    found = total[: len(true)]
    assert np.linalg.norm(found - true[: len(found)]) < 0.02 * np.linalg.norm(true)


def quaternion(axis, angle_rad):
    axis = geometry.normalize(np.array(axis) + 1e-9)
    return np.concatenate([[np.cos(angle_rad / 2)], np.sin(angle_rad / 2) * axis])


AXES = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda a: np.linalg.norm(a) > 0.1)
ANGLES = st.one_of(
    st.floats(0, 1e-6), st.just(np.pi), st.floats(np.pi - 1e-6, np.pi + 1e-6), st.floats(0, 7)
)


@given(axis=AXES, angle_rad=ANGLES, seed=st.integers(0, 99))
def test_turning_sh_there_and_back(axis, angle_rad, seed):
    """Order 8, by tiny, half and any turns: nothing is lost, and tiny turns change little."""
    c = np.random.default_rng(seed).normal(size=(81, 3))
    turned = sh.rotate(c, quaternion(axis, angle_rad))
    back = sh.rotate(turned, quaternion(axis, -angle_rad))
    assert np.abs(back - c).max() <= 1e-12 * np.abs(c).max()
    assert np.linalg.norm(turned - c) <= 8 * 1.01 * abs(angle_rad) * np.linalg.norm(c) + 1e-12


@given(
    column=st.integers(0, SIZE_PX[0] - 1),
    row=st.integers(0, SIZE_PX[1] - 1),
    contrast=st.floats(3e4, 1e7),
    level=st.floats(1e-4, 1e4),
)
@settings(max_examples=12)
def test_a_pixel_sun_anywhere(tmp_path_factory, column, row, contrast, level):
    """One lamp, in its pixel, with its strength; AMBIENT without it."""
    width, height = SIZE_PX
    omega = geometry.equirect_solid_angles(width, height)
    radiance = constant(level)
    strength = contrast * level * omega[height // 2] / omega[row]
    radiance[row, column] += np.float32(strength)
    estimate = estimate_floats(tmp_path_factory.mktemp("sun"), radiance, preset="accurate")
    (light,) = estimate.lights
    truth = geometry.equirect_direction(column, row, width, height)
    assert geometry.angle_deg(light.direction, truth) < 0.02
    assert np.allclose(light.irradiance, strength * omega[row], rtol=0.01)
    ambient = estimate.sh.coefficients[0] / np.sqrt(4 * np.pi)
    assert np.allclose(ambient, level, rtol=0.02)
