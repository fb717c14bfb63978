"""`lightprobe estimate --probe object:…`: things on a board, in pictures that are traced."""

import dataclasses
from pathlib import Path

import ball_scene
import numpy as np
import object_scene
import pytest
import trimesh
from lightprobe.calibrate import lens_board
from lightprobe.cli import estimate_object
from lightprobe.cli.estimate_probe import Options
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.estimate import EstimateFlag
from lightprobe.evaluate import offline
from lightprobe.imaging import image
from lightprobe.probe import diffuse, find, object_samples
from PIL import Image

SETTINGS = offline.Settings(preset="accurate", lights=8)
NORMALS = ball_scene.fibonacci(162)
AT = 130.0 / ball_scene.SQUARE_MM, 100.0 / ball_scene.SQUARE_MM


class Pictured:
    """A ball and a box under two square lights, their picture and their mesh."""

    def __init__(self, folder: Path):
        things = object_scene.still_life(5)[:2]
        panorama = object_scene.area_lights(np.random.default_rng(4), 2, 0.5, width=64)
        self.scene = object_scene.ObjectScene(
            panorama, lens_board.Board().draw(40), things, albedo=(0.6, 0.5, 0.4),
            gathered=100, step_mm=4.0,
        )  # fmt: skip
        self.camera = ball_scene.Camera.before(self.scene, 200, 5, 720, 540)
        self.radiance, self.thing = self.scene.picture(self.camera)
        self.brightest = self.radiance.max()
        self.folder, self.file = folder, folder / "things.glb"
        self.mesh = trimesh.util.concatenate([thing.mesh(3) for thing in things])
        self.mesh.apply_translation([-130.0, 0, -100.0]).apply_scale(1e-3)
        self.mesh.export(self.file)

    def codes(self, radiance=None, brightest=0.85):
        scale = brightest / self.brightest
        picture = self.radiance if radiance is None else radiance
        return ball_scene.expose(picture, scale, np.random.default_rng(1))

    def estimate(self, codes=None, mesh=None, at=AT, more="", **changes):
        picture, file = self.folder / "picture.png", self.file
        Image.fromarray(self.codes() if codes is None else codes).save(picture)
        if mesh is not None:
            file = self.folder / "other.glb"
            mesh.export(file)
        usual = Options(
            f"object:{file}@{at[0]},{at[1]}{more}", self.camera.intrinsics,
            square_mm=ball_scene.SQUARE_MM,
        )  # fmt: skip
        return estimate_object.estimate(
            [picture], (), SETTINGS, dataclasses.replace(usual, **changes)
        )


@pytest.fixture(scope="module")
def things(tmp_path_factory):
    return Pictured(tmp_path_factory.mktemp("things"))


@pytest.fixture(scope="module")
def once(things):
    return things.estimate()


def off(things, found):
    """RMS error of irradiance over normals, relative to its mean."""
    truth = things.scene.irradiance(NORMALS) * 0.85 / things.brightest
    made = found.irradiance(NORMALS)
    return np.sqrt(np.mean((made - truth).mean(axis=1) ** 2)) / truth.mean()


def test_light_is_found_and_the_sigma_covers_its_error(things, once):
    found = once.estimate
    assert off(things, found) < 0.15
    assert off(things, found) < 3 * found.relighting_sigma
    assert found.relighting_sigma < 0.2
    assert found.flags & EstimateFlag.PARTIAL_VIEW


def test_what_the_object_reflects_is_found_and_said(once):
    told = next(note for note in once.log if "reflects" in note)
    albedo = [float(word.strip(",")) for word in told.split()[3:6]]
    assert albedo == pytest.approx([0.6, 0.5, 0.4], rel=0.12)


def test_a_stated_albedo_is_taken(things):
    found = things.estimate(more=",albedo=0.5")
    assert off(things, found.estimate) < 3 * found.estimate.relighting_sigma


def test_a_stated_albedo_that_is_wrong_is_told(things, once):
    found = things.estimate(more=",albedo=0.9")
    assert any("the object seems to reflect 0.5" in note for note in found.log)
    assert not any("seems to reflect" in note for note in once.log)


def test_what_is_no_mesh_is_not_opened(things):
    """An archive may unfold to anything."""
    file = things.folder / "a.zip"
    file.write_bytes(b"PK")
    with pytest.raises(UsageError, match=r"cannot be read as a mesh: expected \.obj"):
        things.estimate(things.codes(), probe=f"object:{file}")


def test_a_mistyped_place_is_told_as_one(things):
    for text in ("a.glb@5,4,+30", "a.glb@-1,4", "a.glb@5.5", "a.glb,Unit=mm"):
        with pytest.raises(UsageError, match="what follows its name is @COLUMN,ROW"):
            things.estimate(things.codes(), probe=f"object:{things.folder}/{text}")
    with pytest.raises(UsageError, match="a turn is"):
        object_samples.parse("object:a.glb@5,4," + "9" * 400)


def test_pixels_that_are_no_numbers_are_not_seen(tmp_path):
    radiance = np.full((8, 16, 3), 0.5, np.float32)
    radiance[2, 3], radiance[4, 5, 1] = np.inf, np.nan
    image.write_pfm(tmp_path / "x.pfm", radiance)
    found, clipped = diffuse.merged([tmp_path / "x.pfm"], ())
    assert np.argwhere(clipped).tolist() == [[2, 3], [4, 5]]
    assert np.isfinite(found).all()
    codes = find.as_codes(tmp_path / "x.pfm")
    assert codes[0, 0].tolist() == [codes[7, 15, 0]] * 3
    assert codes[2, 3].min() == 255


def test_a_textured_object_is_told(things):
    stripes = np.where(np.arange(things.thing.shape[1]) // 8 % 2, 0.4, 1.0)[:, None]
    radiance = np.where(things.thing[..., None], things.radiance * stripes, things.radiance)
    with pytest.raises(LightprobeError, match="is it matt and of one colour"):
        things.estimate(things.codes(radiance))


def test_an_object_that_stands_elsewhere_is_told(things):
    with pytest.raises(LightprobeError, match=r"does (it|the object) stand where it is said to"):
        things.estimate(at=(AT[0] - 1, AT[1] + 0.5))
    with pytest.raises(LightprobeError, match=r"whole in the picture|differs by|too little"):
        things.estimate(at=(0, 8))


def test_a_mesh_that_is_inside_out_is_told(things):
    flipped = things.mesh.copy()
    flipped.invert()
    with pytest.raises(LightprobeError, match="backs of triangles: turn the faces round"):
        things.estimate(mesh=flipped)


def test_a_mesh_with_holes_is_told(things, once):
    holes = things.mesh.copy()
    holes.update_faces(np.arange(len(holes.faces)) % 5 != 0)
    found = things.estimate(mesh=holes)
    assert any("open along" in note for note in found.log)
    assert any("backs of triangles" in note for note in found.log)
    assert off(things, found.estimate) < 3 * found.estimate.relighting_sigma
    assert found.estimate.relighting_sigma > once.estimate.relighting_sigma


def test_pictures_that_clip_or_show_no_board_are_told(things):
    with pytest.raises(LightprobeError, match="overexposed: expose less"):
        things.estimate(things.codes(brightest=1.8))
    with pytest.raises(LightprobeError, match="no board is found"):
        things.estimate(np.full_like(things.codes(), 128))


def test_what_does_not_fit_is_refused(things):
    empty = things.folder / "empty.glb"
    empty.write_bytes(b"")
    for options, said in (
        ({"square_mm": None}, "give --square-mm"), ({"board": "none"}, "needs the printed board"),
        ({"at": (12, 4)}, "beside the board"), ({"more": ",unit=mm"}, "say the mesh's unit"),
        ({"save_camera": things.folder / "x.camera"}, "are for balls"),
        ({"probe": f"object:{empty}"}, "cannot be read as a mesh"),
    ):  # fmt: skip
        with pytest.raises(UsageError, match=said):
            things.estimate(things.codes(), **options)


@pytest.mark.parametrize("text", [
    "object", "object:", "object:a.glb,albedo=0", "object:a.glb,albedo=2", "object:a.glb,unit=ft",
    "object:a.glb,albedo=x",
])  # fmt: skip
def test_an_object_that_is_none(text):
    with pytest.raises(UsageError, match="--probe"):
        object_samples.parse(text)


def test_places_turns_and_units_of_an_object():
    assert object_samples.parse("object:a,b@c.glb@5,4.5,-30,albedo=0.7,unit=cm") == (
        object_samples.Shape(Path("a,b@c.glb"), (5.0, 4.5), -30.0, 0.7, 10.0)
    )
    assert object_samples.parse("object:a.obj") == object_samples.Shape(Path("a.obj"))
