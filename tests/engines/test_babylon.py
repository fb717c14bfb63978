"""Babylon.js draws what `lightprobe export NAME.glb` wrote as the estimate says it."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from lightprobe import sh, shading
from lightprobe.estimate import Estimate, EstimateFlag, Light, SphericalHarmonics
from lightprobe.imaging import gltf
from lightprobe.imaging.cube import cube_map

BABYLON = Path(__file__).parents[2] / "build/babylon"
RNG = np.random.default_rng(5)
#: Not the same along any two axes, and nowhere below 0.
COEFFICIENTS = np.vstack([np.full((1, 3), 1.5), RNG.uniform(-0.18, 0.18, (8, 3))])


def estimate(coefficients, lights=()):
    harmonics = SphericalHarmonics("AMBIENT", 2, coefficients)
    return Estimate(1, 2, 3, 4, 500, EstimateFlag(0), lights, harmonics, 0.01, None, 1, None)


def drawn(given, hand, kind, folder):
    """Normals, directions towards the eye, and linear colours (n, 3) in Babylon.js."""
    file = folder / "light.glb"
    file.write_bytes(gltf.glb(given, cube_map(given, 64, lamps=False)[0]))
    command = ["node", "draw.js", str(file), hand, kind]
    done = subprocess.run(command, cwd=BABYLON, capture_output=True, check=True, timeout=300)
    samples = json.loads(done.stdout)
    normal, view, colour = (
        np.array([sample[key] for sample in samples]) for key in ("normal", "view", "colour")
    )
    return normal, view, colour


@pytest.mark.parametrize("hand", ["right", "left"])
@pytest.mark.parametrize("kind", ["white", "mirror"])
def test_a_sphere_in_the_ambient_light(hand, kind, tmp_path):
    normal, view, colour = drawn(estimate(COEFFICIENTS), hand, kind, tmp_path)
    if kind == "white":
        expected = sh.irradiance(COEFFICIENTS, normal) / np.pi
    else:
        expected = sh.radiance(COEFFICIENTS, shading.reflect(view, normal))
    assert expected.min() > 0.1
    assert expected.max() < 1
    off = 255 * np.abs(colour - expected ** (1 / 2.2)).max()
    print(f"{kind}, {hand}-handed: {off:.1f}/255 off at most, {len(normal)} normals")
    assert off < 2


@pytest.mark.parametrize("hand", ["right", "left"])
def test_a_lamp_straight_up_lights_what_faces_up(hand, tmp_path):
    lamp = Light(1, np.array([0.0, 1, 0]), np.full(3, 2.0), 1.0)
    given = estimate(np.zeros((9, 3)), (lamp,))
    normal, _, colour = drawn(given, hand, "white", tmp_path)
    assert colour[normal[:, 1] > 0.7].min() > 0.5
    assert colour[normal[:, 1] < -0.1].max() < 0.01
