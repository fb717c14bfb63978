"""Colour spaces that pictures name: sRGB and what is as good, other primaries, other curves."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from lightprobe.imaging import metadata
from lightprobe.imaging.colour_space import Space
from PIL import Image, ImageCms

SRGB = ((0.4361, 0.2225, 0.0139), (0.3851, 0.7169, 0.0971), (0.1431, 0.0606, 0.7142))
P3 = ((0.5151, 0.2412, -0.0011), (0.2920, 0.6922, 0.0419), (0.1571, 0.0666, 0.7841))
D50 = (0.9642, 1.0, 0.8249)


def profile(
    gamma: float, colours: tuple[tuple[float, float, float], ...], name: bytes = b"mine"
) -> bytes:
    """An ICC profile of version 2: three primaries and one curve."""

    def fixed(*values: float) -> bytes:
        return b"".join(struct.pack(">i", round(65536 * value)) for value in values)

    curve = b"curv" + struct.pack(">IIH", 0, 1, round(256 * gamma))
    said = b"desc" + struct.pack(">II", 0, len(name) + 1) + name + bytes(1 + 78)
    tags = [(b"desc", said), (b"wtpt", b"XYZ \0\0\0\0" + fixed(*D50))]
    tags += [
        (k, b"XYZ \0\0\0\0" + fixed(*c))
        for k, c in zip((b"rXYZ", b"gXYZ", b"bXYZ"), colours, strict=True)
    ]
    tags += [(k, curve) for k in (b"rTRC", b"gTRC", b"bTRC")]
    table, body, begin = struct.pack(">I", len(tags)), b"", 132 + 12 * len(tags)
    for kind, data in tags:
        table += kind + struct.pack(">II", begin + len(body), len(data))
        body += data + bytes(-len(data) % 4)
    head = struct.pack(
        ">I4sI4s4s4s", begin + len(body), b"lcms", 0x02100000, b"mntr", b"RGB ", b"XYZ "
    )
    head += struct.pack(">6H", 2020, 1, 1, 0, 0, 0) + b"acsp" + bytes(28) + fixed(*D50)
    return head.ljust(128, b"\0") + table + body


PICTURE = Image.fromarray(np.full((16, 32, 3), 100, np.uint8))


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif"])
@pytest.mark.parametrize(
    ("icc", "space"),
    [
        (profile(2.2, SRGB), Space()),
        (ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes(), Space()),
        (profile(1.0, SRGB), Space(fault="colour profile mine")),
        (profile(1.8, P3), Space(fault="colour profile mine")),
        (profile(2.2, P3, b"its\x1b[2J"),
         Space(note="colour profile its?[2J: its colours count as those of sRGB; greys are right")),
        (b"no profile", Space(note="its colour profile cannot be read: codes count as sRGB")),
    ],
)  # fmt: skip
def test_colour_profiles(tmp_path, suffix, icc, space):
    PICTURE.save(tmp_path / f"x{suffix}", icc_profile=icc)
    assert metadata.read(tmp_path / f"x{suffix}").space == space


def test_a_profile_of_greys(tmp_path):
    for gamma, fault in ((1.0, True), (2.2, False)):
        curve = b"curv" + struct.pack(">IIHH", 0, 1, round(256 * gamma), 0)
        whole = profile(gamma, SRGB)
        tags = struct.pack(">I4sII", 1, b"kTRC", 144, 14) + curve
        grey = whole[:16] + b"GRAY" + whole[20:128] + tags
        grey = struct.pack(">I", len(grey)) + grey[4:]
        PICTURE.convert("L").save(tmp_path / "x.png", icc_profile=grey)
        space = metadata.read(tmp_path / "x.png").space
        assert bool(space.fault) == fault, space
        assert not space.note


REC2020 = struct.pack(">8I", 31270, 32900, 70800, 29200, 17000, 79700, 13100, 4600)
REC709 = struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize(
    ("chunks", "fault", "note"),
    [
        ([(b"gAMA", struct.pack(">I", 45455))], "", ""),
        ([(b"gAMA", struct.pack(">I", 0))], "", ""),
        ([(b"gAMA", struct.pack(">I", 100000))], "gAMA 1", ""),
        ([(b"gAMA", struct.pack(">I", 100000)), (b"sRGB", b"\0")], "", ""),
        ([(b"cHRM", REC709)], "", ""),
        ([(b"cHRM", REC2020)], "", "cHRM"),
        ([(b"cICP", bytes([1, 13, 0, 1]))], "", ""),
        ([(b"cICP", bytes([9, 16, 0, 1]))], "cICP: transfer PQ", ""),
        ([(b"cICP", bytes([1, 8, 0, 1])), (b"sRGB", b"\0")], "cICP: transfer linear", ""),
        ([(b"cICP", bytes([12, 13, 0, 1]))], "", "cICP: primaries 12"),
    ],
)
def test_chunks_of_png(tmp_path, bits, chunks, fault, note):
    factor, kind = (1, np.uint8) if bits == 8 else (257, np.uint16)
    data = cv2.imencode(".png", np.full((16, 32, 3), 100 * factor, kind))[1].tobytes()
    said = b"".join(
        struct.pack(">I", len(content))
        + name
        + content
        + struct.pack(">I", zlib.crc32(name + content))
        for name, content in chunks
    )
    Path(tmp_path / "x.png").write_bytes(data[:33] + said + data[33:])
    space = metadata.read(tmp_path / "x.png").space
    assert space.fault == fault
    assert space.note.startswith(note)
    assert bool(space.note) == bool(note)
