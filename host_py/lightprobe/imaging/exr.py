"""OpenEXR files, by the library of the Academy Software Foundation.

A file may hold several parts and layers: the picture is the one without a name, or named as
renderers name what the camera sees. It fills the display window; where the file has no samples it
was not seen. What cannot be taken for scene light is refused by name.
"""

from __future__ import annotations

import io
import tempfile
from collections import defaultdict
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from lightprobe.errors import ImageError
from lightprobe.geometry import Array
from lightprobe.imaging import primaries, transparency
from lightprobe.imaging.decoded import HALF_MOST, MOST_PIXELS, TOO_LARGE, Decoded, Radiance, convert
from lightprobe.imaging.quiet import quiet

#: Last words of the names of parts and layers that hold the picture, in lower case.
_PICTURE_NAMES = frozenset(
    {"beauty", "c", "ci", "color", "colour", "combined", "composite", "main", "rgb", "rgba"}
)
_XYZ, _CHROMA = ("x", "y", "z"), ("y", "ry", "by")
#: Channels of a picture, best first, in lower case.
_KINDS = (("r", "g", "b"), ("red", "green", "blue"), _XYZ, _CHROMA, ("y",))
_EXPECTED = "expected R G B, X Y Z, Y RY BY, or Y"
#: Values of the attribute colorInteropID that say nothing, and that of CIE X, Y, Z.
_NO_ID, _XYZ_ID = frozenset({"", "unknown"}), "lin_ciexyzd65_scene"
#: Below it half floats lose precision.
_HALF_LEAST = float(np.finfo(np.float16).tiny)


@dataclass(frozen=True, eq=False)
class _Part:
    name: str  # "": the file's only one
    header: dict[str, Any]
    channels: dict[str, Any]  # OpenEXR.Channel by name; empty of files that are deep altogether

    @property
    def is_deep(self) -> bool:
        return self.header.get("type") in (OpenEXR.deepscanline, OpenEXR.deeptile)

    @property
    def views(self) -> list[str]:
        """Names of the cameras of a stereo picture, the one to be shown alone first."""
        return [str(view) for view in self.header.get("multiView", [])]


@dataclass(frozen=True, eq=False)
class _Layer:
    """Channels of a part that make a picture."""

    name: str  # as a user would say it; "": the main one
    part: _Part
    channels: dict[str, Any]  # by the last word of their names, in lower case
    kind: tuple[str, ...]  # of _KINDS

    @property
    def view(self) -> str:
        """Which camera of a stereo picture; "": the only one."""
        named = [word for word in self.name.split(".") if word in self.part.views]
        main = self.part.views[:1] if len(self.part.views) > 1 else []
        return str(self.part.header.get("view", "")) or "".join((named or main)[:1])

    @property
    def is_picture(self) -> bool:
        """By its name, without that of its view."""
        words = [word.lower() for word in self.name.split(".") if word and word != self.view]
        return not words or words[-1] in _PICTURE_NAMES


def read(path: Path) -> Decoded:
    """Read the picture of a file; raises :class:`ImageError`."""
    parts = _parts(path)
    layers = [layer for part in parts for layer in _layers(part)]
    layer = _choose(path, parts, layers)
    header = layer.part.header
    if header.get("envmap") == OpenEXR.ENVMAP_CUBE:
        raise ImageError(f"image: {path}: envmap: a cube: expected a latitude-longitude map")
    stated = _primaries(path, layer)
    radiance = np.stack(_planes(layer, stated), axis=-1)
    converted = convert(radiance, stated)
    transparent = _transparent(layer, converted.radiance)
    radiance, unseen, about_windows = _in_display_window(
        path, header, converted.radiance, transparent
    )
    if np.isnan(radiance[~unseen]).all():
        raise ImageError(f"image: {path}: every sample is NaN or transparent: there is no light")
    if transparent.any():
        about_windows += [transparency.NOTE]
    notes = converted.notes + _others(layer, layers) + about_windows + _remarks(header)
    return Decoded(radiance, notes, unseen if unseen.any() else None)


def encode(pixels: Radiance) -> bytes:
    """Bytes of a picture (height, width, 3), Rec. 709; half floats where they are fine enough."""
    magnitude = np.abs(pixels[pixels != 0])
    fits = bool(((magnitude >= _HALF_LEAST) & (magnitude < HALF_MOST)).all())
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = {"RGB": pixels.astype(np.float16 if fits else np.float32)}
    with tempfile.NamedTemporaryFile(suffix=".exr") as file:  # the library writes nothing else
        OpenEXR.File(header, channels).write(file.name)
        return Path(file.name).read_bytes()


# ---------------------------------------------------------------- which layer


def _parts(path: Path) -> list[_Part]:
    """Read all parts; deep ones alone without their samples, which nothing here can use."""
    try:
        with quiet(), redirect_stdout(io.StringIO()):  # its warnings go to both
            stated = parts = _open(path, header_only=True)
            if not all(part.is_deep for part in stated):
                parts = _open(path, header_only=False)
    except Exception as error:  # OpenEXR raises whatever its C++ core throws
        raise ImageError(f"image: {path}: decode: {error}: is the file complete?") from None
    if len(parts) < len(stated) or not all(part.channels or part.is_deep for part in parts):
        # of what it cannot read it only warns
        raise ImageError(f"image: {path}: decode: samples are missing: is the file complete?")
    return parts


def _open(path: Path, *, header_only: bool) -> list[_Part]:
    with OpenEXR.File(str(path), separate_channels=True, header_only=header_only) as file:
        several = len(file.parts) > 1
        return [
            _Part(part.name() if several else "", dict(part.header), dict(part.channels))
            for part in file.parts
        ]


def _layers(part: _Part) -> list[_Layer]:
    """Layers of a part that could be pictures."""
    if part.is_deep:
        return []
    by_layer: dict[str, dict[str, Any]] = defaultdict(dict)
    for name, channel in part.channels.items():
        prefix, _, last = name.rpartition(".")
        by_layer[prefix][last.lower()] = channel
    layers = []
    for prefix, channels in by_layer.items():
        kind = next((kind for kind in _KINDS if set(kind) <= set(channels)), None)
        if kind is None:
            continue
        # a part that is named as its only layer
        name = (
            prefix if prefix.startswith(part.name) else ".".join(filter(None, [part.name, prefix]))
        )
        layer = _Layer(name, part, channels, kind)
        if kind != _XYZ or layer.is_picture:  # positions and normals are X Y Z, too
            layers.append(layer)
    return layers


def _choose(path: Path, parts: list[_Part], layers: list[_Layer]) -> _Layer:
    """Give the layer that is the picture; raises ImageError where nothing tells which."""
    if not layers:
        raise _none(path, parts)
    named = [layer for layer in layers if layer.is_picture] or layers
    coloured = [layer for layer in named if len(layer.kind) == 3] or named
    found = [layer for layer in coloured if not layer.name] or coloured
    if len({layer.view for layer in found}) < len(found):
        names = ", ".join(layer.name for layer in found)
        raise ImageError(
            f"image: {path}: layers {names}: which is the picture is not known: "
            "write it alone, or name it beauty"
        )
    return found[0]


def _none(path: Path, parts: list[_Part]) -> ImageError:
    if any(part.is_deep for part in parts):
        return ImageError(
            f"image: {path}: deep samples (several in a pixel, each with its depth): "
            "flatten the picture first"
        )
    names = ", ".join(name for part in parts for name in part.channels)
    return ImageError(f"image: {path}: channels {names}: {_EXPECTED}")


def _others(layer: _Layer, layers: list[_Layer]) -> list[str]:
    """Say which of several was taken."""
    left_out = [other.name or "the main one" for other in layers if other is not layer]
    if not left_out:
        return []
    return [
        f"layer {layer.name or 'without a name'} is the picture; not used: {', '.join(left_out)}"
    ]


# ---------------------------------------------------------------- samples


def _planes(layer: _Layer, stated: tuple[float, ...]) -> list[NDArray[np.float32]]:
    """Three planes of the data window's size: R, G, B of the stated primaries, or X, Y, Z."""
    height, width = _size(layer.part.header["dataWindow"])
    planes = [_full_size(layer.channels[name], width, height) for name in layer.kind]
    if len(planes) == 1:
        return planes * 3
    return _of_chroma(planes, primaries.rgb_to_xyz(stated)[1]) if layer.kind == _CHROMA else planes


def _size(window: Any) -> tuple[int, int]:
    (left, top), (right, bottom) = window
    return int(bottom) - int(top) + 1, int(right) - int(left) + 1


def _full_size(channel: Any, width: int, height: int) -> NDArray[np.float32]:
    """Samples for every pixel: those of a coarser grid lie on its first, third, … ones."""
    plane = np.array(channel.pixels, dtype=np.float32)
    if channel.pixels.dtype == np.float16:
        plane[plane >= HALF_MOST] = np.inf
    steps = channel.xSampling, channel.ySampling
    if steps == (1, 1):
        return plane
    x, y = (
        np.minimum(np.arange(n, dtype=np.float32) / step, m - 1)
        for n, step, m in zip((width, height), steps, plane.shape[::-1], strict=True)
    )
    columns, rows = np.tile(x, (height, 1)), np.tile(y[:, None], (1, width))
    return np.asarray(cv2.remap(plane, columns, rows, cv2.INTER_LINEAR), dtype=np.float32)


def _of_chroma(planes: list[NDArray[np.float32]], weights: Array) -> list[NDArray[np.float32]]:
    """R, G, B of luminance Y, RY = (R − Y) / Y and BY = (B − Y) / Y."""
    y, ry, by = planes
    infinite = np.isposinf(y)
    y = np.where(infinite, 0, y)
    red, blue = (1 + ry) * y, (1 + by) * y
    green = (y - weights[0] * red - weights[2] * blue) / weights[1]
    return [np.where(infinite, np.inf, plane).astype(np.float32) for plane in (red, green, blue)]


# ---------------------------------------------------------------- colour


def _primaries(path: Path, layer: _Layer) -> tuple[float, ...]:
    """As the header states them; raises ImageError for what is no scene-linear light."""
    if layer.kind == _XYZ:
        return primaries.XYZ
    if len(layer.kind) == 1:  # grey is grey
        return primaries.REC709
    space = str(layer.part.header.get("colorInteropID", ""))
    if space in _NO_ID:
        return _chromaticities(path, layer.part.header)
    if space == _XYZ_ID:
        return primaries.XYZ
    known = OpenEXR.colorInteropIDToChromaticities(space)
    if known is None:
        raise ImageError(
            f"image: {path}: colorInteropID {space}: no scene-linear light: convert it to "
            "lin_rec709_scene"
        )
    return tuple(float(value) for value in known)


def _chromaticities(path: Path, header: dict[str, Any]) -> tuple[float, ...]:
    stated = primaries.or_rec709([float(one) for one in header.get("chromaticities", ())])
    try:
        primaries.rgb_to_xyz(stated)
    except ValueError as error:
        raise ImageError(f"image: {path}: chromaticities: {error}") from None
    return stated


# ---------------------------------------------------------------- where there are samples


def _transparent(layer: _Layer, radiance: Radiance) -> NDArray[np.bool_]:
    """Where a pixel is black and transparent; light that hides nothing is light.

    Alpha that is 0 everywhere, light or not, tells nothing.
    """
    alpha = layer.channels.get("a")
    if alpha is None or alpha.pixels.shape != radiance.shape[:2]:
        return np.zeros(radiance.shape[:2], bool)
    clear = np.asarray(alpha.pixels <= 0)
    black = (radiance == 0).all(axis=-1)
    return np.asarray(clear & (black if black.all() or not clear.all() else False))


def _in_display_window(
    path: Path, header: dict[str, Any], radiance: Radiance, transparent: NDArray[np.bool_]
) -> tuple[Radiance, NDArray[np.bool_], list[str]]:
    """Give the display window: what lies beyond is cut off, what is missing unseen, with a note."""
    (data_left, data_top), _ = header["dataWindow"]
    (left, top), _ = header["displayWindow"]
    height, width = _size(header["displayWindow"])
    down, right = int(data_top) - int(top), int(data_left) - int(left)
    rows = slice(max(down, 0), min(down + radiance.shape[0], height))
    columns = slice(max(right, 0), min(right + radiance.shape[1], width))
    if rows.start >= rows.stop or columns.start >= columns.stop:
        raise ImageError(
            f"image: {path}: the data window lies outside the display window: it shows nothing"
        )
    if height * width > MOST_PIXELS:
        raise ImageError(f"image: {path}: the display window is {width}×{height}: {TOO_LARGE}")
    placed = np.full((height, width, 3), np.nan, np.float32)
    unseen = np.ones((height, width), bool)
    stored = (
        slice(rows.start - down, rows.stop - down),
        slice(columns.start - right, columns.stop - right),
    )
    unseen[rows, columns] = transparent[stored]
    placed[rows, columns] = np.where(transparent[stored][..., None], np.nan, radiance[stored])
    share = (rows.stop - rows.start) * (columns.stop - columns.start) / (height * width)
    notes = [f"the data window covers {100 * share:.0f} % of the picture; the rest is not seen"]
    return placed, unseen, notes if share < 1 else []


def _remarks(header: dict[str, Any]) -> list[str]:
    """What the header says and is left to the user."""
    notes = []
    luminance = float(header.get("whiteLuminance", 0))
    if luminance > 0:
        notes.append(
            f"whiteLuminance: 1 is {luminance:g} cd/m²; to use it, --cd-m2-per-unit {luminance:g}"
        )
    if abs(float(header.get("pixelAspectRatio", 1)) - 1) > 0.01:
        notes.append("pixelAspectRatio is not used: the projection tells where a pixel looks")
    return notes
