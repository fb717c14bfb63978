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
    estimate = decode(pb.FromProbe(estimate=packet(*args, **kwargs)).SerializeToString())
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


def test_a_lamp_from_the_right_lights_the_right_and_throws_its_shadow_to_the_left(scene):
    # 45° up at the probe's +X, which is Blender's +X.
    shown(scene, lamps=[(1, (0.5**0.5, 0.5**0.5, 0), (3, 3, 3), 0.27)])
    plane(size=8)
    sphere(radius=0.5, location=(0, 0, 0.5)).visible_diffuse = False  # it lights nothing
    camera((0, 0, 1), width=4)
    seen = render(64, 64).mean(axis=-1)
    lit = 3 * 0.5**0.5 / np.pi * WHITE
    left, right = seen[32, 14], seen[32, 50]  # 1.1 beside the middle, on the plane
    print(f"plane left of the sphere {left:.4f}, right {right:.4f}, lit {lit:.4f}")
    assert right == pytest.approx(lit, rel=0.01)
    assert left == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize(
    ("azimuth_deg", "column", "row"), [(0, 32, 50), (90, 50, 32), (180, 32, 14), (-90, 14, 32)]
)
def test_a_lamp_lights_the_side_that_it_is_on(scene, azimuth_deg, column, row):
    """Forward (−Z, azimuth 0) is Blender's +Y, which is up in this picture; right is +X."""
    azimuth = np.radians(azimuth_deg)
    shown(scene, lamps=[(1, (np.sin(azimuth), 0, -np.cos(azimuth)), (3, 3, 3), 1)])
    sphere()
    camera((0, 0, 1))
    seen = render(64, 16).mean(axis=-1)
    opposite = seen[64 - row, 64 - column]
    assert seen[row, column] > 0.3
    assert opposite == pytest.approx(0, abs=1e-3)


def test_shadows_are_as_soft_as_the_lamp(scene):
    """The half-shadow of an edge at height h below a lamp of radius r is 2 h tan r wide."""
    radius_deg, height = 5.0, 1.0
    shown(scene, lamps=[(1, UP, (3, 3, 3), radius_deg)])
    plane(size=8)
    shade = plane(size=4, z=height)
    shade.location.x = -2  # its edge is above x = 0
    shade.visible_camera = shade.visible_diffuse = False
    camera((0, 0, 1), width=1)
    seen = render(128, 512).mean(axis=(0, 2)) / (3 / np.pi * WHITE)
    at = ((np.arange(128) + 0.5) / 128 - 0.5)[(seen > 0.02) & (seen < 0.98)]
    # A disc behind a straight edge: the shares 2 % and 98 % lie at ±0.903 of its radius.
    expected = 2 * 0.903 * height * np.tan(np.radians(radius_deg))
    print(f"half-shadow {np.ptp(at):.3f} wide, expected {expected:.3f}")
    assert np.ptp(at) == pytest.approx(expected, abs=0.02)


def off_at_normals(scene, expected, samples, eyes=((0, 0, 1), (1, -1, -0.5), (-1, 0.3, 0.2))):
    """Largest error in 1/255 of a white sphere's pixels against E(n)/π · albedo, and how many."""
    sphere()
    worst, count = 0.0, 0
    for eye in eyes:
        normals = sphere_normals(camera(eye), 40, 2.0)
        seen = render(40, samples)
        inside = np.isfinite(normals[..., 0])
        # Blender's axes to the probe's: x = X, y = Z, z = −Y.
        probe = normals[inside] @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)
        wanted = expected(probe) / np.pi * WHITE
        worst = max(worst, 255 * np.abs(seen[inside] - wanted).max())
        count += int(inside.sum())
    return worst, count


def test_a_white_sphere_in_the_sh_shows_the_irradiance(scene):
    shown(scene, coefficients=COEFFICIENTS)
    worst, count = off_at_normals(scene, lambda n: sh.irradiance(COEFFICIENTS, n), 512)
    print(f"world from SH: {worst:.2f}/255 off at most, {count} normals")
    assert worst < 2


def test_sh_with_negative_radiance_keep_their_irradiance(scene):
    """SH of order 4 of a sky with one bright spot: negative behind it, but light can look so."""
    strong = 0.25 * sh.lamp((0.6, 0.8, 0), 4, 25.0)[:, None] * np.array([3.0, 3, 2])
    strong[0] += 0.1
    points = sky.directions(64).reshape(-1, 3)
    assert sh.radiance(strong, points).min() < -0.05
    shown(scene, coefficients=strong)
    worst, count = off_at_normals(scene, lambda n: sh.irradiance(strong, n), 1024)
    print(f"SH below zero: {worst:.2f}/255 off at most, {count} normals")
    assert worst < 2


def test_the_world_turns_with_the_empty(scene):
    shown(scene, coefficients=COEFFICIENTS)
    empty = scene.lightprobe.root
    empty.rotation_mode = "QUATERNION"
    empty.rotation_quaternion = turn = Quaternion((0.8, 0.2, -0.5, 0.3)).normalized()
    scene.view_layers[0].update()
    scene_world.set_turn(scene, None)
    back = np.array(turn.to_matrix())  # row vectors times it: turned back

    def expected(probe):
        blender = probe @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)
        local = blender @ back
        return sh.irradiance(
            COEFFICIENTS, local @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)
        )

    worst, _ = off_at_normals(scene, expected, 512, eyes=((1, -1, 0.5),))
    print(f"turned empty: {worst:.2f}/255 off at most")
    assert worst < 2


def test_the_world_stays_when_the_probe_turns(scene):
    """The picture is in the probe frame; the orientation of the packet turns it."""
    shown(scene, coefficients=COEFFICIENTS)
    x, y, z, w = turn = np.array([0.1, -0.7, 0.3, 0.6403]) / np.linalg.norm(
        [0.1, -0.7, 0.3, 0.6403]
    )
    scene_world.set_turn(scene, turn)
    turned = sh.rotate(COEFFICIENTS, (w, x, y, z))
    worst, _ = off_at_normals(scene, lambda n: sh.irradiance(turned, n), 512, eyes=((1, -1, 0.5),))
    print(f"turned probe: {worst:.2f}/255 off at most")
    assert worst < 2
