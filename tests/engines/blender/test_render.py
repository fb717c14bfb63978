"""What Cycles renders with the add-on's lamps and world is what the packet says."""

import numpy as np
import pytest
from bl_ext.user_default.lightprobe import scene_lamps, scene_world, sky, suns
from bl_ext.user_default.lightprobe.fade import Fader
from lightprobe import sh
from lightprobe.wire import decode
from lightprobe_proto import lightprobe_pb2 as pb
from mathutils import Quaternion
from probes import packet
from rendering import WHITE, camera, plane, render, sphere, sphere_normals

UP = (0, 1, 0)
RNG = np.random.default_rng(5)
#: Not the same along any two axes, and nowhere below 0.
COEFFICIENTS = np.vstack([np.full((1, 3), 1.5), RNG.uniform(-0.18, 0.18, (8, 3))])


def shown(scene, *args, steady=True, scale=1.0, **kwargs):
    """Draw a packet as the add-on does once its fade is over; gives the estimate."""
    estimate = decode(
        pb.FromProbe(estimate=packet(*args, **kwargs)).SerializeToString()
    )
    fader = Fader()
    fader.step(float("inf"), estimate.boot_id, suns.suns(estimate, steady))
    scene_lamps.show(scene, fader.lamps, scale)
    scene_world.show_picture(scene, sky.from_harmonics(estimate.sh))
    scene_world.show(scene, fader.world_gain, scale)
    return estimate


@pytest.mark.parametrize("radius_deg", [0.27, 2.0, 7.0])
def test_a_lamp_straight_up_gives_a_horizontal_plane_its_irradiance(scene, radius_deg):
    irradiance = np.array([2.0, 1.5, 0.7])
    shown(scene, lamps=[(1, UP, irradiance, radius_deg)])
    plane()
    camera((0, 0, 1), width=1)
    off = np.abs(render(8, 256).mean(axis=(0, 1)) / (irradiance / np.pi * WHITE) - 1).max()
    print(f"lamp straight up, radius {radius_deg}°: {100 * off:.2f} % off E/π · albedo")
    assert off < 0.01
