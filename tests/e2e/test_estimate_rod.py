"""`lightprobe estimate --probe rod:…`: shadows of a rod on a board, in pictures that are traced."""

import dataclasses

import ball_scene
import numpy as np
import pytest
import rod_scene
from lightprobe.calibrate import lens_board
from lightprobe.cli import estimate_probe
from lightprobe.cli.estimate_probe import Options
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.estimate import EstimateFlag
from lightprobe.evaluate import offline
from lightprobe.geometry import angle_deg
from lightprobe.probe import kinds
from PIL import Image

SETTINGS = offline.Settings(preset="accurate", lights=8)
#: Azimuth, elevation, radius in degrees, irradiance of a surface that faces it.
HIGH, LOW, BEHIND = (70.0, 55.0, 1.5, 3.0), (-120.0, 48.0, 2.5, 1.5), (10.0, 9.0, 1.5, 4.0)


def toward(azimuth_deg, elevation_deg):
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    return np.array([
        np.sin(azimuth) * np.cos(elevation), np.sin(elevation), -np.cos(azimuth) * np.cos(elevation)
    ])  # fmt: skip


class Pictured:
    """A rod under lamps, its picture, and the truth."""

    def __init__(self, *lamps, even=0.3, seed=3):
        directions = ball_scene.panorama_directions(768)[0]
        panorama = np.full((*directions.shape[:2], 3), even)
        for azimuth_deg, elevation_deg, radius_deg, irradiance in lamps:
            radius = np.radians(radius_deg)
            inside = directions @ toward(azimuth_deg, elevation_deg) > np.cos(radius)
            panorama[inside] += irradiance / (np.pi * radius**2)
        board = lens_board.Board().draw(40)
        self.scene = rod_scene.RodScene(
            panorama, board, ball_mm=(125.0, 100.0), height_mm=50.0, noise=0.02
        )
        self.camera = ball_scene.Camera.before(self.scene, 22, seed, 960, 720)
        self.radiance = self.camera.render(self.scene, 2)

    def codes(self, brightest=0.85):
        scale = brightest / self.scene.paper.max()
        return ball_scene.expose(self.radiance, scale, np.random.default_rng(1))

    def estimate(self, folder, codes=None, **changes):
        file = folder / "picture.png"
        Image.fromarray(self.codes() if codes is None else codes).save(file)
        usual = Options("rod:50mm,8mm@5,4", self.camera.intrinsics, square_mm=ball_scene.SQUARE_MM)
        options = dataclasses.replace(usual, **changes)
        return estimate_probe.estimate([file], (), SETTINGS, options)


@pytest.fixture(scope="module")
def two():
    return Pictured(HIGH, LOW)


@pytest.fixture(scope="module")
def once(two, tmp_path_factory):
    return two.estimate(tmp_path_factory.mktemp("two"))


def assert_lamps(found, limit_deg=0.5):
    assert len(found.lights) == 2
    for azimuth_deg, elevation_deg, _, _ in (HIGH, LOW):
        true = toward(azimuth_deg, elevation_deg)
        best = min(found.lights, key=lambda light: angle_deg(light.direction, true))
        assert angle_deg(best.direction, true) < limit_deg
        assert 0.5 < best.direction_sigma_deg < 1.5  # by how high and how upright it stands


def test_two_lamps_are_found_by_their_shadows(two, once):
    found = once.estimate
    assert_lamps(found)
    for azimuth_deg, elevation_deg, radius_deg, irradiance in (HIGH, LOW):
        true = toward(azimuth_deg, elevation_deg)
        best = min(found.lights, key=lambda light: angle_deg(light.direction, true))
        assert best.angular_radius_deg == pytest.approx(radius_deg, rel=0.5)
        # Values are relative to full scale: the paper's brightest is 0.85 of it in the picture.
        scale = 0.85 / two.scene.paper.max()
        assert best.irradiance / scale == pytest.approx(irradiance, rel=0.15)
    assert found.flags & EstimateFlag.PARTIAL_VIEW
    assert 0.02 < found.relighting_sigma < 0.4
    assert once.log == []


def test_a_shadow_that_leaves_the_board_is_said_and_widens_the_sigma(once, tmp_path):
    low = Pictured(HIGH, BEHIND).estimate(tmp_path)
    assert any("leaves the board" in note for note in low.log)
    assert len(low.estimate.lights) == 1
    assert angle_deg(low.estimate.lights[0].direction, toward(*HIGH[:2])) < 0.5
    assert low.estimate.relighting_sigma > 1.5 * once.estimate.relighting_sigma


def test_light_without_a_lamp_is_refused(tmp_path):
    with pytest.raises(LightprobeError, match="no whole shadow"):
        Pictured().estimate(tmp_path)


def test_paper_that_clips_is_refused(two, tmp_path):
    with pytest.raises(LightprobeError, match="overexposed: expose less"):
        two.estimate(tmp_path, two.codes(brightest=1.6))


def test_what_does_not_fit_a_rod_is_refused(two, tmp_path):
    codes = two.codes()
    blank = np.full_like(codes, 128)
    with pytest.raises(LightprobeError, match="no board is found"):
        two.estimate(tmp_path, blank)
    for options, said in (
        ({"square_mm": None}, "give --square-mm"), ({"board": "none"}, "needs the printed board"),
        ({"probe": "rod:50mm,8mm@12,4"}, "beside the board"),
        ({"square_mm": 2.5}, "correct --square-mm"),
        ({"save_camera": tmp_path / "x.camera"}, "are for balls"),
    ):  # fmt: skip
        with pytest.raises(UsageError, match=said):
            two.estimate(tmp_path, codes, **options)


def test_a_rod_a_little_off_its_place_is_found_there(two, tmp_path):
    assert_lamps(two.estimate(tmp_path, probe="rod:50mm,8mm@5.04,3.96").estimate, limit_deg=1.2)


def test_a_rod_that_stands_elsewhere_is_refused(two, tmp_path):
    with pytest.raises(LightprobeError, match="from what the rod's shadows explain"):
        two.estimate(tmp_path, probe="rod:50mm,8mm@3,2")


@pytest.mark.parametrize("text", [
    "rod:50mm", "rod:50,8", "rod:50mm,40mm", "rod:1mm,1mm", "rod:5m,8mm", "rod:50mm,8mm@5",
    "rod:50mm,8mm@-1,4", "rod:nanmm,8mm", "",
])  # fmt: skip
def test_a_rod_that_is_none(text):
    with pytest.raises(UsageError, match="--probe"):
        kinds.parse(text)


def test_units_of_a_rod():
    assert kinds.parse("rod:5cm,0.8cm") == kinds.Upright(50.0, 8.0, None)
    assert kinds.parse("rod:50mm,8mm@5,4.5") == kinds.Upright(50.0, 8.0, (5.0, 4.5))
