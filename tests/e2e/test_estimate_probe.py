"""`lightprobe estimate --probe`: balls on a board, in pictures that are traced ray by ray."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import ball_scene
import numpy as np
import pytest
from lightprobe.calibrate import lens_board
from lightprobe.cli import estimate_probe
from lightprobe.cli.estimate_probe import Options
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.estimate import EstimateFlag
from lightprobe.evaluate import offline
from lightprobe.geometry import angle_deg
from lightprobe.imaging import image
from lightprobe.probe import diffuse, kinds
from PIL import Image

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
SEED = 2
SETTINGS = offline.Settings(preset="accurate", lights=8)


class Pictured:
    """A ball in a room, its picture, and the truth."""

    def __init__(self, folder, surface="chrome"):
        panorama, self.lamps = ball_scene.room(100 + SEED)
        board = lens_board.Board().draw(40)
        scene = ball_scene.Scene(panorama, board, surface=surface)
        self.camera = ball_scene.Camera.before(scene, 160, SEED, 640, 480)
        self.radiance = self.camera.render(scene, 3)
        self.centre = self.camera.place(scene.centre)
        random = np.random.default_rng(1)
        self.codes = ball_scene.expose(self.radiance, 0.3 / np.median(self.radiance), random)
        self.irradiance = scene.irradiance(ball_scene.fibonacci(162))
        self.float = folder / f"{surface}.pfm"
        image.write_pfm(self.float, self.radiance)

    def options(self, **changes):
        usual = Options("ball:60mm", self.camera.intrinsics, square_mm=ball_scene.SQUARE_MM)
        return dataclasses.replace(usual, **changes)

    def estimate(self, file=None, exposures=(), **changes):
        return estimate_probe.estimate(
            [file or self.float], exposures, SETTINGS, self.options(**changes)
        )


@pytest.fixture(scope="module")
def mirror(tmp_path_factory):
    return Pictured(tmp_path_factory.mktemp("mirror"))


def saved(tmp_path, codes, name="picture.png"):
    Image.fromarray(np.ascontiguousarray(codes)).save(tmp_path / name)
    return tmp_path / name


def assert_lamps(estimate, true, limit_deg=0.8):
    for lamp in true:
        best = min(estimate.lights, key=lambda light: angle_deg(light.direction, lamp))
        off_deg = float(angle_deg(best.direction, lamp))
        assert off_deg < limit_deg
        assert off_deg < 3 * best.direction_sigma_deg


def test_a_mirror_ball_gives_lamps_and_light_in_the_boards_frame(mirror):
    once = mirror.estimate()
    assert_lamps(once.estimate, mirror.lamps)
    assert once.estimate.flags & EstimateFlag.PARTIAL_VIEW
    assert once.log == []
    made = once.estimate.irradiance(ball_scene.fibonacci(162))
    off = np.abs(made - mirror.irradiance) / mirror.irradiance.max(axis=0)
    assert off.mean() < 0.025  # also the scale: what chrome mirrors is divided out


def test_the_saved_camera_file_serves_the_daemon(mirror, tmp_path):
    file = tmp_path / "ball.camera"
    first = mirror.estimate(save_camera=file).estimate
    whole = offline.estimate_files(
        [mirror.float], (), dataclasses.replace(SETTINGS, camera=str(file))
    )[0]
    assert len(whole.lights) == len(first.lights)
    for a, b in zip(first.lights, whole.lights, strict=True):
        assert angle_deg(a.direction, b.direction) < 0.05


def test_without_a_board_the_frame_is_the_cameras(mirror):
    once = mirror.estimate(board="none")
    assert_lamps(once.estimate, np.array(mirror.lamps) @ mirror.camera.axes.T)


def test_a_wrong_diameter_is_noted_and_changes_no_direction(mirror):
    once = mirror.estimate(probe="ball:90mm")
    assert "60 mm across, not 90" in " ".join(once.log)
    assert_lamps(once.estimate, mirror.lamps)


def test_mirrored_pictures_are_refused(mirror, tmp_path):
    with pytest.raises(LightprobeError, match="mirrored"):
        mirror.estimate(saved(tmp_path, mirror.codes[:, ::-1]))


def test_no_board_is_said(mirror, tmp_path):
    codes = mirror.codes.copy()
    x, y = mirror.centre
    row, column = np.mgrid[:480, :640]
    codes[np.hypot(column - x, row - y) > 100] = (90, 120, 100)
    with pytest.raises(LightprobeError, match="--board none"):
        mirror.estimate(saved(tmp_path, codes))


def test_half_a_ball_is_refused(mirror, tmp_path):
    x, y = mirror.centre
    cut = mirror.codes[:, int(x) - 30 :]
    with pytest.raises(LightprobeError, match="outside of the picture"):
        mirror.estimate(saved(tmp_path, cut), board="none", at=f"31,{y:.0f},80")


def test_no_ball_is_said(tmp_path):
    codes = np.tile(np.linspace(40, 200, 640).astype(np.uint8)[None, :, None], (480, 1, 3))
    options = Options("ball:60mm", "600,600,320,240", "none")
    with pytest.raises(LightprobeError, match="no outline of a ball"):
        estimate_probe.estimate([saved(tmp_path, codes)], (), SETTINGS, options)


def test_an_overexposed_ball_is_refused(mirror, tmp_path):
    codes = ball_scene.expose(
        mirror.radiance, 4 / np.median(mirror.radiance), np.random.default_rng(1)
    )
    with pytest.raises(LightprobeError, match="overexposed"):
        mirror.estimate(
            saved(tmp_path, codes), board="none",
            at=f"{mirror.centre[0]:.0f},{mirror.centre[1]:.0f},80",
        )  # fmt: skip


def test_clipped_lamps_are_noted(mirror, tmp_path):
    once = mirror.estimate(saved(tmp_path, mirror.codes))
    assert any("add a shorter one" in note for note in once.log)
    assert once.estimate.flags & EstimateFlag.CLIPPED


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"probe": "cube:60mm"}, "ball:DIAMETER"),
        ({"probe": "ball:60mm,wood"}, "black"),
        ({"probe": "ball:1mm"}, "5 mm to 2 m"),
        ({"intrinsics": "600,600"}, "FX,FY,CX,CY"),
        ({"intrinsics": None}, "no focal length in its Exif"),
        ({"at": "1,2"}, "X,Y,RADIUS"),
    ],
)
def test_options_that_make_no_sense(mirror, changes, says):
    with pytest.raises(UsageError, match=says):
        mirror.estimate(**changes)


def test_the_command(mirror):
    done = subprocess.run(
        [
            LIGHTPROBE, "estimate", mirror.float, "--probe", "ball:60mm", "--intrinsics",
            mirror.camera.intrinsics,
        ],
        capture_output=True, text=True, timeout=100,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "PARTIAL_VIEW" in done.stdout


def test_a_diffuse_ball_gives_light_within_its_sigma(tmp_path):
    white = Pictured(tmp_path, "white")
    estimate = white.estimate(probe="diffuse-ball:60mm").estimate
    made = estimate.irradiance(ball_scene.fibonacci(162))
    made = made * white.irradiance.mean() / made.mean()
    rms = np.sqrt(np.mean((made - white.irradiance).mean(axis=1) ** 2)) / white.irradiance.mean()
    assert rms < 3 * estimate.relighting_sigma
    assert estimate.flags & EstimateFlag.PARTIAL_VIEW


def test_nnls_finds_lamps_that_the_camera_side_shows():
    normals = ball_scene.fibonacci(2000)
    normals = normals[normals[:, 2] > 0.15]
    lamp = np.array([0.3, 0.6, 0.74]) / np.linalg.norm([0.3, 0.6, 0.74])
    irradiance = np.repeat(1 + 3 * np.maximum(normals @ lamp, 0)[:, None], 3, axis=1)
    light = diffuse.solve(diffuse.Shading(normals, irradiance, np.ones(len(normals))))
    assert angle_deg(light.directions[light.flux[:, 1].argmax()], lamp) < 10
    assert np.all(light.flux >= 0)
    away, towards = np.array([0, 0, -1.0]), np.array([0, 0, 1.0])
    assert light.direction_sigma_deg(away) > light.direction_sigma_deg(towards)


def test_kinds():
    assert kinds.parse("ball:6cm,silver") == kinds.Kind(True, 60, "silver")
    assert not kinds.parse("diffuse-ball:40mm").is_mirror
