"""The colour space that a picture of 8 or 16 bits names: what is not sRGB is told or refused.

Codes count as sRGB. Another curve would give another light, so it is refused by name; other
primaries give other colours of the same light, so they are told.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO

import numpy as np
from PIL import Image, ImageCms

from lightprobe.colour import srgb_to_linear
from lightprobe.geometry import Array
from lightprobe.imaging import primaries

#: Codes that are compared, and how far off their light may be: a gamma of 2.2 is as good as sRGB.
_CODES = np.arange(64.0, 256, 16)
_SAME_LIGHT = 0.1
#: Of 255; of a saturated colour.
_SAME_CODES = 8
_SAME_PRIMARIES = 0.01
#: ITU-T H.273: transfer functions that are as good as sRGB; those that people know by name.
_CICP_SRGB, _CICP_REC709 = (4, 13), 1
_CICP_NAMES = {1: "BT.709", 8: "linear", 16: "PQ", 18: "HLG"}
_PNG_START = b"\x89PNG\r\n\x1a\n"
_MOST_CHUNK_BYTES = 64


@dataclass(frozen=True)
class Space:
    """What is not as in sRGB; empty: nothing."""

    fault: str = ""  # why codes cannot be read as sRGB
    note: str = ""  # what is off if they are


def read(file: IO[bytes], picture: Image.Image) -> Space:
    """Give the space of a picture that Pillow has opened from `file`."""
    chunks = dict(_png_chunks(file))
    cicp = chunks.get(b"cICP", b"")
    if len(cicp) == 4:
        return _of_cicp(*cicp[:2])
    profile = picture.info.get("icc_profile")
    if profile:
        return _of_profile(profile)
    if b"sRGB" in chunks:
        return Space()
    return _of_png(chunks)


def _png_chunks(file: IO[bytes]) -> Iterator[tuple[bytes, bytes]]:
    """Chunks before the pixels, by type; of long ones only the type."""
    file.seek(0)
    if file.read(8) != _PNG_START:
        return
    while len(head := file.read(8)) == 8 and head[4:] not in (b"IDAT", b"IEND"):
        length = int.from_bytes(head[:4], "big")
        short = length <= _MOST_CHUNK_BYTES
        yield head[4:], file.read(length) if short else b""
        file.seek(4 if short else length + 4, io.SEEK_CUR)


def _of_cicp(colours: int, transfer: int) -> Space:
    if transfer not in _CICP_SRGB:
        return Space(fault=f"cICP: transfer {_CICP_NAMES.get(transfer, transfer)}")
    return Space() if colours == _CICP_REC709 else _other_primaries(f"cICP: primaries {colours}")


def _of_png(chunks: dict[bytes, bytes]) -> Space:
    gamma = chunks.get(b"gAMA", b"")
    value = struct.unpack(">I", gamma)[0] / 1e5 if len(gamma) == 4 else 0.0
    if value and not _is_same_light((_CODES / 255) ** (1 / value)):
        return Space(fault=f"gAMA {value:g}")
    stated = chunks.get(b"cHRM", b"")
    if len(stated) == 32 and any(stated):
        white, red, green, blue = np.array(struct.unpack(">8I", stated)).reshape(4, 2) / 1e5
        off = np.abs(np.concatenate([red, green, blue, white]) - primaries.REC709)
        if off.max() > _SAME_PRIMARIES:
            return _other_primaries("cHRM")
    return Space()


def _of_profile(data: bytes) -> Space:
    try:
        profile = ImageCms.ImageCmsProfile(io.BytesIO(data))
        name = str(profile.profile.profile_description or "without a name").strip()
        grey = profile.profile.xcolor_space.strip() == "GRAY"
        ramp = _CODES if grey else np.repeat(_CODES[:, None], 3, axis=1)
        greys = _to_srgb(profile, ramp)
        colours = np.eye(3) * 255
        seen = colours if grey else _to_srgb(profile, colours)
        half = np.full((3, 3), 64) + np.eye(3) * 96
        seen_half = half if grey else _to_srgb(profile, half)
    except (ImageCms.PyCMSError, OSError, ValueError, TypeError):
        return Space(note="its colour profile cannot be read: codes count as sRGB")
    if not _is_same_light(srgb_to_linear(greys[:, 1] / 255)):
        return Space(fault=f"colour profile {_plain(name)}")
    off = max(np.abs(seen - colours).max(), np.abs(seen_half - half).max())
    return Space() if off <= _SAME_CODES else _other_primaries(f"colour profile {_plain(name)}")


def _to_srgb(profile: ImageCms.ImageCmsProfile, codes: Array) -> Array:
    picture = Image.fromarray(np.asarray(codes, np.uint8)[None])
    converted = ImageCms.profileToProfile(
        picture, profile, ImageCms.createProfile("sRGB"),
        renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC, outputMode="RGB",
    )  # fmt: skip
    assert converted is not None
    pixels: Array = np.asarray(converted, np.float64)[0]
    return pixels


def _is_same_light(light: Array) -> bool:
    return bool(np.abs(light / srgb_to_linear(_CODES / 255) - 1).max() <= _SAME_LIGHT)


def _other_primaries(what: str) -> Space:
    return Space(note=f"{what}: its colours count as those of sRGB; greys are right")


def _plain(name: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in name)[:64]
