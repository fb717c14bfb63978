"""Pictures that cannot be read: an error that says why, and not a line of a library's own."""

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from lightprobe.errors import ImageError
from lightprobe.imaging import image
from PIL import Image

FILES = Path(__file__).resolve().parents[2] / "files"


def encoded(kind: str) -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.full((16, 32, 3), 100, np.uint8)).save(file, kind)
    return file.getvalue()


HEIF = b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + bytes(500)
OTHER_KINDS = [
    ("x.jpg", lambda: encoded("PNG"), "it is PNG, whatever its name says: rename it"),
    ("x.jpg", lambda: encoded("TIFF"), "it is TIFF"),
    ("x.jpeg", lambda: encoded("BMP"), "it is BMP"),
    ("x.jpg", lambda: encoded("WEBP"), "it is WebP, whatever its name says: convert it"),
    ("x.jpg", lambda: encoded("GIF"), "it is GIF"),
    ("x.png", lambda: encoded("WEBP"), "it is WebP"),
    ("x.tif", lambda: HEIF, "it is HEIF"),
    ("x.jpg", lambda: HEIF, "it is HEIF"),
    ("x.hdr", (FILES / "exr/plain.exr").read_bytes, "it is OpenEXR"),
    ("x.exr", (FILES / "hdr/plain.hdr").read_bytes, "it is Radiance"),
    ("x.pfm", lambda: encoded("PNG"), "it is PNG"),
]


@pytest.mark.parametrize(("name", "data", "why"), OTHER_KINDS)
def test_another_kind_than_its_name_says_is_named(tmp_path, capfd, name, data, why):
    path = tmp_path / name
    path.write_bytes(data())
    with pytest.raises(ImageError, match=why):
        image.read(path)
    if path.suffix not in image.HDR_SUFFIXES:
        with pytest.raises(ImageError, match=why):
            image.read_srgb8(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("marker", "bits", "why"),
    [(0xC1, 12, "a JPEG of 12 bits a sample"), (0xC3, 8, "a lossless JPEG")],
)
def test_jpegs_that_nobody_reads_are_named(tmp_path, marker, bits, why):
    data = bytearray((FILES / "jpeg/plain.jpg").read_bytes())
    at = data.index(b"\xff\xc0")
    data[at + 1], data[at + 4] = marker, bits
    (tmp_path / "x.jpg").write_bytes(data)
    with pytest.raises(ImageError, match=why):
        image.read(tmp_path / "x.jpg")


PICTURES = ["png/rgb8.png", "png/lzw.tif", "png/rgb.bmp", "exr/plain.exr", "exr/piz.exr",
            "hdr/plain.hdr", "jpeg/progressive.jpg"]  # fmt: skip


@pytest.mark.parametrize("share", [0, 0.02, 0.1, 0.5, 0.95])
@pytest.mark.parametrize("name", PICTURES)
def test_what_is_cut_off_is_refused_without_a_library_s_own_line(tmp_path, capfd, name, share):
    data = (FILES / name).read_bytes()
    path = tmp_path / Path(name).name
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(ImageError, match="is the file complete"):
        image.read(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", PICTURES)
def test_damage_is_refused_or_read_and_says_nothing_by_itself(tmp_path, capfd, name, seed):
    """Whatever it comes to, it is an ImageError or a picture."""
    data = bytearray((FILES / name).read_bytes())
    random = np.random.default_rng(seed)
    for at in random.integers(16, len(data), 20):
        data[at] = random.integers(256)
    path = tmp_path / Path(name).name
    path.write_bytes(data)
    refusal = None
    try:
        assert image.read(path).radiance.ndim == 3
    except ImageError as error:
        refusal = str(error)
    assert refusal is None or str(path) in refusal
    assert capfd.readouterr() == ("", "")


def png(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pixels = chunk(b"IDAT", zlib.compress(bytes(1000)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + pixels + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("none.png", png(0, 0)),
        ("huge.png", png(200_000, 100_000)),
        ("huge.pfm", b"PF\n2000000 1000000\n-1.0\n" + bytes(100)),
        ("none.pfm", b"PF\n0 0\n-1.0\n"),
        ("digits.pfm", b"PF\n" + b"9" * 5000 + b" 1\n-1\n" + bytes(100)),
        ("points.pfm", b"PF\n2 1\n-1.2.3\n" + bytes(24)),
        ("dashes.pfm", b"PF\n2 1\n--\n" + bytes(24)),
        ("infinite.pfm", b"PF\n2 1\n-1e999\n" + bytes(24)),
        ("tiny.pfm", b"PF\n2 1\n-1e-999\n" + bytes(24)),
        ("huge.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1000000 +X 2000000\n" + bytes(99)),
    ],
)
def test_sizes_and_numbers_beyond_reason_are_refused(tmp_path, capfd, name, data):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(ImageError, match=name):
        image.read(tmp_path / name)
    assert capfd.readouterr() == ("", "")
