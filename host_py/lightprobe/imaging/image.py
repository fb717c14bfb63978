"""Pictures of any usual kind as scene-linear float RGB, and PFM, the float format the daemon reads.

Arrays are (height, width, 3) float32, row 0 up, Rec. 709 primaries. HDR, EXR and PFM keep their own
units; 8- and 16-bit pictures are taken as sRGB, full scale = 1.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe.colour import srgb_table, srgb_to_linear
from lightprobe.errors import ImageError as ImageError
from lightprobe.imaging import opencv, rgbe, signature, transparency
from lightprobe.imaging.decoded import Decoded, Radiance

HDR_SUFFIXES = frozenset({".hdr", ".exr", ".pfm"})
JPEG_SUFFIXES = frozenset({".jpg", ".jpeg"})
SUFFIXES = HDR_SUFFIXES | JPEG_SUFFIXES | {".png", ".tif", ".tiff", ".bmp"}
#: Tag of TIFF.
_ORIENTATION = 0x0112
#: A JPEG, and not one that ends where it begins; the daemon's rule (base/jpeg_start.h).
_JPEG_START = re.compile(rb"\xff\xd8\xff+[^\xff\xd9]", re.DOTALL)


@dataclass(frozen=True)
class Picture:
    """A picture as linear light, and what had to be done to it."""

    radiance: Radiance
    bits: int  # per sample in the file; 32 for float formats
    notes: tuple[str, ...] = ()
    unseen: NDArray[np.bool_] | None = None  # (height, width); None: all is seen


def read(path: str | Path) -> Picture:
    """Read HDR, EXR, PFM, PNG, JPEG, TIFF or BMP as linear light; raises :class:`ImageError`.

    Negative samples (lossy EXR leaves tiny ones) become 0 and are noted; NaN (not seen, or broken)
    and infinity (saturated) are left for the daemon, which flags them.
    """
    path = Path(path)
    if not path.is_file():
        raise ImageError(f"image: {path}: open: no such file")
    suffix = path.suffix.lower()
    bits = 32
    _refuse_other_kinds(path)
    if suffix == ".exr":
        decoded = _read_exr(path)
    elif suffix == ".hdr":
        decoded = rgbe.read(path)
    elif suffix == ".pfm":
        decoded = Decoded(read_pfm(path))
    elif suffix in SUFFIXES:
        radiance, notes, bits = _read_cv2(path)
        decoded = Decoded(radiance, notes, transparency.read(path))
        if decoded.unseen is not None:
            notes.append(transparency.NOTE)
            if decoded.unseen.all():
                raise ImageError(f"image: {path}: all of its pixels are transparent")
    else:
        raise ImageError(f"image: {path}: unknown kind: expected {', '.join(sorted(SUFFIXES))}")
    notes = decoded.notes + _clamp_negative(decoded.radiance)
    return Picture(decoded.radiance, bits, tuple(notes), decoded.unseen)


def read_srgb8(path: str | Path) -> NDArray[np.uint8]:
    """Read the codes (height, width, 3) RGB of an 8-bit picture as they are.

    Those of 16 bits are rounded up or down at random, so that mean light stays what it is.
    """
    _refuse_other_kinds(Path(path))
    decoded = _decode(Path(path))
    if decoded.dtype == np.uint16:
        dither = np.random.default_rng(0).random((*decoded.shape[:2], *[1] * (decoded.ndim - 2)))
        rounded = np.minimum(decoded.astype(np.float64) / 257 + dither, 255)
        decoded = np.asarray(rounded, dtype=np.uint8)
    if decoded.dtype != np.uint8:
        raise ImageError(f"image: {path}: {decoded.dtype.itemsize * 8} bits a sample: expected 8")
    return np.ascontiguousarray(_three_channels(decoded, Path(path))[..., ::-1])


def _refuse_other_kinds(path: Path) -> None:
    why = signature.other_kind(_bytes(path, signature.MOST_BYTES), path.suffix.lower())
    if why:
        raise ImageError(f"image: {path}: {why}")


def _bytes(path: Path, most: int = -1) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(most)
    except OSError as error:
        raise ImageError(f"image: {path}: read: {error.strerror}") from None


def _decode(path: Path) -> NDArray[np.generic]:
    # As the daemon does it: pixels as they are stored, whatever a tag says of their orientation.
    jpeg = path.suffix.lower() in JPEG_SUFFIXES
    file = _bytes(path)
    if path.suffix.lower() in (".tif", ".tiff"):
        file = _as_stored(file)
    start = _JPEG_START.search(file) if jpeg else None
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION if jpeg else cv2.IMREAD_UNCHANGED
    decoded = opencv.decode(file[start.start() if start else 0 :], flags)
    if decoded is None:
        why = signature.unread_jpeg(file) or "contains no such picture: is the file complete?"
        raise ImageError(f"image: {path}: decode: {why}")
    return decoded


def _as_stored(tiff: bytes) -> bytes:
    """Give the TIFF without its orientation, which libtiff would obey."""
    order: Literal["little", "big"] = "little" if tiff[:2] == b"II" else "big"
    data = bytearray(tiff)

    def number(at: int, size: int) -> int:
        return int.from_bytes(data[at : at + size], order)

    directory = number(4, 4)
    for at in range(directory + 2, directory + 2 + 12 * number(directory, 2), 12):
        if number(at, 2) == _ORIENTATION and at + 12 <= len(data):
            data[at + 8 : at + 10] = (1).to_bytes(2, order)
    return bytes(data)


def _three_channels(decoded: NDArray[np.generic], path: Path) -> NDArray[np.generic]:
    """Colour channels alone: grey is repeated, transparency dropped."""
    if decoded.ndim == 2 or decoded.shape[2] == 1:
        return np.repeat(decoded.reshape(*decoded.shape[:2], 1), 3, axis=2)
    if decoded.shape[2] in (3, 4):
        return decoded[..., :3]
    raise ImageError(f"image: {path}: {decoded.shape[2]} channels: expected grey, RGB or RGBA")


def _read_cv2(path: Path) -> tuple[Radiance, list[str], int]:
    colour = _three_channels(_decode(path), path)[..., ::-1]
    if colour.dtype == np.uint8:
        return srgb_table().astype(np.float32)[colour], [], 8
    if colour.dtype == np.uint16:
        table = srgb_to_linear(np.arange(65536) / 65535).astype(np.float32)
        return table[colour], [], 16
    if colour.dtype in (np.float32, np.float64):
        return np.ascontiguousarray(colour, dtype=np.float32), [], 32
    raise ImageError(f"image: {path}: samples of {colour.dtype}: expected 8 or 16 bit, or float")


def _read_exr(path: Path) -> Decoded:
    from lightprobe.imaging import exr  # slow to load, and only EXR files need it

    return exr.read(path)


def _clamp_negative(radiance: Radiance) -> list[str]:
    """Set negative samples to zero, in place; says how many there were."""
    negative = radiance < 0
    number = int(np.count_nonzero(negative))
    if not number:
        return []
    lowest = float(np.min(radiance[negative]))
    radiance[negative] = 0
    return [f"{number} negative samples (down to {lowest:.2g}) set to 0"]


def encode(suffix: str, radiance: ArrayLike) -> bytes:
    """Bytes of linear light (H, W, 3) as .hdr (8 bits of mantissa), .exr (half) or .pfm (float)."""
    pixels = np.ascontiguousarray(radiance, dtype=np.float32)
    if suffix == ".pfm":
        return _pfm(pixels)
    if suffix == ".exr":
        from lightprobe.imaging import exr

        return exr.encode(pixels)
    return rgbe.encode(pixels)


# ---------------------------------------------------------------- PFM

_PFM_HEADER = re.compile(
    rb"(PF|Pf)\s+(\d{1,9})\s+(\d{1,9})\s+([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s"
)


def write_pfm(path: str | Path, radiance: ArrayLike) -> None:
    """Write (H, W, 3) as a little-endian PFM."""
    Path(path).write_bytes(_pfm(np.asarray(radiance)))


def _pfm(radiance: NDArray[Any]) -> bytes:
    """Bottom row first, as the format wants."""
    height, width, _ = radiance.shape
    pixels = np.ascontiguousarray(radiance[::-1], dtype="<f4")
    return b"PF\n%d %d\n-1.0\n" % (width, height) + pixels.tobytes()


def read_pfm(path: str | Path) -> Radiance:
    """Read a colour or grey PFM of either byte order."""
    data = _bytes(Path(path))
    header = _PFM_HEADER.match(data)
    if header is None:
        raise ImageError(f"image: {path}: header: no PFM: expected PF or Pf, width, height, scale")
    channels = 3 if header[1] == b"PF" else 1
    width, height, scale = int(header[2]), int(header[3]), float(header[4])
    needed = 4 * width * height * channels
    if len(data) - header.end() < needed or needed == 0:
        have = len(data) - header.end()
        raise ImageError(
            f"image: {path}: {have} bytes of pixels, {needed} wanted: is the file complete?"
        )
    if not 0 < abs(scale) <= np.finfo(np.float32).max:
        raise ImageError(f"image: {path}: header: scale {scale:g}: expected a number but 0")
    kind = "<f4" if scale < 0 else ">f4"
    pixels = np.frombuffer(data, kind, width * height * channels, header.end())
    with np.errstate(over="ignore", invalid="ignore"):  # infinity is saturated light
        pixels = pixels.reshape(height, width, channels)[::-1].astype(np.float32) * np.float32(
            abs(scale)
        )
    return np.ascontiguousarray(np.repeat(pixels, 3, axis=2) if channels == 1 else pixels)
