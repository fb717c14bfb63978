"""TIFF and PNG as programs write them: the same light in every layout of the same codes."""

import struct

import cv2
import numpy as np
import pytest
from lightprobe.colour import luminance, srgb_to_linear
from lightprobe.estimate import flag_names
from lightprobe.evaluate import offline
from PIL import Image

#: Sky and floor, and a bright square that does not clip.
CODES = np.full((128, 256, 3), (150, 140, 130), np.uint8)
CODES[64:] = (60, 60, 60)
CODES[40:44, 100:104] = (220, 210, 200)
LIGHT = srgb_to_linear(CODES / 255).astype(np.float32)
LONG, SHORT, LONG8 = (4, "I"), (3, "H"), (16, "Q")


class Tiff:
    """A TIFF of either byte order, in strips or tiles, classic or big."""

    def __init__(self, pixels, big_endian=False, big=False, tile_px=0, photometric=2):
        self.order, self.big = "><"[not big_endian], big
        self.offset_format = "Q" if big else "I"
        self.body, self.entries = bytearray(16 if big else 8), []
        height, width, channels = pixels.shape
        pixels = pixels.astype(pixels.dtype.newbyteorder(self.order))
        pieces = self.tiles(pixels, tile_px) if tile_px else [pixels]
        places = []
        for piece in pieces:
            places.append(len(self.body))
            self.body += piece.tobytes()
        sizes = [piece.nbytes for piece in pieces]
        kind = {"u": 1, "i": 2, "f": 3}[pixels.dtype.kind]
        self.entry(256, LONG, width)
        self.entry(257, LONG, height)
        self.entry(258, SHORT, *[8 * pixels.dtype.itemsize] * channels)
        self.entry(259, SHORT, 1)
        self.entry(262, SHORT, photometric)
        if not tile_px:
            self.entry(273, LONG, *places)
        self.entry(277, SHORT, channels)
        if not tile_px:
            self.entry(278, LONG, height)
            self.entry(279, LONG, *sizes)
        else:
            self.entry(322, SHORT, tile_px)
            self.entry(323, SHORT, tile_px)
            self.entry(324, LONG, *places)
            self.entry(325, LONG, *sizes)
        self.entry(339, SHORT, *[kind] * channels)

    @staticmethod
    def tiles(pixels, size):
        height, width, _ = pixels.shape
        return [
            np.ascontiguousarray(pixels[top : top + size, left : left + size])
            for top in range(0, height, size)
            for left in range(0, width, size)
        ]

    def entry(self, tag, kind, *values):
        content = struct.pack(f"{self.order}{len(values)}{kind[1]}", *values)
        room = struct.calcsize(self.offset_format)
        if len(content) > room:
            place, content = (
                struct.pack(f"{self.order}{self.offset_format}", len(self.body)),
                content,
            )
            self.body += content
            content = place
        head = struct.pack(f"{self.order}HH{self.offset_format}", tag, kind[0], len(values))
        self.entries.append(head + content.ljust(room, b"\0"))

    def bytes(self):
        start = b"MM" if self.order == ">" else b"II"
        place = len(self.body)
        start += (
            struct.pack(f"{self.order}HHHQ", 43, 8, 0, place)
            if self.big
            else (struct.pack(f"{self.order}HI", 42, place))
        )
        self.body[: len(start)] = start
        count = struct.pack(self.order + ("Q" if self.big else "H"), len(self.entries))
        return bytes(self.body) + count + b"".join(self.entries) + bytes(8 if self.big else 4)


WIDE = CODES.astype(np.uint16) * 257
LAYOUTS = {
    "8 bits": {"pixels": CODES},
    "8 bits, BigTIFF": {"pixels": CODES, "big": True},
    "8 bits, tiles": {"pixels": CODES, "tile_px": 64},
    "16 bits, little end first": {"pixels": WIDE},
    "16 bits, big end first": {"pixels": WIDE, "big_endian": True},
    "16 bits, big end first, BigTIFF": {"pixels": WIDE, "big_endian": True, "big": True},
    "16 bits, tiles": {"pixels": WIDE, "tile_px": 64},
    "floats": {"pixels": LIGHT},
    "floats, big end first": {"pixels": LIGHT, "big_endian": True},
    "doubles": {"pixels": LIGHT.astype(np.float64)},
}


def sh0(path):
    found, notes = offline.estimate_files([path])
    assert "CLIPPED" not in flag_names(found.flags)
    assert not any("Traceback" in note for note in notes)
    return float(luminance(found.sh.coefficients[0]))


@pytest.fixture(scope="module")
def right(tmp_path_factory):
    path = tmp_path_factory.mktemp("right") / "x.png"
    Image.fromarray(CODES).save(path)
    return sh0(path)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_of_a_tiff_is_the_same_light(tmp_path, layout, right):
    path = tmp_path / "x.tif"
    path.write_bytes(Tiff(**LAYOUTS[layout]).bytes())
    assert sh0(path) == pytest.approx(right, rel=0.02)


def test_greys_whose_0_is_white(tmp_path):
    grey = CODES[..., :1]
    Image.fromarray(grey[..., 0]).save(tmp_path / "x.png")
    (tmp_path / "x.tif").write_bytes(Tiff(255 - grey, photometric=0).bytes())
    assert sh0(tmp_path / "x.tif") == pytest.approx(sh0(tmp_path / "x.png"), rel=0.02)


REFUSED = {
    "32 bits": (CODES.astype(np.uint32) << 24, "expected 8 or 16 bit, or float"),
    "signed": (WIDE.astype(np.int16) // 2, "expected 8 or 16 bit, or float"),
    "half floats": (LIGHT.astype(np.float16), "contains no such picture"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_samples_that_are_not_known_are_refused_by_name(tmp_path, capfd, what):
    pixels, why = REFUSED[what]
    path = tmp_path / "x.tif"
    path.write_bytes(Tiff(pixels).bytes())
    with pytest.raises(offline.image.ImageError, match=why):
        offline.estimate_files([path])
    assert capfd.readouterr() == ("", "")


def test_of_several_pictures_the_first_counts(tmp_path, right):
    black = Image.new("RGB", (256, 128))
    for name in ("x.png", "x.tif"):
        Image.fromarray(CODES).save(tmp_path / name, save_all=True, append_images=[black])
        assert sh0(tmp_path / name) == pytest.approx(right, rel=0.02)


@pytest.mark.parametrize("kind", ["P", "RGBA"])
@pytest.mark.parametrize("suffix", [".png", ".bmp"])
def test_palettes_and_whole_alphas_change_nothing(tmp_path, kind, suffix, right):
    path = tmp_path / f"x{suffix}"
    Image.fromarray(CODES).convert(kind, palette=Image.Palette.ADAPTIVE).save(path)
    assert sh0(path) == pytest.approx(right, rel=0.02)


def test_names_with_anything_in_them(tmp_path, right):
    for name in ("a b.png", "ä ö ü.png", "x\ny.png", "50%,a&b=c#?.png", "-z.png"):
        path = tmp_path / name
        cv2.imwrite(str(path), CODES[..., ::-1])
        assert sh0(path) == pytest.approx(right, rel=0.02)
