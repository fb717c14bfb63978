"""The light of a reflection map is that of the room and of the estimate beside it."""

import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.evaluate import offline
from lightprobe.imaging import image
from lightprobe.reflection_map import SIZES
from lightprobe.sim import scenes
from lightprobe.sim.procedural import random_scene

NORMALS = geometry.sphere_normals(2)
#: Largest error at any normal. A lamp lies between four texels: a surface that it just grazes gets
#: light from half of them.
MOST = {16: 0.0135, 32: 0.0068, 64: 0.005}
pytestmark = pytest.mark.many_frames


def irradiance_of(picture):
    """On each of NORMALS (N, 3), by all pixels."""
    height, width = picture.shape[:2]
    towards = geometry.equirect_directions(width, height).reshape(-1, 3)
    flux = picture * geometry.equirect_solid_angles(width, height)[:, None, None]
    flux = flux.reshape(-1, 3)
    return np.stack([np.maximum(towards @ normal, 0) @ flux for normal in NORMALS])


def errors(found, expected):
    """Root mean square and largest error of irradiance, relative to the largest irradiance."""
    off = np.abs(found - expected) / expected.max()
    return float(np.sqrt((off**2).mean())), float(off.max())


def _picture(scene):
    layers = scene.render(1024, 512)
    return layers.compose(np.ones(len(layers.lamps)))


@pytest.fixture(scope="module")
def rooms(tmp_path_factory):
    """Name, picture and true irradiance of panoramas and procedural rooms."""
    found, folder = [], tmp_path_factory.mktemp("rooms")
    for scene in [*scenes.load(["blender"]), *(random_scene(seed) for seed in range(6))]:
        path, picture = folder / f"{scene.name}.pfm", _picture(scene)
        image.write_pfm(path, picture)
        found.append((scene.name, path, irradiance_of(picture)))
    return found


@pytest.mark.nightly_rows
@pytest.mark.parametrize("size", SIZES)
def test_irradiance_of_panoramas(rooms, size):
    """The map is the light itself at every normal, and the packet's within what SH leave out.

    The packet says its SH to order 4: at single normals these leave out more than the map does.
    """
    settings = offline.Settings(preset="balanced", lights=8, sh_order=4, reflection_map=size)
    for name, path, true in rooms:
        once = offline.estimate_pictures([path], settings=settings)
        of_map = once.reflection_map.irradiance(NORMALS)
        of_packet = once.estimate.irradiance(NORMALS)
        told = {
            "map": errors(of_map, true), "packet": errors(of_packet, true),
            "map against packet": errors(of_map, of_packet),
        }  # fmt: skip
        words = (
            f"{what} {100 * rms:.2f} % ({100 * most:.2f} %)" for what, (rms, most) in told.items()
        )
        print(f"{name} {size}: {', '.join(words)}")
        assert told["map"][1] < MOST[size], name
        assert told["map"][0] < 0.003, name
        assert told["map against packet"][0] < 0.005, name
