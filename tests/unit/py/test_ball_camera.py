"""A mirror ball as a camera, against rays that are traced to it."""

import numpy as np
import pytest
from lightprobe.geometry import angle_deg
from lightprobe.imaging import camera
from lightprobe.imaging.ball import Ball, Pinhole, reflectance

FILE = """[camera]
projection = ball
width_px = 640
height_px = 480
[lens.0]
cx_px = 320
cy_px = 240
fx_px = 800
fy_px = 810
rotation_wxyz = 1, 1, 0, 0
[ball]
centre = 20, -15, -240
radius = 30
index = 1.5
extinction = 0
"""


def load(tmp_path, text):
    path = tmp_path / "ball.camera"
    path.write_text(text)
    return camera.load(str(path))


def test_pixels_show_what_the_law_of_the_mirror_says(tmp_path):
    cam = load(tmp_path, FILE)
    directions, mirrored = cam.look(640, 480)
    x, y = np.meshgrid(np.arange(640) + 0.5, np.arange(480) + 0.5)
    rays = np.stack([(x - 320) / 800, -(y - 240) / 810, -np.ones_like(x)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    centre = np.array([20.0, -15, -240])
    along = rays @ centre
    under = along**2 - centre @ centre + 30.0**2
    normals = (rays * (along - np.sqrt(np.maximum(under, 0)))[..., None] - centre) / 30
    cosine = -(rays * normals).sum(-1)
    true = rays + 2 * cosine[..., None] * normals
    up = np.stack([true[..., 0], -true[..., 2], true[..., 1]], axis=-1)  # a quarter turn about +X
    seen = mirrored > 0
    assert np.all(under[seen] > 0)
    assert 0.95 < seen.sum() / (under > 0).sum() < 0.98
    np.testing.assert_allclose(directions[seen], up[seen], atol=1e-9)
    np.testing.assert_allclose(mirrored[seen], reflectance(1.5, 0, cosine[seen]), atol=1e-9)
    assert np.isnan(directions[~seen]).all()


def test_a_lens_that_distorts():
    pinhole = Pinhole(800, 810, 330, 235, (-0.2, 0.05, 1e-3, -2e-3, 0.01))
    rays = pinhole.rays(np.array([[100.0, 50], [500, 400]]))
    np.testing.assert_allclose(pinhole.places(rays), [[100, 50], [500, 400]], atol=1e-3)
    ball = Ball(pinhole, np.array([0.0, 0, -300]), 30)
    directions, _ = ball.look(np.array([[330.0, 235]]))
    assert angle_deg(directions[0], [0, 0, 1]) < 1e-6  # the camera sees itself


def test_reflectances():
    assert reflectance(1.5, 0, np.array(1.0)) == pytest.approx(0.04)
    assert reflectance(3.18, 3.31, np.array(1.0)) == pytest.approx(0.5526, abs=1e-3)
    assert reflectance(1.5, 0, np.array(0.0)) == pytest.approx(1)


@pytest.mark.parametrize(
    ("was", "becomes", "says"),
    [
        ("radius = 30", "radius = 300", "radius"),
        ("-240", "240", "before the lens"),
        ("index = 1.5", "distortion = 0, 0, 0, 0, 0, 1", "distortion"),
        ("[ball]", "[lens.1]\ncx_px = 3\n[ball]", "2 [lens.N]"),
        ("[ball]\ncentre = 20, -15, -240", "[ball]", "centre is missing"),
    ],
)
def test_what_is_no_ball(tmp_path, was, becomes, says):
    with pytest.raises(camera.CameraError, match="ball") as error:
        load(tmp_path, FILE.replace(was, becomes))
    assert says in str(error.value)
