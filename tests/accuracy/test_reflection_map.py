"""The light of a reflection map is that of the estimate beside it, on panoramas and many lamps."""

import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.evaluate import offline
from lightprobe.imaging import image
from lightprobe.reflection_map import SIZES
from lightprobe.sim import scenes
from lightprobe.sim.procedural import random_scene

NORMALS = geometry.sphere_normals(2)
pytestmark = pytest.mark.usefixtures("released_daemon")


def errors(path, size):
    """Root mean square and largest error of the irradiance, relative to the largest one."""
    settings = offline.Settings(preset="balanced", lights=8, sh_order=4, reflection_map=size)
    once = offline.estimate_pictures([path], settings=settings)
    expected = once.estimate.irradiance(NORMALS)
    off = np.abs(once.reflection_map.irradiance(NORMALS) - expected) / expected.max()
    return float(np.sqrt((off**2).mean())), float(off.max())


def _picture(scene):
    layers = scene.render(1024, 512)
    return layers.compose(np.ones(len(layers.lamps)))


@pytest.mark.parametrize("size", SIZES)
def test_irradiance_of_panoramas(tmp_path, size):
    """0.5 % root mean square; the largest is what the packet's SH of order 4 leave out."""
    everything = [*scenes.load(["blender"]), *(random_scene(seed) for seed in range(6))]
    for scene in everything:
        path = tmp_path / "scene.pfm"
        image.write_pfm(path, _picture(scene))
        rms, most = errors(path, size)
        print(f"{scene.name} {size}: {100 * rms:.2f} % ({100 * most:.2f} %)")
        assert rms < 0.005, scene.name
        assert most < 0.025, scene.name
