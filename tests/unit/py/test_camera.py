"""Camera files and where their pixels look."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe import geometry
from lightprobe.imaging import camera

DUAL = """
[camera]
name = two lenses
projection = fisheye
width_px = 1600
height_px = 800
[lens.0]
cx_px = 400
cy_px = 400
fx_px = 230
fy_px = 230
k1 = 0.01   ; a little
max_theta_deg = 97
rolloff = -0.05, 0.0, 0.0
[lens.1]
cx_px = 1200
cy_px = 400
fx_px = 230
fy_px = 230
k1 = 0.01
max_theta_deg = 97
rotation_wxyz = 0, 0, 1, 0
"""


@pytest.fixture
def dual(tmp_path):
    path = tmp_path / "dual.camera"
    path.write_text(DUAL)
    return camera.load(str(path))


def test_equirect_needs_no_file():
    directions, illumination = camera.load("equirect").look(64, 32)
    assert directions == pytest.approx(geometry.equirect_directions(64, 32))
    assert np.all(illumination == 1)


def test_lenses_look_ahead_and_behind(dual):
    directions, illumination = dual.look(1600, 800)
    ahead, behind = directions[399:401, 399:401], directions[399:401, 1199:1201]
    assert geometry.normalize(ahead.sum(axis=(0, 1))) == pytest.approx([0, 0, -1], abs=1e-9)
    assert geometry.normalize(behind.sum(axis=(0, 1))) == pytest.approx([0, 0, 1], abs=1e-9)
    assert directions[400, 500][0] > 0.3  # right of the axis is +X
    assert directions[300, 400][1] > 0.3  # above it is +Y
    assert directions[400, 1300][0] < -0.3  # a camera turned about Y sees −X on its right
    assert illumination[0, 0] == 0
    assert np.isnan(directions[0, 0]).all()


def test_rolloff_and_field_of_view(dual):
    directions, illumination = dual.look(1600, 800)
    theta = np.radians(geometry.angle_deg(directions[400, 600], [0, 0, -1]))
    assert illumination[400, 600] == pytest.approx(1 - 0.05 * theta**2, rel=1e-6)
    seen = illumination[:, :800] > 0
    off_axis = geometry.angle_deg(directions[:, :800][seen], [0, 0, -1])
    assert off_axis.max() == pytest.approx(97, abs=0.5)


def test_smaller_frames_are_the_same_picture(dual):
    whole, _ = dual.look(1600, 800)
    half, _ = dual.look(800, 400)
    between = geometry.normalize(whole[400:402, 500:502].mean(axis=(0, 1)))
    assert geometry.angle_deg(between, half[200, 250]) < 1e-3


@given(st.floats(0, 1.7), st.floats(-0.03, 0.03), st.floats(-0.01, 0.01))
def test_polynomial_is_undone(theta, k1, k2):
    lens = camera.Lens((0.0, 0.0), (200.0, 220.0), (k1, k2, 0.0, 0.0), 100)
    r = lens.radius(theta)
    _, seen = lens.look(np.array([200.0 * r]), np.array([0.0]))
    assert seen[0] == pytest.approx(theta, abs=1e-6)


def test_mask_and_response(tmp_path):
    mask = np.full((80, 160), 255, np.uint8)
    mask[:40] = 0
    cv2.imwrite(str(tmp_path / "mask.pgm"), mask)
    table = np.repeat(np.linspace(0, 2, 256)[:, None], 3, 1)
    np.savetxt(tmp_path / "response.txt", table)
    text = DUAL.replace("k1 = 0.01   ; a little", "mask = mask.pgm")
    path = tmp_path / "x.camera"
    path.write_text(text + "[response]\ntable = response.txt\n")
    loaded = camera.load(str(path))
    _, illumination = loaded.look(160, 80)
    assert np.all(illumination[:40, :80] == 0)
    assert np.any(illumination[:40, 80:] > 0)
    assert loaded.response_table()[255] == pytest.approx([1, 1, 1])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[camera]", "[lens.9]", "section .camera. is missing"),
        (
            "projection = fisheye",
            "projection = cube",
            "cube: expected equirect, fisheye, pinhole or ball",
        ),
        ("projection = fisheye", "projection = pinhole", "pinhole with 2"),
        ("cx_px = 400", "cx_px = left", r"\[lens.0\] cx_px = left: expected a number"),
        ("fx_px = 230\n", "", r"\[lens.0\] fx_px is missing"),
        ("max_theta_deg = 97", "max_theta_deg = 0", "max_theta_deg"),
        ("k1 = 0.01   ;", "k1 = -1 ;", "stops growing"),
        ("rolloff = -0.05, 0.0, 0.0", "rolloff = 1, 2", "expected 3 numbers"),
        ("rolloff", "mask = none.pgm\nrolloff", "not a readable PGM"),
        ("[camera]", "[camera\n", "parse"),
        ("[camera]", "[glare]\neven = 0.5\n[camera]", r"\[glare\] expected even 0…0.4"),
        ("[camera]", "[glare]\naround = -0.1\n[camera]", r"\[glare\] expected"),
        ("[camera]", "[glare]\nwidth_deg = 0\n[camera]", "width_deg 1…90"),
        ("[camera]", "[glare]\neven = some\n[camera]", r"\[glare\] even = some"),
    ],
)
def test_bad_files_are_named(tmp_path, old, new, message):
    path = tmp_path / "bad.camera"
    path.write_text(DUAL.replace(old, new, 1))
    with pytest.raises(camera.CameraError, match=message) as error:
        camera.load(str(path))
    assert "bad.camera" in str(error.value)


def test_glare_is_read(tmp_path):
    path = tmp_path / "x.camera"
    path.write_text(DUAL)
    assert camera.load(str(path)).glare == camera.Glare(0, 0, 10)
    path.write_text(DUAL + "[glare]\neven = 0.01\naround = 0.02\nwidth_deg = 7\n")
    assert camera.load(str(path)).glare == camera.Glare(0.01, 0.02, 7)
    path.write_text(DUAL + "[glare]\neven = 0.01\n")
    assert camera.load(str(path)).glare == camera.Glare(0.01, 0, 10)


def test_missing_file():
    with pytest.raises(camera.CameraError, match=r"none\.camera: open: No such file"):
        camera.load("none.camera")


PACKAGED = sorted((Path(__file__).resolve().parents[3] / "packaging/cameras").glob("*.camera"))


@pytest.mark.parametrize("path", PACKAGED, ids=lambda path: path.stem)
def test_packaged_files_are_read_and_say_what_was_tested(path):
    loaded = camera.load(str(path))
    assert "On hardware:" in path.read_text()
    for lens in loaded.lenses:  # its circle lies in the picture, or is cut by its edge
        rim_px = lens.focal_px[0] * lens.radius(np.radians(lens.max_theta_deg))
        assert 0 < lens.centre_px[0] < loaded.width_px
        assert 0.25 * loaded.height_px < rim_px < 0.75 * loaded.height_px


PHONE = """
[camera]
projection = pinhole
width_px = 360
height_px = 640
[lens.0]
cx_px = 182
cy_px = 317
fx_px = 500
fy_px = 505
"""


def _phone(folder, more=""):
    path = folder / "phone.camera"
    path.write_text(PHONE + more)
    return camera.load(str(path))


def test_an_ordinary_camera_sees_the_tangent(tmp_path):
    directions, illumination = _phone(tmp_path).look(360, 640)
    right, up = (299.5 - 182) / 500, (317 - 199.5) / 505
    assert directions[199, 299] == pytest.approx(geometry.normalize(np.array([right, up, -1])))
    assert np.all(illumination == 1)


def test_distortion_is_opencvs(tmp_path):
    """What its function draws is looked along again; the first pixel's centre is (0.5, 0.5)."""
    values = [0.1, -0.2, 0.001, -0.002, 0.05]
    loaded = _phone(tmp_path, f"distortion = {values}\n".replace("[", "").replace("]", ""))
    directions, _ = loaded.look(360, 640)
    points = directions[::40, ::40].reshape(-1, 3) * [1, -1, -1]
    matrix = np.array([[500, 0, 181.5], [0, 505, 316.5], [0, 0, 1]])
    drawn, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(values))
    y, x = np.mgrid[0:640:40, 0:360:40]
    assert drawn.reshape(-1, 2) == pytest.approx(np.stack([x, y], -1).reshape(-1, 2), abs=0.01)
    lens = loaded.lenses[0]
    places = np.stack(lens.place(directions), axis=-1)
    assert places[100, 200] == pytest.approx([200.5, 100.5], abs=0.01)
    assert np.isnan(lens.place(-directions[100, 200])[0])


@pytest.mark.parametrize("k1", [-0.3, -0.2, 0.3])
def test_a_wide_lens_that_distorts_much_is_no_fold(tmp_path, k1):
    """Its inverse takes more steps than OpenCV's default."""
    path = tmp_path / "wide.camera"
    path.write_text(PHONE.replace("360", "1600").replace("640", "1200").replace("182", "800")
                    .replace("317", "600").replace("500", "1000").replace("505", "1000")
                    + f"distortion = {k1}, 0.05\n")  # fmt: skip
    lens = camera.load(str(path)).lenses[0]
    rays, _ = lens.look(np.array([0.5]), np.array([0.5]))
    assert np.ravel(lens.place(rays)) == pytest.approx([0.5, 0.5], abs=1e-6)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("k1 = 0.1", "which are of a fisheye"),
        ("distortion = 0, 0, 0, 0, 0, 1", "k1, k2, p1, p2, k3"),
        ("distortion = -4", "two places"),
        ("distortion = some", "expected"),
    ],
)
def test_bad_ordinary_cameras_are_named(tmp_path, more, message):
    with pytest.raises(camera.CameraError, match=message):
        _phone(tmp_path, more + "\n")
