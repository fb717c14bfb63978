"""`lightprobe estimate --probe dodecahedron:…`: a folded net, in pictures that are traced."""

import dataclasses

import ball_scene
import cv2
import dodecahedron_scene as scenes
import numpy as np
import pytest
from lightprobe.calibrate import lens_board
from lightprobe.cli import estimate_solid, net
from lightprobe.cli.estimate_probe import Options
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.estimate import EstimateFlag
from lightprobe.evaluate import offline
from lightprobe.geometry import angle_deg
from lightprobe.imaging import image
from lightprobe.probe.dodecahedron import kind
from lightprobe.probe.dodecahedron import net as nets
from PIL import Image

SETTINGS = offline.Settings(preset="accurate", lights=8)
EDGE_MM, SIZE_PX = 30.0, (480, 360)
LAMP = np.array([0.55, 0.6, 0.58])
LAMP = LAMP / np.linalg.norm(LAMP)
FAR_MM = 3000.0
TURNS = (0.4, 2.1, 4.4)


@pytest.fixture(scope="module")
def sheets():
    return scenes.pages(nets, EDGE_MM)


class Held:
    """A solid that is turned before a still camera: pictures, and the truth."""

    def __init__(self, sheets, towards=LAMP, even=0.2, turns=TURNS, **more):
        self.scenes, self.radiance = [], []
        for turned in turns:
            turn = scenes.about(LAMP, turned) @ scenes.about(np.array([0, 0.6, 0.8]), 2 * turned)
            lamps = [] if towards is None else [(
                FAR_MM * np.asarray(towards) + [0, 500.0, 0], np.array([1.0, 0.9, 0.8])
            )]  # fmt: skip
            scene = scenes.SolidScene(
                None, None, ball_mm=(0.0, 0.0), height_mm=500.0, net=sheets, turn=turn,
                edge_mm=EDGE_MM, has_board=False, even=np.full(3, even), lamps=lamps,
                folds=0.3, **more,
            )  # fmt: skip
            eye = scene.centre + np.array([0, 0, 450.0])
            self.camera = ball_scene.Camera(*SIZE_PX, 1050.0, eye, np.eye(3))
            self.scenes.append(scene)
            self.radiance.append(self.camera.render(scene, 2))

    def codes(self, brightest=0.75):
        top = max(scene.far_irradiance.max() for scene in self.scenes)
        scale = brightest * np.pi / scenes.ALBEDO / top
        random = np.random.default_rng(1)
        return [ball_scene.expose(picture, scale, random) for picture in self.radiance]

    def estimate(self, folder, codes=None, **changes):
        codes = self.codes() if codes is None else codes
        files = []
        for number, picture in enumerate(codes):
            files.append(folder / f"{number}.png")
            Image.fromarray(picture).save(files[-1], compress_level=1)
        usual = Options(f"dodecahedron:{EDGE_MM:g}mm", self.camera.intrinsics, "none")
        options = dataclasses.replace(usual, **changes)
        return estimate_solid.estimate(files, [1000.0] * len(files), SETTINGS, options)


@pytest.fixture(scope="module")
def held(sheets):
    return Held(sheets)


@pytest.fixture(scope="module")
def once(held, tmp_path_factory):
    return held.estimate(tmp_path_factory.mktemp("held"))


def test_three_pictures_give_the_direction_and_a_sigma_that_covers_it(once):
    found = once.estimate
    assert len(found.lights) == 1
    off_deg = angle_deg(found.lights[0].direction, LAMP)
    assert off_deg < 2
    assert off_deg < 3 * found.lights[0].direction_sigma_deg < 30
    assert found.flags & EstimateFlag.PARTIAL_VIEW
    assert 0.05 < found.relighting_sigma < 0.6
    assert once.log == []


def test_strength_and_colour_of_the_lamp(once, held):
    scale = 0.75 * np.pi / scenes.ALBEDO / max(s.far_irradiance.max() for s in held.scenes)
    lamp = once.estimate.lights[0]
    # Values are per second of exposure: 1 ms here.
    strength = lamp.irradiance / scale / 1000
    assert strength == pytest.approx([1.0, 0.9, 0.8], rel=0.12)
    assert np.all(lamp.irradiance_sigma > 0.05 * lamp.irradiance)


def test_one_picture_gives_less_and_says_so(held, once, tmp_path):
    found = held.estimate(tmp_path, held.codes()[:1]).estimate
    lamp = found.lights[0]
    assert lamp.direction_sigma_deg > once.estimate.lights[0].direction_sigma_deg
    assert angle_deg(lamp.direction, LAMP) < 3 * lamp.direction_sigma_deg


@pytest.mark.parametrize("even", [0.2, 0.1])
def test_light_from_behind_is_hardly_known_and_is_told(sheets, tmp_path, even):
    behind = Held(sheets, towards=[0.1, 0.05, -0.99], turns=TURNS[:2], even=even)
    once = behind.estimate(tmp_path)
    found = once.estimate
    assert found.flags & EstimateFlag.PARTIAL_VIEW
    assert once.log  # no lamp stands out, or one whose direction is hardly known
    assert all(lamp.direction_sigma_deg > 8 for lamp in found.lights)
    scale = 0.75 * np.pi / scenes.ALBEDO / max(s.far_irradiance.max() for s in behind.scenes)
    normals = ball_scene.fibonacci(200)
    made = found.irradiance(normals) / scale / 1000
    off = (made - behind.scenes[0].irradiance(normals)).mean(axis=1)
    assert np.sqrt(np.mean(off**2)) < 3 * found.relighting_sigma * made.mean()


def test_a_lamp_of_two_colours_is_found(held, tmp_path):
    codes = held.codes()
    for one in codes:
        one[..., 2] = 0
    lamp = held.estimate(tmp_path, codes).estimate.lights[0]
    assert angle_deg(lamp.direction, LAMP) < 5
    assert lamp.irradiance[2] < 0.05 * lamp.irradiance[0]


@pytest.mark.parametrize("changes", [
    {"probe": "dodecahedron:700mm"}, {"probe": "dodecahedron:999mm"},
])  # fmt: skip
def test_every_edge_that_is_taken_can_be_used(held, tmp_path, changes):
    lamp = held.estimate(tmp_path, **changes).estimate.lights[0]
    assert angle_deg(lamp.direction, LAMP) < 3 * lamp.direction_sigma_deg


@pytest.mark.parametrize("intrinsics", [
    "1050,1050,240,180,1e9,0,0,0", "1e9,1e9,240,180", "1e-300,1e-300,240,180",
    "1e300,1e300,240,180",
])  # fmt: skip
def test_a_camera_that_cannot_be_is_told(held, tmp_path, intrinsics):
    with pytest.raises(LightprobeError, match=r"--intrinsics|dodecahedron"):
        held.estimate(tmp_path, held.codes()[:1], intrinsics=intrinsics)


def test_pictures_of_high_range_have_one_scale(held, tmp_path):
    files = []
    for number, radiance in enumerate(held.radiance[:2]):
        files.append(tmp_path / f"{number}.pfm")
        image.write_pfm(files[-1], radiance.astype(np.float32))
    options = Options(f"dodecahedron:{EDGE_MM:g}mm", held.camera.intrinsics, "none")
    lamp = estimate_solid.estimate(files, (), SETTINGS, options).estimate.lights[0]
    assert angle_deg(lamp.direction, LAMP) < 3 * lamp.direction_sigma_deg
    with pytest.raises(UsageError, match="pictures of high range hold radiance"):
        estimate_solid.estimate(files, [1000.0, 4000.0], SETTINGS, options)
    Image.fromarray(held.codes()[2]).save(tmp_path / "2.png")
    with pytest.raises(UsageError, match="give those of one kind"):
        estimate_solid.estimate([*files, tmp_path / "2.png"], [1.0] * 3, SETTINGS, options)


def test_glossy_paper_of_a_known_roughness(sheets, tmp_path):
    glossy = Held(sheets, roughness=0.4, turns=TURNS[:2])
    found = glossy.estimate(tmp_path, probe=f"dodecahedron:{EDGE_MM:g}mm,roughness=0.4")
    off_deg = angle_deg(found.estimate.lights[0].direction, LAMP)
    assert off_deg < 5
    assert off_deg < 3 * found.estimate.lights[0].direction_sigma_deg
    fit = f"dodecahedron:{EDGE_MM:g}mm,roughness=fit"
    fitted = glossy.estimate(tmp_path, glossy.codes()[:1], probe=fit)
    assert any(note.startswith("what fits best: ") for note in fitted.log)


def test_the_board_is_the_frame(sheets, tmp_path):
    directions = ball_scene.panorama_directions(512)[0]
    panorama = np.full((*directions.shape[:2], 3), 0.2)
    panorama[directions @ LAMP > np.cos(np.radians(3))] += 2 / (np.pi * np.radians(3) ** 2)
    board = lens_board.Board().draw(40)
    scene = scenes.SolidScene(
        panorama, board, net=sheets, turn=scenes.lying(3, 1.0), edge_mm=EDGE_MM,
        ball_mm=(215.0, 150.0),
    )  # fmt: skip
    scale = 0.8 * np.pi / scenes.ALBEDO / scene.far_irradiance.max()
    camera = ball_scene.Camera.before(scene, 170, 5, 800, 600)
    codes = ball_scene.expose(camera.render(scene, 2), scale, np.random.default_rng(5))
    file = tmp_path / "picture.png"
    Image.fromarray(codes).save(file, compress_level=1)
    options = Options("dodecahedron:30mm", camera.intrinsics, "11x8", 25.0)
    once = estimate_solid.estimate([file], (), SETTINGS, options)
    lamp = once.estimate.lights[0]
    assert angle_deg(lamp.direction, LAMP) < min(12, 3 * lamp.direction_sigma_deg)
    assert not any("by the board" in note for note in once.log)
    wrong = dataclasses.replace(options, probe="dodecahedron:20mm")
    once = estimate_solid.estimate([file], (), SETTINGS, wrong)
    assert any("edges of 30 mm, not 20" in note for note in once.log)


def test_pictures_that_do_not_show_it_are_refused(held, tmp_path):
    first = held.codes()[0]
    for codes, said in (
        (np.full_like(first, 128), "no dodecahedron is found"),
        (np.ascontiguousarray(first[:, ::-1]), "the dodecahedron is mirrored"),
        (np.full_like(first, 255), "no dodecahedron is found"),
        (np.tile(first[::2, ::2], (2, 2, 1)), "is seen twice"),
    ):
        with pytest.raises(LightprobeError, match=said):
            held.estimate(tmp_path, [codes])


def test_a_sheet_that_is_glued_a_face_further_is_refused(sheets, tmp_path):
    middle = ((sheets[1].shape[1] - 1) / 2, (sheets[1].shape[0] - 1) / 2)
    turn = cv2.getRotationMatrix2D(middle, 72, 1)
    further = cv2.warpAffine(sheets[1], turn, sheets[1].shape[::-1], borderValue=(1.0,))
    with pytest.raises(LightprobeError, match="contradict each other"):
        Held([sheets[0], further], turns=TURNS[:1]).estimate(tmp_path)


def test_overexposed_faces_are_told_or_refused(held, tmp_path):
    with pytest.raises(LightprobeError, match="overexposed"):
        held.estimate(tmp_path, held.codes(brightest=40.0)[:1])
    some = held.estimate(tmp_path, held.codes(brightest=1.15))
    assert any("overexposed: it is left out" in note for note in some.log)


def test_a_shadow_on_the_faces_is_told_or_widens_the_sigma(sheets, tmp_path):
    shaded = Held(sheets, shadow=(np.array([1.0, 0.3, 0]), 5.0), turns=TURNS[:2])
    shaded = shaded.estimate(tmp_path)
    assert any("lit unevenly" in note or "differ by" in note for note in shaded.log)
    lamp = shaded.estimate.lights[0] if shaded.estimate.lights else None
    if lamp is not None:
        assert angle_deg(lamp.direction, LAMP) < 3 * lamp.direction_sigma_deg


def test_a_covered_picture_among_others_is_left_out(held, tmp_path):
    codes = held.codes()
    codes[1] = np.full_like(codes[1], 90)
    once = held.estimate(tmp_path, codes)
    assert any("it is left out" in note for note in once.log)
    assert angle_deg(once.estimate.lights[0].direction, LAMP) < 5


@pytest.mark.parametrize("text", [
    "dodecahedron", "dodecahedron:30", "dodecahedron:1mm", "dodecahedron:nanmm",
    "dodecahedron:30mm,roughness=2", "dodecahedron:30mm,black",
])  # fmt: skip
def test_a_dodecahedron_that_is_none(text):
    with pytest.raises(UsageError, match="--probe"):
        kind.parse(text)


def test_a_net_has_no_roughness(tmp_path):
    with pytest.raises(UsageError, match="a net has no roughness"):
        net.command("dodecahedron:30mm,roughness=fit", tmp_path / "x.pdf")


def test_the_net_is_written_and_bounded(tmp_path):
    file = tmp_path / "net.pdf"
    net.command("dodecahedron:30mm", file)
    assert file.read_bytes().startswith(b"%PDF")
    with pytest.raises(UsageError, match="an edge is 12 to 44 mm"):
        net.command("dodecahedron:60mm", file)


def test_several_pictures_need_exposures(held, tmp_path):
    file = tmp_path / "a.png"
    Image.fromarray(held.codes()[0]).save(file)
    options = Options("dodecahedron:30mm", held.camera.intrinsics, "none")
    with pytest.raises(UsageError, match="--exposure-us"):
        estimate_solid.estimate([file, file], (), SETTINGS, options)
