"""OpenEXR pictures: the right layer, colour and place, or a refusal that names what it is."""

import numpy as np
import OpenEXR
import pytest
from float_scene import FILES, TO_XYZ, draw, light
from lightprobe.errors import ImageError
from lightprobe.imaging import image, primaries

SCENE = draw(64)
ACESCG = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
WINDOWS = ("cropped.exr", "cropped_nadir.exr")
OTHER = ("deep.exr", "lamp_is_inf.exr", "nan_inf_negative.exr", "uint.exr")
OTHER_COLOURS = "aces_ap0.exr"


def planes(pixels, prefix="", names="RGB", kind=np.float32):
    """Channels of a layer."""
    return {
        f"{prefix}{name}": np.ascontiguousarray(pixels[..., i].astype(kind))
        for i, name in enumerate(names)
    }


def header(**more):
    return {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | more


def write(path, channels, **more):
    with OpenEXR.File(header(**more), channels) as file:
        file.write(str(path))
    return path


def write_parts(path, parts):
    """`parts`: name, channels of each."""
    made = [OpenEXR.Part(header(), channels, name) for name, channels in parts]
    with OpenEXR.File(made) as file:
        file.write(str(path))
    return path


def test_the_scene_of_every_file():
    right = light(draw())
    for path in sorted((FILES / "exr").glob("*.exr")):
        if path.name in (*WINDOWS, *OTHER, OTHER_COLOURS):
            continue
        assert light(image.read(path).radiance) == pytest.approx(right, rel=0.02), path


@pytest.mark.parametrize("name", WINDOWS)
def test_files_that_fill_a_part_of_the_display_window(name):
    seen = image.read(FILES / "exr" / name)
    scene = draw(seen.radiance.shape[1])
    missing = np.isnan(seen.radiance).any(axis=-1)
    assert np.array_equal(missing, seen.unseen)
    assert 0.01 < missing.mean() < 0.99
    assert seen.radiance[~missing] == pytest.approx(scene[~missing], rel=0.01)
    assert any("the rest is not seen" in note for note in seen.notes)


@pytest.mark.parametrize(("left", "top"), [(5, 3), (-4, 2), (7, -3), (-2, -9)])
def test_other_windows(tmp_path, left, top):
    """The data window lies anywhere: what is beyond the display window is cut off."""
    data = np.array([[left, top], [left + 63, top + 31]], np.int32)
    display = np.array([[0, 0], [63, 31]], np.int32)
    windows = {"dataWindow": tuple(map(tuple, data)), "displayWindow": tuple(map(tuple, display))}
    seen = image.read(write(tmp_path / "x.exr", planes(SCENE), **windows)).radiance
    for y, x in np.ndindex(32, 64):
        inside = 0 <= y - top < 32 and 0 <= x - left < 64
        right = SCENE[y - top, x - left] if inside else np.full(3, np.nan)
        assert np.array_equal(seen[y, x], right, equal_nan=True)


def test_a_display_window_beyond_all_memory_is_named(tmp_path):
    windows = {"displayWindow": ((0, 0), (1 << 20, 1 << 20))}
    with pytest.raises(ImageError, match="display window is 1048577×1048577: expected at most"):
        image.read(write(tmp_path / "x.exr", planes(SCENE), **windows))


def test_windows_that_do_not_meet_are_named(tmp_path):
    windows = {"dataWindow": ((100, 0), (163, 31)), "displayWindow": ((0, 0), (63, 31))}
    with pytest.raises(ImageError, match="data window lies outside"):
        image.read(write(tmp_path / "x.exr", planes(SCENE), **windows))


@pytest.mark.parametrize("stated", [primaries.REC709, ACESCG])
def test_luminance_and_chroma(tmp_path, stated):
    """The chroma of luminance_chroma.exr has half the size; the library cannot write that."""
    grey_step = np.where(np.arange(64)[None, :, None] < 32, 1.0, 4.0)
    scene = (np.array([0.5, 0.4, 0.3]) * grey_step).repeat(32, axis=0)
    rgb = scene @ np.linalg.inv(primaries.to_rec709(stated)).T
    y = rgb @ primaries.rgb_to_xyz(stated)[1]
    ry, by = (rgb[..., c] / y - 1 for c in (0, 2))
    channels = planes(np.stack([y, ry, by], axis=-1), names=("Y", "RY", "BY"))
    path = write(tmp_path / "x.exr", channels, chromaticities=stated)
    assert image.read(path).radiance == pytest.approx(scene, rel=0.01)


def test_xyz(tmp_path):
    path = write(tmp_path / "x.exr", planes(SCENE @ TO_XYZ.T, names="XYZ"))
    assert image.read(path).radiance == pytest.approx(SCENE, rel=0.01)


def test_other_chromaticities(tmp_path):
    pixels = SCENE @ np.linalg.inv(primaries.to_rec709(ACESCG)).T
    seen = image.read(write(tmp_path / "x.exr", planes(pixels), chromaticities=ACESCG))
    assert seen.radiance == pytest.approx(SCENE, rel=0.01)
    assert any("Rec. 709" in note for note in seen.notes)


def test_chromaticities_of_zeros_state_nothing(tmp_path):
    path = write(tmp_path / "x.exr", planes(SCENE), chromaticities=(0.0,) * 8)
    seen = image.read(path)
    assert seen.radiance == pytest.approx(SCENE, rel=0.01)
    assert not seen.notes


def test_chromaticities_that_are_none_are_named(tmp_path):
    path = write(tmp_path / "x.exr", planes(SCENE), chromaticities=(0.3,) * 8)
    with pytest.raises(ImageError, match="chromaticities: red, green and blue lie on one line"):
        image.read(path)


@pytest.mark.parametrize("name", ["ViewLayer.Combined", "rgba", "beauty", "C"])
def test_the_picture_among_layers(tmp_path, name):
    channels = planes(SCENE, f"{name}.") | planes(SCENE * 0 + 1, "AO.")
    channels |= planes(SCENE * 0 + 2, "ViewLayer.Normal.", "XYZ")
    seen = image.read(write(tmp_path / "x.exr", channels))
    assert seen.radiance == pytest.approx(SCENE, rel=0.01)
    assert any(name in note and "AO" in note for note in seen.notes)


def test_layers_of_which_none_is_the_picture_are_named(tmp_path):
    path = write(tmp_path / "x.exr", planes(SCENE, "left_lamp.") | planes(SCENE, "right_lamp."))
    with pytest.raises(ImageError, match="left_lamp, right_lamp: which is the picture"):
        image.read(path)


@pytest.mark.parametrize("order", [1, -1])
def test_the_picture_among_parts(tmp_path, order):
    parts = [("depth", {"Z": np.ascontiguousarray(SCENE[..., 0])}), ("beauty", planes(SCENE))]
    seen = image.read(write_parts(tmp_path / "x.exr", parts[::order]))
    assert seen.radiance == pytest.approx(SCENE, rel=0.01)


def test_deep_files_are_named():
    with pytest.raises(ImageError, match=r"deep samples.*flatten the picture first"):
        image.read(FILES / "exr" / "deep.exr")


@pytest.mark.parametrize("value", [np.inf, 65504.0])
@pytest.mark.parametrize("stated", [primaries.REC709, ACESCG])
def test_full_scale_of_half_floats_is_saturated(tmp_path, value, stated):
    pixels = SCENE.copy()
    pixels[10, 20] = value
    path = write(tmp_path / "x.exr", planes(pixels, kind=np.float16), chromaticities=stated)
    seen = image.read(path).radiance
    assert np.isposinf(seen[10, 20]).all()
    assert np.isfinite(seen).sum() == seen.size - 3


def test_full_scale_of_halfs_is_a_number_among_floats(tmp_path):
    pixels = SCENE.copy()
    pixels[10, 20] = 65504
    assert image.read(write(tmp_path / "x.exr", planes(pixels))).radiance[10, 20, 1] == 65504


def test_black_and_transparent_is_unseen(tmp_path):
    pixels = np.concatenate([SCENE, np.ones_like(SCENE[..., :1])], axis=-1)
    pixels[20:] = 0
    seen = image.read(write(tmp_path / "x.exr", planes(pixels, names="RGBA")))
    assert seen.unseen[20:].all()
    assert not seen.unseen[:20].any()
    assert np.isfinite(seen.radiance[:20]).all()
    assert "transparent pixels are not seen" in seen.notes


def test_alpha_that_is_zero_everywhere_tells_nothing(tmp_path):
    """Some programs write it so: black is black then."""
    pixels = np.concatenate([SCENE, np.zeros_like(SCENE[..., :1])], axis=-1)
    pixels[20:] = 0
    seen = image.read(write(tmp_path / "x.exr", planes(pixels, names="RGBA")))
    assert seen.unseen is None
    assert not seen.radiance[20:].any()


def test_light_before_nothing_is_light(tmp_path):
    """Of a glow alpha is 0, and its light is there."""
    pixels = np.concatenate([SCENE, np.ones_like(SCENE[..., :1])], axis=-1)
    pixels[5, :, 3] = 0
    assert image.read(write(tmp_path / "x.exr", planes(pixels, names="RGBA"))).unseen is None


def test_a_cube_is_named(tmp_path):
    path = write(tmp_path / "x.exr", planes(SCENE), envmap=OpenEXR.ENVMAP_CUBE)
    with pytest.raises(ImageError, match="a cube: expected a latitude-longitude map"):
        image.read(path)


@pytest.mark.parametrize("factor", [1.0, 1e-4, 300.0, 1e-7])
def test_what_is_written_is_read(tmp_path, factor):
    """Half floats where they are fine enough, else floats."""
    (tmp_path / "x.exr").write_bytes(image.encode(".exr", SCENE * factor))
    assert image.read(tmp_path / "x.exr").radiance == pytest.approx(SCENE * factor, rel=1e-3)
