"""A lens whose roll-off is known, found again from pictures of unevenly lit walls."""

import json
import subprocess
import sys
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.calibrate import turned_pictures
from lightprobe.imaging import camera as cameras
from lightprobe.imaging.camera import Camera, Lens
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.scene import PanoramaScene
from lightprobe.sim.world import Behaviour, World

SIZE = 640
MAX_DEG = 97.0
CAMERA_TEXT = f"""[camera]
projection = fisheye
width_px = {SIZE}
height_px = {SIZE}
; mine
[lens.0]
cx_px = {SIZE / 2}
cy_px = {SIZE / 2}
fx_px = 188
fy_px = 188
max_theta_deg = {MAX_DEG}
"""


@dataclass(frozen=True, eq=False)
class DarkLens(Lens):
    """Falls off by the fourth power of the cosine of half the angle, which is no polynomial."""

    def illumination(self, theta):
        return np.cos(np.asarray(theta) / 2) ** 4


LENS = DarkLens((SIZE / 2, SIZE / 2), (188.0, 188.0), (0.0, 0.0, 0.0, 0.0), MAX_DEG)


def walls(posters, seed=0):
    """Walls lit unevenly, ten times as bright at one place as at others; with posters or blank."""
    rng = np.random.default_rng(seed)
    directions = geometry.equirect_directions(1024, 512)
    spot = geometry.direction_from_angles(50, 20)
    other = geometry.direction_from_angles(-120, -10)
    light = 0.1 + np.exp(4 * (directions @ spot - 1)) + 0.4 * np.exp(3 * (directions @ other - 1))
    for _ in range(posters):
        row, column = rng.integers(60, 440), rng.integers(0, 1000)
        height, width = rng.integers(4, 40, 2)
        light[row : row + height, column : column + width] *= rng.uniform(0.3, 1.0)
    radiance = 250 * np.repeat(light[..., None], 3, -1) * [1.0, 0.95, 0.85]
    return PanoramaScene.of("walls", radiance.astype(np.float32))


def shoot(folder, scene, count=24, turn_deg=15.0, nod_deg=12.0):
    """Pictures of a camera that is turned to the right, and nods; each of another exposure."""
    behaviour = Behaviour(act_s=0, turn_deg_s=turn_deg, nod_deg=nod_deg)
    taking = SimulatedCamera(
        World([scene], behaviour), Camera("dark", SIZE, SIZE, (LENS,)), (SIZE, SIZE), rate_hz=1.0,
        quality=92, seed=4,
    )  # fmt: skip
    rng, paths = np.random.default_rng(1), []
    for number in range(count):
        # About two milliseconds, so that the turn does not smear; the lamps drift by 20 %.
        shot = Shot(2000 * float(rng.uniform(0.8, 1.2)))
        paths.append(folder / f"{number:02d}.jpg")
        paths[-1].write_bytes(taking.frame(number, shot))
    return paths


def run(*arguments):
    """Exit status, output, and what it says beside it."""
    command = [sys.executable, "-m", "lightprobe", "calibrate", "roll-off", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=400)
    return done.returncode, done.stdout, done.stderr


def error_of(rolloff):
    """The largest relative error within 95 degrees."""
    theta = np.radians(np.linspace(0, 95, 96))
    found = Lens(LENS.centre_px, LENS.focal_px, LENS.k, MAX_DEG, rolloff=tuple(rolloff))
    return np.abs(found.illumination(theta) / LENS.illumination(theta) - 1).max()


@pytest.fixture
def camera(tmp_path):
    path = tmp_path / "my.camera"
    path.write_text(CAMERA_TEXT)
    return path


def test_roll_off_is_found_by_walls_that_are_lit_unevenly(tmp_path, camera):
    paths = shoot(tmp_path, walls(posters=400))
    for path in paths[3::4]:  # somebody is in the way
        picture = cv2.imread(str(path))
        cv2.circle(picture, (250, 380), 60, (40, 50, 60), -1)
        cv2.imwrite(str(path), picture, [cv2.IMWRITE_JPEG_QUALITY, 95])
    for path in (paths[5], paths[16], paths[17]):  # and once right before the lens
        cv2.imwrite(str(path), np.full((SIZE, SIZE, 3), 90, np.uint8))
    status, out, err = run(*paths, "--output", camera, "--json")
    assert status == 0, err
    assert err.count("left out: ") == 3
    assert "05.jpg: it shows too little" in err
    (report,) = json.loads(out)
    error = error_of(report["rolloff"])
    print(
        f"cos^4 of half the angle, {report['at_rim']:.3f} at the rim: found within "
        f"{100 * error:.2f} % up to 95 degrees, stated sigma {100 * report['sigma']:.2f} %"
    )
    assert error < 0.015
    assert error < 4 * (report["sigma"] + report["misfit"]) + 0.005
    written = cameras.load(str(camera)).lenses[0].rolloff
    assert written == pytest.approx(report["rolloff"], rel=1e-4)
    assert "; mine" in camera.read_text()


def test_a_blank_wall_needs_a_turntable(tmp_path, camera):
    paths = shoot(tmp_path, walls(posters=0), nod_deg=0)
    before = camera.read_text()
    status, _, err = run(*paths, "--output", camera)
    assert status == 1
    assert "01.jpg: turn: only" in err
    assert "00.jpg, at least 12 are needed, and so it is with 23 of 24" in err
    assert "a room with detail" in err
    assert camera.read_text() == before
    status, out, err = run(*paths, "--output", camera, "--step-deg", "-15", "--json")
    assert status == 0, err
    assert error_of(json.loads(out)[0]["rolloff"]) < 0.03


def test_what_is_wrong_is_said(tmp_path, camera):
    flat = tmp_path / "flat.camera"
    flat.write_text("[camera]\nprojection = equirect\nwidth_px = 640\nheight_px = 320\n")
    blank, small = tmp_path / "blank.png", tmp_path / "small.png"
    cv2.imwrite(str(blank), np.full((SIZE, SIZE, 3), 128, np.uint8))
    cv2.imwrite(str(small), np.full((48, 64, 3), 128, np.uint8))
    for arguments, words in (
        ([blank], "name the camera file"),
        ([blank, "--camera", flat], "run lightprobe calibrate lens first"),
        ([blank, "--camera", tmp_path / "none.camera"], "No such file"),
        ([tmp_path / "none.jpg", "--camera", camera], "no such file"),
        ([blank, small, "--camera", camera], "64x48, the others are 640x640"),
        ([blank] * 5 + ["--camera", camera], "5 pictures, at least 6 are needed"),
        # Not turned: nothing is seen at two angles.
        ([blank] * 8 + ["--camera", camera, "--step-deg", "0"], "no place is seen twice"),
    ):
        status, _, err = run(*arguments)
        assert status != 0, words
        assert words in err


@pytest.mark.nightly
def test_pictures_after_a_plain_wall_are_placed_by_what_was_seen_before_it(tmp_path):
    """Turned twice around; of the first turn, half shows a plain wall only."""
    paths = shoot(tmp_path, walls(posters=400), count=48, nod_deg=0)
    pictures = [cv2.imread(str(path))[..., ::-1] for path in paths]
    for number in range(8, 20):
        pictures[number] = np.full_like(pictures[number], 90)
    camera = Camera("dark", SIZE, SIZE, (LENS,))
    numbers, turned = turned_pictures.rotations(pictures, camera, [path.name for path in paths])
    assert numbers == [*range(8), *range(20, 48)]
    assert geometry.angle_deg(turned[-1] @ [0, 0, -1], turned[numbers.index(23)] @ [0, 0, -1]) < 3
