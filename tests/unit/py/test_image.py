"""Pictures in, linear light out."""

import cv2
import numpy as np
import OpenEXR
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from lightprobe import colour
from lightprobe.imaging import image, primaries

RNG = np.random.default_rng(3)
MAP = (RNG.random((16, 32, 3)) * 10).astype(np.float32)


@given(hnp.arrays(np.float32, (3, 5, 3), elements=st.floats(0, 2.0**96, width=32)))
def test_pfm_there_and_back_to_the_bit(tmp_path_factory, pixels):
    path = tmp_path_factory.mktemp("pfm") / "x.pfm"
    image.write_pfm(path, pixels)
    assert np.array_equal(image.read_pfm(path), pixels)


def test_pfm_big_endian_and_grey(tmp_path):
    plane = MAP[..., 0]
    path = tmp_path / "grey.pfm"
    path.write_bytes(b"Pf\n32 16\n1.0\n" + plane[::-1].astype(">f4").tobytes())
    assert np.array_equal(image.read_pfm(path), np.repeat(plane[..., None], 3, 2))


def test_pfm_is_what_opencv_reads(tmp_path):
    image.write_pfm(tmp_path / "x.pfm", MAP)
    seen = cv2.imread(str(tmp_path / "x.pfm"), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(seen[..., ::-1], MAP)


@pytest.mark.parametrize("compression", [OpenEXR.ZIP_COMPRESSION, OpenEXR.DWAA_COMPRESSION])
@pytest.mark.parametrize("names", ["RGB", "RGBA", "separate"])
def test_exr(tmp_path, compression, names):
    smooth = np.ascontiguousarray(cv2.GaussianBlur(MAP, (0, 0), 4))
    if names == "separate":
        channels = {c: np.ascontiguousarray(smooth[..., i]) for i, c in enumerate("RGB")}
    elif names == "RGBA":
        channels = {"RGBA": np.concatenate([smooth, np.ones_like(smooth[..., :1])], axis=2)}
    else:
        channels = {"RGB": smooth}
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(tmp_path / "x.exr"))
    seen = image.read(tmp_path / "x.exr")
    assert seen.bits == 32
    assert seen.radiance == pytest.approx(smooth, rel=0.02)


def test_exr_luminance_alone(tmp_path):
    plane = np.ascontiguousarray(MAP[..., 1])
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Y": plane}) as file:
        file.write(str(tmp_path / "y.exr"))
    assert np.array_equal(image.read(tmp_path / "y.exr").radiance[..., 2], plane)


def test_exr_of_other_primaries(tmp_path):
    """ACEScg: its neutral stays neutral, its red becomes an out-of-gamut Rec. 709 red."""
    acescg = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
    pixels = np.zeros((2, 4, 3), np.float32)
    pixels[0] = 1
    pixels[1, :, 0] = 1
    header = {"type": OpenEXR.scanlineimage, "chromaticities": acescg}
    with OpenEXR.File(header, {"RGB": pixels}) as file:
        file.write(str(tmp_path / "aces.exr"))
    seen = image.read(tmp_path / "aces.exr")
    assert seen.radiance[0] == pytest.approx(np.ones((4, 3)), abs=1e-3)
    # Published matrix AP1 -> Rec. 709 (Bradford): red column 1.70505, -0.13026, -0.02400.
    assert primaries.to_rec709(acescg)[:, 0] == pytest.approx(
        [1.70505, -0.13026, -0.02400], abs=2e-3
    )
    assert any("Rec. 709" in note for note in seen.notes)
    assert any("negative" in note for note in seen.notes)


def test_radiance_hdr(tmp_path):
    cv2.imwrite(str(tmp_path / "x.hdr"), MAP[..., ::-1])
    seen = image.read(tmp_path / "x.hdr")
    assert seen.radiance == pytest.approx(MAP, rel=0.02, abs=0.08)


@pytest.mark.parametrize(("kind", "top"), [(np.uint8, 255), (np.uint16, 65535)])
def test_png_is_srgb(tmp_path, kind, top):
    codes = (RNG.random((8, 16, 3)) * top).astype(kind)
    cv2.imwrite(str(tmp_path / "x.png"), codes[..., ::-1])
    seen = image.read(tmp_path / "x.png")
    assert seen.bits == np.dtype(kind).itemsize * 8
    assert seen.radiance == pytest.approx(colour.srgb_to_linear(codes / top), abs=1e-6)


def test_grey_and_transparent_png(tmp_path):
    cv2.imwrite(str(tmp_path / "g.png"), np.full((4, 8), 255, np.uint8))
    cv2.imwrite(str(tmp_path / "a.png"), np.full((4, 8, 4), 255, np.uint8))
    for name in "ga":
        assert np.all(image.read(tmp_path / f"{name}.png").radiance == 1)


def test_negative_samples_are_cleared_and_told(tmp_path):
    pixels = MAP.copy()
    pixels[0, 0] = -0.003
    image.write_pfm(tmp_path / "x.pfm", pixels)
    seen = image.read(tmp_path / "x.pfm")
    assert seen.radiance.min() == 0
    assert seen.notes == ("3 negative samples (down to -0.003) set to 0",)


@pytest.mark.parametrize("name", ["x.exr", "x.hdr", "x.png", "x.jpg", "x.pfm"])
@pytest.mark.parametrize("content", [b"", b"no picture at all", b"PF\n4 4\n-1\nshort"])
def test_garbage_is_named(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    why = "is the file complete|no PFM|it is PFM, whatever its name says"
    with pytest.raises(image.ImageError, match=f"{name}.*({why})"):
        image.read(tmp_path / name)


def test_missing_and_unknown(tmp_path):
    with pytest.raises(image.ImageError, match="no such file"):
        image.read(tmp_path / "none.exr")
    (tmp_path / "x.gif").write_bytes(b"GIF89a")
    with pytest.raises(image.ImageError, match="unknown kind"):
        image.read(tmp_path / "x.gif")


@given(st.floats(0, 1))
def test_srgb_there_and_back(linear):
    assert colour.srgb_to_linear(colour.linear_to_srgb(linear)) == pytest.approx(linear, abs=1e-9)
