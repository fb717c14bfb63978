"""A known fisheye lens, found again from pictures that it takes of a printed board."""

import json
import subprocess
import sys

import cv2
import numpy as np
import pytest
from lightprobe.calibrate import camera_file, lens_board, lens_fit
from lightprobe.imaging import camera as cameras
from lightprobe.imaging.camera import Lens

SIZE_PX = (1280, 960)
#: As a 180-degree module has it: off the middle, pixels not square, bent.
TRUE = Lens((652.3, 471.8), (301.0, 303.5), (0.021, -0.0073, 0.0011, 0.0), 95.0)
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


def poses(count, rng):
    """Boards all around the axis, tilted, from the middle to the edge."""
    for number in range(count):
        away = np.radians(rng.uniform(0, 50) if number % 3 else rng.uniform(0, 15))
        around = 2 * np.pi * number / count
        centre = np.array([np.sin(away) * np.cos(around), np.sin(away) * np.sin(around),
                           np.cos(away)])  # fmt: skip
        facing = np.degrees(away) * np.array([-np.sin(around), np.cos(around), 0])
        yield facing + rng.uniform(-20, 20, 3), centre * rng.uniform(5, 8)


@pytest.fixture(scope="module")
def pictures():
    rng = np.random.default_rng(7)
    return [picture(TRUE, turn, shift, rng) for turn, shift in poses(15, rng)]


def calibrate(*arguments):
    """Exit status, output, and what it says beside it."""
    command = [sys.executable, "-m", "lightprobe", "calibrate", "lens", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    return done.returncode, done.stdout, done.stderr


def directions_off_deg(lens, to_deg):
    """Angles between where two lenses say that pixels look, to an angle off the axis."""
    x, y = np.meshgrid(np.arange(0.5, SIZE_PX[0], 16), np.arange(0.5, SIZE_PX[1], 16))
    true, theta = TRUE.look(x, y)
    found, _ = lens.look(x, y)
    near = np.degrees(theta) < to_deg
    cosine = np.sum(true * found, axis=-1)[near]
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def test_the_lens_is_found_again(pictures):
    found = [corners for p in pictures if (corners := BOARD.find(p)) is not None]
    assert len(found) >= 12
    fit = lens_fit.fit(found, SIZE_PX)
    assert fit.rms_px < 0.3
    assert fit.lens.centre_px == pytest.approx(TRUE.centre_px, abs=1.0)
    assert fit.lens.focal_px == pytest.approx(TRUE.focal_px, rel=0.01)
    assert 60 < fit.lens.max_theta_deg < 90
    assert fit.covered > 0.6
    # Where corners were seen, pixels look where they do: within a pixel (0.19 degrees).
    assert directions_off_deg(fit.lens, fit.lens.max_theta_deg - 5).max() < 0.19


def test_one_that_contradicts_is_left_out(pictures):
    found = [corners for p in pictures if (corners := BOARD.find(p)) is not None]
    bent = lens_board.Corners(found[3].board * [1, 1.3, 1], found[3].picture_px)
    bent.board[:, 0] += 0.2 * bent.board[:, 1] ** 2
    fit = lens_fit.fit([*found[:3], bent, *found[4:]], SIZE_PX)
    assert np.isnan(fit.picture_rms_px[3])
    assert np.isfinite(np.delete(fit.picture_rms_px, 3)).all()
    assert directions_off_deg(fit.lens, fit.lens.max_theta_deg - 5).max() < 0.25


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
    assert "15.png: the board is not found" in err
    report = json.loads(out)
    camera = cameras.load(str(output))
    assert (camera.width_px, camera.height_px) == SIZE_PX
    assert camera.lenses[0].max_theta_deg == 92
    assert camera.lenses[0].focal_px[0] == pytest.approx(report["lens"]["fx_px"], rel=1e-4)
    # Again, into the same file: what else it says stays.
    output.write_text(output.read_text().replace("[lens.0]", "[lens.0]\nrolloff = -0.1, 0, 0"))
    assert calibrate(*paths[:15], "--board", "9x7", "--output", output)[0] == 0
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
