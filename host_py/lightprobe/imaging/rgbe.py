"""Radiance pictures (.hdr, .pic): a header of lines, then RGBE or XYZE pixels.

https://radsite.lbl.gov/radiance/refer/filefmts.pdf, "Picture File Format". What the header says of
the light is honoured: EXPOSURE and COLORCORR, which multiply, PRIMARIES, and the order of pixels.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.errors import ImageError
from lightprobe.geometry import Array
from lightprobe.imaging import opencv, primaries
from lightprobe.imaging.decoded import Decoded, Radiance, convert

_FORMATS = {"32-bit_rle_rgbe": "RGB", "32-bit_rle_xyze": "XYZ"}
_SIZE = re.compile(r"([-+][XY])\s+(\d{1,9})\s+([-+][XY])\s+(\d{1,9})\s*")
#: How many numbers follow in each line of the header that tells of the light.
_NUMBERS = {"EXPOSURE": 1, "COLORCORR": 3, "PRIMARIES": 8, "GAMMA": 1, "PIXASPECT": 1}
_MOST_PIXELS = 1 << 28
#: The largest number that a pixel can hold: it is, or exceeds it.
_MOST = float(np.ldexp(255.0, 255 - 136))


@dataclass
class _Header:
    kind: str = "RGB"  # or XYZ
    exposure: float = 1.0  # all that the pixels were multiplied by
    correction: Array = field(default_factory=lambda: np.ones(3))  # the same, of each channel
    primaries: tuple[float, ...] = primaries.REC709
    notes: list[str] = field(default_factory=list)
    axes: tuple[str, str] = ("-Y", "+X")  # from scan line to scan line, from pixel to pixel
    shape: tuple[int, int] = (0, 0)  # scan lines, pixels of each
    end: int = 0  # where the pixels begin, in bytes


def read(path: Path) -> Decoded:
    """Read a picture; raises :class:`ImageError`."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ImageError(f"image: {path}: read: {error.strerror}") from None
    header = _header(path, data)
    pixels = _turned(_pixels(path, data[header.end :], header.shape), header.axes)
    pixels = np.where(pixels >= _MOST, np.inf, pixels)  # saturated
    radiance = (pixels / (header.exposure * header.correction)).astype(np.float32)
    stated = primaries.XYZ if header.kind == "XYZ" else header.primaries
    try:
        converted = convert(radiance, stated)
    except ValueError as error:
        raise ImageError(f"image: {path}: PRIMARIES: {error}") from None
    return Decoded(converted.radiance, header.notes + converted.notes)


def encode(radiance: Radiance) -> bytes:
    """Bytes of a picture (height, width, 3), Rec. 709.

    All channels of a pixel share the exponent of the brightest, so a dim one has few steps. Which
    of the two nearest steps a sample takes is drawn (Roberts, Picture Coding Using Pseudo-Random
    Noise, 1962): so what is lost in one pixel is won in the next, and the light stays right.
    """
    drawn = np.random.default_rng(0).random(radiance.shape)
    bright = np.nan_to_num(np.asarray(radiance, np.float64), nan=0.0, posinf=_MOST).clip(0, _MOST)
    top = bright.max(axis=-1, keepdims=True)
    exponent = np.frexp(top)[1]
    exponent += np.ldexp(top, 8 - exponent) > 255  # the step above is one of the next exponent
    steps = np.floor(np.ldexp(bright, 8 - exponent) + drawn)
    exact = np.ldexp(steps, exponent - 8).astype(np.float32)
    done, data = cv2.imencode(".hdr", np.ascontiguousarray(exact[..., ::-1]))
    if not done:
        raise ImageError(f"image: .hdr: encode: not possible for {radiance.shape}")
    return data.tobytes()


# ---------------------------------------------------------------- header


def _header(path: Path, data: bytes) -> _Header:
    """Read the lines up to the one that states the size."""
    if not data.startswith(b"#?"):
        raise ImageError(
            f"image: {path}: header: no Radiance picture, which begins with #?: "
            "is the file complete?"
        )
    header = _Header()
    while True:
        line, end = _line(path, data, header.end)
        header.end = end
        if not line:
            break
        name, equals, value = line.partition("=")
        if equals and name == "FORMAT":
            _set_format(path, header, value.strip())
        elif equals and name in _NUMBERS:  # indented lines tell of the pictures it was made of
            _set_light(path, header, name, _numbers(path, name, value))
    _set_size(path, header, data)
    if header.exposure != 1 or (header.correction != 1).any():
        factors = header.exposure * header.correction
        words = ", ".join(f"{factor:.4g}" for factor in factors)
        header.notes.append(f"pixels divided by EXPOSURE and COLORCORR: {words}")
    return header


def _line(path: Path, data: bytes, start: int) -> tuple[str, int]:
    """Give a line, without its end, and where the next one begins."""
    end = data.find(b"\n", start)
    if end < 0:
        raise ImageError(f"image: {path}: header: ends too early: is the file complete?")
    return data[start:end].removesuffix(b"\r").decode("latin-1"), end + 1


def _numbers(path: Path, name: str, value: str) -> Array:
    try:
        numbers = np.array([float(word) for word in value.split()])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != _NUMBERS[name] or not np.isfinite(numbers).all():
        count = _NUMBERS[name]
        wanted = "a number" if count == 1 else f"{count} numbers"
        raise ImageError(f"image: {path}: header: {name}={value.strip()}: expected {wanted}")
    return numbers


def _set_format(path: Path, header: _Header, value: str) -> None:
    if value not in _FORMATS:
        raise ImageError(
            f"image: {path}: header: FORMAT={value}: expected {' or '.join(sorted(_FORMATS))}"
        )
    header.kind = _FORMATS[value]


def _set_light(path: Path, header: _Header, name: str, numbers: Array) -> None:
    """Take one line over; exposures and corrections multiply; any other 0 states nothing."""
    if name in ("EXPOSURE", "COLORCORR"):
        if (numbers <= 0).any():
            raise ImageError(f"image: {path}: header: {name}: expected numbers above 0")
        if name == "EXPOSURE":
            header.exposure *= float(numbers[0])
        else:
            header.correction = header.correction * numbers
    elif name == "PRIMARIES":
        header.primaries = primaries.or_rec709([float(number) for number in numbers])
    elif name == "GAMMA" and numbers[0] not in (0, 1):
        raise ImageError(f"image: {path}: header: GAMMA={numbers[0]:g}: no linear light")
    elif name == "PIXASPECT" and numbers[0] not in (0, 1):
        header.notes.append("PIXASPECT is not used: the projection tells where a pixel looks")


def _set_size(path: Path, header: _Header, data: bytes) -> None:
    line, header.end = _line(path, data, header.end)
    size = _SIZE.fullmatch(line)
    if size is None or {size[1][1], size[3][1]} != {"X", "Y"}:
        raise ImageError(f"image: {path}: header: size {line[:40]}: expected -Y HEIGHT +X WIDTH")
    header.axes = size[1], size[3]
    header.shape = int(size[2]), int(size[4])
    if not 0 < header.shape[0] * header.shape[1] <= _MOST_PIXELS:
        raise ImageError(f"image: {path}: header: size {line}: too small or too large")


# ---------------------------------------------------------------- pixels


def _pixels(path: Path, data: bytes, shape: tuple[int, int]) -> Radiance:
    """Give pixels (scan lines, pixels of each, 3) as they are stored."""
    if _is_compressed_by_channel(data, shape[1]):
        # the one encoding that OpenCV reads right; behind a header that it reads
        size = f"-Y {shape[0]} +X {shape[1]}\n".encode()
        head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n"
        decoded = opencv.decode(head + size + data, cv2.IMREAD_UNCHANGED)
        if decoded is not None:
            return np.asarray(decoded[..., ::-1], dtype=np.float32)
    else:
        codes = _pixel_by_pixel(data, shape[0] * shape[1])
        if codes is not None:
            return _light(codes).reshape(*shape, 3)
    raise ImageError(f"image: {path}: pixels: too few, or damaged: is the file complete?")


def _is_compressed_by_channel(data: bytes, width_px: int) -> bool:
    """Tell by the mark of a scan line: two bytes of 2, and the width."""
    return 8 <= width_px < 1 << 15 and data[:4] == bytes([2, 2, width_px >> 8, width_px & 255])


def _pixel_by_pixel(data: bytes, count: int) -> NDArray[np.uint8] | None:
    """Four bytes for each pixel, or 1, 1, 1, n: the one before n times again; None: too few.

    The n of such quadruples that follow each other are the bytes of one number, the lowest first.
    """
    quads = np.frombuffer(data, np.uint8, len(data) // 4 * 4).reshape(-1, 4)
    again = (quads[:, :3] == 1).all(axis=1)
    index = np.arange(len(quads))
    source = np.maximum.accumulate(np.where(again, -1, index))
    if len(quads) == 0 or again[0]:
        return None
    place = np.minimum(index - source - 1, 3)
    repeats = np.where(again, quads[:, 3].astype(np.int64) << 8 * np.maximum(place, 0), 1)
    last = int(np.searchsorted(np.cumsum(repeats), count))
    if last == len(quads):
        return None
    repeats[last] -= repeats[: last + 1].sum() - count
    return np.repeat(quads[source[: last + 1]], repeats[: last + 1], axis=0)


def _light(codes: NDArray[np.uint8]) -> Radiance:
    """Three mantissas and their exponent; as engines read them, without Radiance's half step."""
    scale = np.where(codes[:, 3:] > 0, np.ldexp(1.0, codes[:, 3:].astype(np.int32) - 136), 0.0)
    return (codes[:, :3] * scale).astype(np.float32)


def _turned(pixels: Radiance, axes: tuple[str, str]) -> Radiance:
    """Rows from the top, columns from the left."""
    upright = pixels if axes[0][1] == "Y" else pixels.transpose(1, 0, 2)
    if "+Y" in axes:
        upright = upright[::-1]
    return upright[:, ::-1] if "-X" in axes else upright
