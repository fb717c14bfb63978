"""A known fisheye lens, found again from pictures that it takes of a printed board."""

import dataclasses
import json
import subprocess
import sys

import cv2
import numpy as np
import pytest
from lightprobe.calibrate import camera_file, lens_board, lens_fit
from lightprobe.cli import calibrate_lens
from lightprobe.errors import LightprobeError
from lightprobe.imaging import camera as cameras
from lightprobe.imaging.camera import Lens

SIZE_PX = (1280, 960)
#: A module of 200 degrees: off the middle, pixels not square, bent.
TRUE = Lens((652.3, 471.8), (261.0, 263.2), (0.021, -0.0073, 0.0011, 0.0), 100.0)
BOARD = lens_board.Board(9, 7)
SQUARE_PX, MARGIN = 60, 1.0


def picture(lens, turn_deg, shift, rng):
    """The board (squares of side 1, its middle at `shift`, z forward) as the lens sees it."""
    flat = np.pad(BOARD.draw(SQUARE_PX), round(MARGIN * SQUARE_PX), constant_values=255)
    scale = 2  # finer than the pixels, then averaged
    x, y = np.meshgrid(*[(np.arange(scale * n) + 0.5) / scale for n in SIZE_PX])
    direction, theta = lens.look(x, y)
    rays = direction * [1, -1, -1]  # x right, y down, z forward
    turn = cv2.Rodrigues(np.radians(np.asarray(turn_deg, float)))[0]
    normal = turn[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (normal @ shift) / (rays @ normal)
        there = (rays * far[..., None] - shift) @ turn  # on the board, from its middle
    column = (there[..., 0] + BOARD.columns / 2 + MARGIN) * SQUARE_PX - 0.5
    row = (there[..., 1] + BOARD.rows / 2 + MARGIN) * SQUARE_PX - 0.5
    unseen = ~np.isfinite(theta) | ~(far > 0)
    column[unseen] = row[unseen] = -1e6
    seen = cv2.remap(
        flat, column.astype(np.float32), row.astype(np.float32), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT, borderValue=90,
    )  # fmt: skip
    seen = cv2.resize(seen, SIZE_PX, interpolation=cv2.INTER_AREA).astype(float)
    seen = cv2.GaussianBlur(0.7 * seen + 20, (0, 0), 0.7) + rng.normal(0, 3, seen.shape)
    return np.clip(seen, 0, 255).astype(np.uint8)


def poses(count, rng, most_deg=80):
    """Boards all around the axis, tilted, from the middle to the edge; the middle's are fewer."""
    for number in range(count):
        away = np.radians(rng.uniform(most_deg / 2, most_deg) if number % 3 else
                          rng.uniform(0, most_deg / 4))  # fmt: skip
        around = 2 * np.pi * 0.382 * number
        centre = np.array([np.sin(away) * np.cos(around), np.sin(away) * np.sin(around),
                           np.cos(away)])  # fmt: skip
        facing = np.degrees(away) * np.array([-np.sin(around), np.cos(around), 0])
        yield facing + rng.uniform(-20, 20, 3), centre * rng.uniform(5, 8)


@pytest.fixture(scope="module")
def pictures():
    rng = np.random.default_rng(7)
    return [picture(TRUE, turn, shift, rng) for turn, shift in poses(18, rng)]


@pytest.fixture(scope="module")
def found(pictures):
    seen = [corners for p in pictures if (corners := BOARD.find(p)) is not None]
    assert len(seen) >= 15
    return seen


def calibrate(*arguments):
    """Exit status, output, and what it says beside it."""
    command = [sys.executable, "-m", "lightprobe", "calibrate", "lens", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    return done.returncode, done.stdout, done.stderr


def directions_off_deg(lens, to_deg, from_deg=0):
    """Angles between where two lenses say that pixels look, between two angles off the axis."""
    x, y = np.meshgrid(np.arange(0.5, SIZE_PX[0], 16), np.arange(0.5, SIZE_PX[1], 16))
    true, theta = TRUE.look(x, y)
    found, _ = lens.look(x, y)
    near = (np.degrees(theta) < to_deg) & (np.degrees(theta) >= from_deg)
    cosine = np.sum(true * found, axis=-1)[near]
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


@pytest.mark.nightly_rows
@pytest.mark.parametrize(("model", "bound_deg"), [("fisheye", 0.11), ("omnidir", 0.15)])
def test_the_lens_is_found_again_beyond_90_degrees(found, model, bound_deg):
    fit = lens_fit.fit(found, SIZE_PX, model)
    farthest = fit.lens.max_theta_deg
    assert farthest > 95
    assert fit.covered > 0.85
    assert fit.rms_px < 0.4
    inner, rim = directions_off_deg(fit.lens, 80), directions_off_deg(fit.lens, farthest - 1, 80)
    sigma_deg = fit.sigma_deg(farthest)
    print(
        f"{model}: {len(found)} pictures, corners to {farthest:.1f}°, {fit.rms_px:.2f} px; pixels "
        f"look where they should within {inner.max():.3f}° (RMS {np.sqrt(np.mean(inner**2)):.3f}°) "
        f"to 80°, within {rim.max():.3f}° from there to the last corner; stated sigma "
        f"{sigma_deg:.3f}°"
    )
    assert max(inner.max(), rim.max()) < bound_deg  # a pixel is 0.22 degrees
    if model == "fisheye":
        assert max(inner.max(), rim.max()) < 4 * sigma_deg  # the worst of thousands of pixels
        assert sigma_deg < 0.05


def test_a_lens_that_is_no_polynomial_is_found(found):
    """An equisolid lens, r = 2 f sin(theta / 2), from exact corners with noise."""
    rng = np.random.default_rng(3)
    pictures, focal = [], 270.0
    for turn, shift in poses(18, rng):
        places = found[0].board * [1, 1, 0] - [4.5, 3.5, 0]
        places = places @ cv2.Rodrigues(np.radians(turn))[0].T + shift
        across = np.hypot(places[:, 0], places[:, 1])
        theta = np.arctan2(across, places[:, 2])
        radius = 2 * focal * np.sin(theta / 2)
        seen = np.array([640, 480]) + places[:, :2] * (radius / across)[:, None]
        seen += rng.normal(0, 0.2, seen.shape)
        pictures.append(lens_board.Corners(found[0].board, seen.astype(np.float32)))
    lens = lens_fit.fit(pictures, SIZE_PX).lens
    theta = np.radians(np.linspace(1, lens.max_theta_deg, 90))
    off_px = lens.focal_px[0] * lens.radius(theta) - 2 * focal * np.sin(theta / 2)
    assert np.abs(off_px).max() < 0.5


def test_one_that_contradicts_is_left_out(found):
    bent = lens_board.Corners(found[3].board * [1, 1.3, 1], found[3].picture_px)
    bent.board[:, 0] += 0.2 * bent.board[:, 1] ** 2
    fit = lens_fit.fit([*found[:3], bent, *found[4:]], SIZE_PX)
    assert np.isnan(fit.picture_rms_px[3])
    assert np.isfinite(np.delete(fit.picture_rms_px, 3)).all()
    assert directions_off_deg(fit.lens, fit.lens.max_theta_deg - 1).max() < 0.11


def test_what_corners_do_not_tell_has_a_larger_sigma(found):
    fit = lens_fit.fit(found, SIZE_PX)
    few = lens_fit.fit(found[:9], SIZE_PX)
    assert few.sigma_deg(95) > fit.sigma_deg(95)
    assert fit.sigma_deg(130) > 3 * fit.sigma_deg(95)


def test_an_angle_where_the_lens_has_ended_is_refused(found):
    """With these numbers r = t - 0.2 t^3 has its highest point at 74 degrees."""
    lens = Lens((640, 480), (300, 300), (-0.2, 0, 0, 0), 70)
    assert lens_fit.grows_to_deg(lens, 70) == 70
    assert lens_fit.grows_to_deg(lens, 120) == pytest.approx(74, abs=0.5)
    fit = dataclasses.replace(lens_fit.fit(found, SIZE_PX), lens=lens)
    with pytest.raises(LightprobeError, match="stops growing at 74"):
        calibrate_lens.refuse_beyond(fit, 90)


def test_a_board_in_the_middle_only_is_refused():
    rng = np.random.default_rng(5)
    shown = [picture(TRUE, turn, 1.5 * shift, rng) for turn, shift in poses(8, rng, 25)]
    seen = [corners for p in shown if (corners := BOARD.find(p)) is not None]
    assert len(seen) >= lens_fit.LEAST_PICTURES
    with pytest.raises(lens_fit.LensError, match=r"of the way from the middle.*at the edges"):
        lens_fit.fit(seen, SIZE_PX)


def test_pictures_of_another_lens_contradict(found):
    """Each picture's corners shifted, as by a camera whose lens is loose."""
    rng = np.random.default_rng(2)
    loose = [
        lens_board.Corners(c.board, (c.picture_px * rng.uniform(0.8, 1.2, 2)).astype(np.float32))
        for c in found
    ]
    with pytest.raises(lens_fit.LensError, match=r"contradict|known to"):
        lens_fit.fit(loose, SIZE_PX)


def test_without_contrib_omnidir_is_refused(found, monkeypatch):
    monkeypatch.delattr(cv2, "omnidir")
    with pytest.raises(LightprobeError, match="opencv-contrib-python-headless"):
        lens_fit.fit(found, SIZE_PX, "omnidir")


def test_the_command_writes_a_camera_file(pictures, tmp_path):
    paths = []
    for number, p in enumerate([*pictures, np.full(SIZE_PX[::-1], 128, np.uint8)]):
        paths.append(tmp_path / f"{number:02d}.png")
        cv2.imwrite(str(paths[-1]), p)
    output = tmp_path / "my.camera"
    status, out, err = calibrate(
        *paths, "--board", "9x7", "--output", output, "--max-theta-deg", "92", "--json"
    )
    assert status == 0, err
    assert "18.png: the board is not found" in err
    report = json.loads(out)
    camera = cameras.load(str(output))
    assert (camera.width_px, camera.height_px) == SIZE_PX
    assert camera.lenses[0].max_theta_deg == 92
    assert camera.lenses[0].focal_px[0] == pytest.approx(report["lens"]["fx_px"], rel=1e-4)
    # Again, into the same file: what else it says stays.
    output.write_text(output.read_text().replace("[lens.0]", "[lens.0]\nrolloff = -0.1, 0, 0"))
    assert calibrate(*paths[:18], "--board", "9x7", "--output", output)[0] == 0
    assert cameras.load(str(output)).lenses[0].rolloff == (-0.1, 0, 0)


def test_what_is_wrong_is_said(tmp_path):
    blank, small = tmp_path / "blank.png", tmp_path / "small.png"
    cv2.imwrite(str(blank), np.full((96, 128), 128, np.uint8))
    cv2.imwrite(str(small), np.full((48, 64), 128, np.uint8))
    other = tmp_path / "other.camera"
    for arguments, words in (
        ([], "give pictures of the board"),
        ([blank], "the board is found in 0 pictures"),
        ([blank, small], "64x48, the others are 128x96"),
        ([tmp_path / "none.png"], "no picture"),
        (["--board", "9", blank], "expected COLUMNSxROWS"),
        (["--board", "3x9", blank], "at least 4 squares"),
        (["--model", "pinhole", blank], "expected fisheye, omnidir"),
    ):
        status, _, err = calibrate(*arguments, "--output", other)
        assert status != 0
        assert words in err
    assert not other.exists()


def test_a_file_of_another_size_is_kept(tmp_path):
    path = tmp_path / "a.camera"
    camera_file.save_lens(path, (640, 480), {"cx_px": "320", "cy_px": "240", "fx_px": "150",
                                                "fy_px": "150", "max_theta_deg": "80"})  # fmt: skip
    text = path.read_text()
    with pytest.raises(cameras.CameraError, match="refer to 640x480, the pictures are 128x96"):
        camera_file.save_lens(path, (128, 96), {"cx_px": "1"})
    assert path.read_text() == text


def test_the_board_is_drawn(tmp_path):
    path = tmp_path / "board.png"
    assert calibrate("--draw", path, "--board", "9x7")[0] == 0
    drawn = cv2.imread(str(path), 0)
    assert drawn.shape == (7 * 300, 9 * 300)
    assert (
        len(BOARD.find(cv2.resize(np.pad(drawn, 300, constant_values=255), (1100, 900))).board)
        == 48
    )
