"""Pictures of any usual kind as scene-linear float RGB, and PFM, the float format the daemon reads.

Arrays are (height, width, 3) float32, row 0 up, Rec. 709 primaries. HDR, EXR and PFM keep their own
units; 8- and 16-bit pictures are taken as sRGB, full scale = 1.
"""

from __future__ import annotations

import re
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe.colour import srgb_table, srgb_to_linear
from lightprobe.errors import LightprobeError

Radiance = NDArray[np.float32]

HDR_SUFFIXES = frozenset({".hdr", ".exr", ".pfm"})
JPEG_SUFFIXES = frozenset({".jpg", ".jpeg"})
SUFFIXES = HDR_SUFFIXES | JPEG_SUFFIXES | {".png", ".tif", ".tiff", ".bmp"}


#: A JPEG, and not one that ends where it begins; the daemon's rule (base/jpeg_start.h).
_ORIENTATION = 0x0112
_JPEG_START = re.compile(rb"\xff\xd8\xff+[^\xff\xd9]", re.DOTALL)


class ImageError(LightprobeError):
    """A picture that cannot be read; says which, at which stage, and what to do."""


@dataclass(frozen=True)
class Picture:
    """A picture as linear light, and what had to be done to it."""

    radiance: Radiance
    bits: int  # per sample in the file; 32 for float formats
    notes: tuple[str, ...] = ()


def read(path: str | Path) -> Picture:
    """Read HDR, EXR, PFM, PNG, JPEG, TIFF or BMP as linear light; raises :class:`ImageError`.

    Negative samples (lossy EXR leaves tiny ones) become 0 and are noted; NaN and infinity are left
    for the daemon, which flags them.
    """
    path = Path(path)
    if not path.is_file():
        raise ImageError(f"image: {path}: open: no such file")
    suffix = path.suffix.lower()
    if suffix == ".exr":
        radiance, notes, bits = *_read_exr(path), 32
    elif suffix == ".pfm":
        radiance, notes, bits = read_pfm(path), [], 32
    elif suffix in SUFFIXES:
        radiance, notes, bits = _read_cv2(path)
    else:
        raise ImageError(f"image: {path}: unknown kind: expected {', '.join(sorted(SUFFIXES))}")
    return Picture(radiance, bits, tuple(notes + _clamp_negative(radiance)))


def read_srgb8(path: str | Path) -> NDArray[np.uint8]:
    """Read the codes (height, width, 3) RGB of an 8-bit picture as they are.

    Those of 16 bits are rounded up or down at random, so that mean light stays what it is.
    """
    decoded = _decode(Path(path))
    if decoded.dtype == np.uint16:
        dither = np.random.default_rng(0).random((*decoded.shape[:2], *[1] * (decoded.ndim - 2)))
        rounded = np.minimum(decoded.astype(np.float64) / 257 + dither, 255)
        decoded = np.asarray(rounded, dtype=np.uint8)
    if decoded.dtype != np.uint8:
        raise ImageError(f"image: {path}: {decoded.dtype.itemsize * 8} bits a sample: expected 8")
    return np.ascontiguousarray(_three_channels(decoded, Path(path))[..., ::-1])


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ImageError(f"image: {path}: read: {error.strerror}") from None


def _decode(path: Path) -> NDArray[np.generic]:
    # As the daemon does it: pixels as they are stored, whatever a tag says of their orientation.
    jpeg = path.suffix.lower() in JPEG_SUFFIXES
    file = _bytes(path)
    if path.suffix.lower() in (".tif", ".tiff"):
        file = _as_stored(file)
    start = _JPEG_START.search(file) if jpeg else None
    data = np.frombuffer(file, np.uint8, offset=start.start() if start else 0)
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION if jpeg else cv2.IMREAD_UNCHANGED
    try:
        decoded = cv2.imdecode(data, flags) if data.size else None
    except cv2.error as error:
        raise ImageError(f"image: {path}: decode: {error.err}: is the file complete?") from None
    if decoded is None:
        raise ImageError(f"image: {path}: decode: contains no such picture: is the file complete?")
    return np.asarray(decoded)


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


def _read_exr(path: Path) -> tuple[Radiance, list[str]]:
    import OpenEXR  # slow to load, and only EXR files need it

    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
            chromaticities = file.header().get("chromaticities")
    except Exception as error:  # OpenEXR raises whatever its C++ core throws
        raise ImageError(f"image: {path}: decode: {error}: is the file complete?") from None
    planes = _rgb_planes(channels)
    if planes is None:
        raise ImageError(f"image: {path}: channels {', '.join(channels)}: expected R G B, or Y")
    radiance = np.stack(planes, axis=-1).astype(np.float32)
    if chromaticities is None:
        return radiance, []
    matrix = to_rec709(chromaticities)
    if np.allclose(matrix, np.eye(3), atol=2e-3):
        return radiance, []
    return (radiance @ matrix.T).astype(np.float32), ["primaries converted to Rec. 709"]


def _rgb_planes(channels: dict[str, NDArray[np.generic]]) -> list[NDArray[np.generic]] | None:
    """R, G, B of the main layer, else of the first layer that has them, else luminance thrice."""
    prefixes = sorted(
        {name.rpartition(".")[0] for name in channels}, key=lambda layer: (layer != "", layer)
    )
    for prefix in prefixes:
        names = [f"{prefix}.{c}" if prefix else c for c in "RGB"]
        if all(name in channels for name in names):
            return [channels[name] for name in names]
    return [channels["Y"]] * 3 if "Y" in channels else None


def to_rec709(chromaticities: ArrayLike) -> NDArray[np.float64]:
    """3×3 matrix from primaries (rx, ry, gx, gy, bx, by, wx, wy) to Rec. 709, D65.

    White is adapted by the Bradford transform (Lindbloom), so that neutral stays neutral.
    """
    rec709 = np.array([0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290])
    bradford = np.array(
        [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
    )
    c = np.asarray(chromaticities, dtype=np.float64)
    cones = [bradford @ _xyz(primaries[6], primaries[7]) for primaries in (c, rec709)]
    adapt = np.linalg.inv(bradford) @ np.diag(cones[1] / cones[0]) @ bradford
    return np.asarray(np.linalg.inv(_rgb_to_xyz(rec709)) @ adapt @ _rgb_to_xyz(c))


def _xyz(x: float, y: float) -> NDArray[np.float64]:
    return np.array([x / y, 1.0, (1 - x - y) / y])


def _rgb_to_xyz(c: NDArray[np.float64]) -> NDArray[np.float64]:
    primaries = np.stack([_xyz(c[i], c[i + 1]) for i in (0, 2, 4)], axis=1)
    return np.asarray(primaries * np.linalg.solve(primaries, _xyz(c[6], c[7])))


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
        return _exr(pixels)
    done, data = cv2.imencode(suffix, np.ascontiguousarray(pixels[..., ::-1]))
    if not done:
        raise ImageError(f"image: {suffix}: encode: not possible for {pixels.shape}")
    return data.tobytes()


def _exr(pixels: Radiance) -> bytes:
    """Through a file: the library writes nothing else."""
    import OpenEXR  # slow to load, and only EXR files need it

    most = float(np.finfo(np.float16).max)  # real suns exceed it: then float
    kind = np.float16 if float(pixels.max(initial=0)) < most else np.float32
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with tempfile.NamedTemporaryFile(suffix=".exr") as file:
        OpenEXR.File(header, {"RGB": pixels.astype(kind)}).write(file.name)
        return Path(file.name).read_bytes()


# ---------------------------------------------------------------- PFM

_PFM_HEADER = re.compile(rb"(PF|Pf)\s+(\d+)\s+(\d+)\s+(-?[\d.eE+-]+)\s")


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
    kind = "<f4" if scale < 0 else ">f4"
    pixels = np.frombuffer(data, kind, width * height * channels, header.end())
    pixels = pixels.reshape(height, width, channels)[::-1].astype(np.float32)
    return np.ascontiguousarray(np.repeat(pixels, 3, axis=2) if channels == 1 else pixels)
