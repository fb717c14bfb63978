"""Radiance pictures: what the header says is honoured, or refused by name."""

import cv2
import numpy as np
import pytest
from float_scene import FILES, TO_XYZ, draw, light
from lightprobe.errors import ImageError
from lightprobe.imaging import image, primaries, rgbe

SCENE = draw()
RGBE, XYZE = "32-bit_rle_rgbe", "32-bit_rle_xyze"
REC2020 = "0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290"
TRUNCATED = "truncated.hdr"
#: The samples are those of Rec. 709, whatever this file says.
OTHER_COLOURS = "primaries2020.hdr"


def codes_of(pixels):
    """RGBE as Radiance writes it: cut off below."""
    top = pixels.max(axis=-1, keepdims=True)
    exponent = np.where(top > 1e-32, np.frexp(top)[1], -128)
    mantissa = np.floor(np.ldexp(pixels.astype(np.float64), 8 - exponent))
    return np.concatenate([mantissa, exponent + 128], axis=-1).astype(np.uint8)


def write(path, pixels, *lines, size=None, kind=RGBE, encode=lambda codes: codes.tobytes()):
    height, width = pixels.shape[:2]
    header = ["#?RADIANCE", *([f"FORMAT={kind}"] if kind else []), *lines, ""]
    header.append(size or f"-Y {height} +X {width}")
    path.write_bytes(("\n".join(header) + "\n").encode() + encode(codes_of(pixels)))
    return path


def by_runs(codes):
    """Radiance's old way: 1, 1, 1, n for n more of the pixel before."""
    out = bytearray()
    for row in ([bytes(pixel) for pixel in row] for row in codes):
        i = 0
        while i < len(row):
            same = 1
            while i + same < len(row) and row[i + same] == row[i]:
                same += 1
            out += row[i]
            left = same - 1
            while left:  # the lowest byte first
                out += bytes([1, 1, 1, left & 255])
                left >>= 8
            i += same
    return bytes(out)


def test_the_scene_of_every_file():
    for path in sorted((FILES / "hdr").glob("*.hdr")):
        if path.name not in (TRUNCATED, OTHER_COLOURS):
            assert light(image.read(path).radiance) == pytest.approx(light(SCENE), rel=0.02), path
    with pytest.raises(ImageError, match="is the file complete"):
        image.read(FILES / "hdr" / TRUNCATED)
    seen = light(image.read(FILES / "hdr" / OTHER_COLOURS).radiance)
    stated = primaries.to_rec709([float(word) for word in REC2020.split()])
    assert seen == pytest.approx(stated @ light(SCENE), rel=0.02)


@pytest.mark.parametrize("first", ["-Y", "+Y", "-X", "+X"])
@pytest.mark.parametrize("second_sign", "-+")
@pytest.mark.parametrize("encode", [by_runs, lambda codes: codes.tobytes()])
def test_all_orientations(tmp_path, first, second_sign, encode):
    second = second_sign + ("X" if first[1] == "Y" else "Y")
    stored = SCENE[::-1] if "+Y" in (first, second) else SCENE
    stored = stored[:, ::-1] if "-X" in (first, second) else stored
    stored = stored if first[1] == "Y" else stored.transpose(1, 0, 2)
    size = f"{first} {stored.shape[0]} {second} {stored.shape[1]}"
    path = write(tmp_path / "x.hdr", stored, size=size, encode=encode)
    assert image.read(path).radiance == pytest.approx(SCENE, rel=0.02)


def test_exposures_and_corrections_multiply(tmp_path):
    pixels = SCENE * 3 * 0.25 * [2, 1, 0.5] * [0.5, 0.5, 1]
    lines = ["EXPOSURE=3", "COLORCORR=2 1 0.5", "EXPOSURE= 2.5e-1", "COLORCORR= .5 .5 1"]
    seen = image.read(write(tmp_path / "x.hdr", pixels, *lines))
    assert seen.radiance == pytest.approx(SCENE, rel=0.02)
    assert any("EXPOSURE" in note for note in seen.notes)


def test_lines_of_what_it_was_made_of_do_not_count(tmp_path):
    lines = ["pfilt -1 -e 4", "\tEXPOSURE=4", "\tFORMAT=32-bit_rle_xyze", "VIEW= -vtl EXPOSURE=9"]
    seen = image.read(write(tmp_path / "x.hdr", SCENE, *lines))
    assert seen.radiance == pytest.approx(SCENE, rel=0.02)


def test_no_format_is_rgbe(tmp_path):
    seen = image.read(write(tmp_path / "x.hdr", SCENE, kind=None))
    assert seen.radiance == pytest.approx(SCENE, rel=0.02)


@pytest.mark.parametrize("lines", [[], [f"PRIMARIES={REC2020}"]])
def test_xyze_is_what_was_measured(tmp_path, lines):
    seen = image.read(write(tmp_path / "x.hdr", SCENE @ TO_XYZ.T, *lines, kind=XYZE))
    assert light(seen.radiance) == pytest.approx(light(SCENE), rel=0.02)


def test_other_primaries_are_converted(tmp_path):
    matrix = primaries.to_rec709([float(word) for word in REC2020.split()])
    pixels = SCENE @ np.linalg.inv(matrix).T
    seen = image.read(write(tmp_path / "x.hdr", pixels, f"PRIMARIES={REC2020}"))
    assert light(seen.radiance) == pytest.approx(light(SCENE), rel=0.02)
    assert any("Rec. 709" in note for note in seen.notes)


def test_zeros_state_nothing(tmp_path):
    """As Photoshop writes them."""
    lines = ["GAMMA=1", "PRIMARIES=0 0 0 0 0 0 0 0", "PIXASPECT=0", "GAMMA=0"]
    seen = image.read(write(tmp_path / "x.hdr", SCENE, *lines))
    assert seen.radiance == pytest.approx(SCENE, rel=0.02)
    assert not seen.notes


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (["EXPOSURE=much"], "EXPOSURE=much: expected a number"),
        (["EXPOSURE=0"], "EXPOSURE: expected numbers above 0"),
        (["EXPOSURE=-1"], "EXPOSURE: expected numbers above 0"),
        (["COLORCORR=1 2"], "COLORCORR=1 2: expected 3 numbers"),
        (["PRIMARIES=1 2 3"], "PRIMARIES=1 2 3: expected 8 numbers"),
        (["PRIMARIES=.3 .3 .3 .3 .3 .3 .3 .3"], "PRIMARIES: red, green and blue lie on one line"),
        (["GAMMA=2.2"], "GAMMA=2.2: no linear light"),
        (["FORMAT=Radiance_spectra"], "FORMAT=Radiance_spectra: expected 32-bit_rle_rgbe"),
    ],
)
def test_what_cannot_be_honoured_is_named(tmp_path, lines, words):
    with pytest.raises(ImageError, match=words):
        image.read(write(tmp_path / "x.hdr", SCENE, *lines))


@pytest.mark.parametrize(
    "size", ["+Y 128 +Y 256", "128 256", "-Y 0 +X 256", "-Y 99999999 +X 99999999"]
)
def test_impossible_sizes_are_named(tmp_path, size):
    with pytest.raises(ImageError, match="size"):
        image.read(write(tmp_path / "x.hdr", SCENE, size=size))


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
@pytest.mark.parametrize("encode", [by_runs, lambda codes: codes.tobytes()])
def test_cut_off_is_named_and_nothing_else_is_said(tmp_path, capfd, share, encode):
    def cut(codes):
        data = encode(codes)
        return data[: int(share * len(data))]

    with pytest.raises(ImageError, match="is the file complete"):
        image.read(write(tmp_path / "x.hdr", SCENE, encode=cut))
    assert capfd.readouterr().err == ""


def test_damage_is_named_and_nothing_else_is_said(tmp_path, capfd):
    cv2.imwrite(str(tmp_path / "x.hdr"), SCENE)
    data = (tmp_path / "x.hdr").read_bytes()
    (tmp_path / "x.hdr").write_bytes(data[: len(data) // 2])
    with pytest.raises(ImageError, match="is the file complete"):
        image.read(tmp_path / "x.hdr")
    assert capfd.readouterr().err == ""


def test_long_runs_have_several_bytes(tmp_path):
    flat = np.full((4, 1000, 3), 0.5, np.float32)
    flat[:, 990:] = 0.25
    assert np.array_equal(
        image.read(write(tmp_path / "x.hdr", flat, encode=by_runs)).radiance, flat
    )


@pytest.mark.parametrize("share", [0.003, 0.0201, 0.13, 0.7])
def test_a_dim_channel_keeps_its_light(share):
    """Its steps are up to a third of it: on average the light is right all the same."""
    for brightest in (1.0, 1.99, 777.0):
        flat = np.full((64, 128, 3), brightest, np.float32)
        flat[..., 2] *= share
        back = rgbe_and_back(flat)
        assert back.mean(axis=(0, 1)) == pytest.approx(flat[0, 0], rel=0.01)
        assert np.abs(back - flat).max() <= brightest / 128


def rgbe_and_back(pixels):
    """As OpenCV reads it, and so do engines."""
    data = np.frombuffer(rgbe.encode(pixels), np.uint8)
    return cv2.imdecode(data, cv2.IMREAD_UNCHANGED)[..., ::-1]


def test_what_the_format_holds_is_written_as_it_is():
    codes = np.random.default_rng(1).integers(0, 256, (32, 64, 3))
    codes[..., 0] |= 128
    pixels = np.ldexp(codes.astype(np.float32), np.arange(-40, 24)[:, None])
    assert np.array_equal(rgbe_and_back(pixels), pixels)
