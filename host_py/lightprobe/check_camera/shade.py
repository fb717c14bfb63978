"""The light of a room with its lamp in view and with the lamp hidden, on cells of the picture."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.calibrate.exposure_series import Codes, ExposureSeries
from lightprobe.calibrate.flat_patches import exposure_of, steady_frames
from lightprobe.check_camera.scene import GREEN
from lightprobe.geometry import Array
from lightprobe.imaging.camera import Camera

#: Exposures before the lamp is hidden and after; those that a camera has not are left out.
SHADE_US = (8.0, 32.0, 128.0, 512.0, 2048.0, 8192.0, 32768.0)
#: Cells across the picture: 5.6 degrees of a panorama.
_CELLS = 64
#: A cell counts where so much of it is seen, and its exposure where no pixel
#: is as bright as this: a JPEG makes small lamps that clip darker than full scale.
_LEAST_SEEN, _CLIPPED_CODE = 0.9, 230
#: What is known of a cell: of its code, and of its light, relative; 1 sigma.
_CODE_SIGMA, _LIGHT_SIGMA = 0.25, 0.006
#: Each of two lenses of a panorama sees so far beyond its half of the sphere.
_OVERLAP_DEG = 5.0


@dataclass(frozen=True, eq=False)
class Cells:
    """Where the cells (n) of a camera's picture look, and by which lens."""

    rows: int
    columns: int
    wraps: bool
    directions: Array  # (n, 3)
    solid_angle_sr: Array  # (n,)
    seen: NDArray[np.bool_]  # (n,)
    #: (n, lenses) share of each lens, for each way in which the picture may have been made.
    lenses: tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class Shaded:
    """Green light (n,) of cells before and after a lamp was hidden; NaN: clipped, or not seen."""

    cells: Cells
    before: Array
    after: Array
    sigma: Array
    clipped: NDArray[np.bool_]  # before, in all exposures: a lamp, or a stuck pixel
    still: NDArray[np.bool_]  # after


@dataclass(frozen=True, eq=False)
class _Bracket:
    exposures_us: Array  # (k,)
    light: Array  # (k, n) radiance
    sigma: Array  # (k, n)
    clipped: NDArray[np.bool_]  # (k, n)


def cells_of(camera: Camera, size_px: tuple[int, int]) -> Cells:
    """Divide pictures of size_px (width, height)."""
    width, height = size_px
    directions, illumination = camera.look(width, height)
    seen = (illumination > 0).astype(np.float64)
    directions = np.nan_to_num(directions)
    across, down = np.gradient(directions, axis=1), np.gradient(directions, axis=0)
    area = np.linalg.norm(np.cross(across, down), axis=-1) * seen
    if camera.is_equirect:
        ways = [np.ones((height, width, 1))]
        if camera.is_whole:
            # Perhaps two lenses, one ahead and one behind, made it; both see what is between them.
            behind_deg = np.degrees(np.arcsin(np.clip(directions[..., 2], -1, 1)))
            behind = np.clip(0.5 + behind_deg / (2 * _OVERLAP_DEG), 0, 1)
            ways.append(np.stack([1 - behind, behind], axis=-1))
    else:
        ways = [np.eye(len(camera.lenses))[camera.owner(width, height)]]
    columns, rows = _grid(size_px)
    weight = np.maximum(_mean(area, size_px), 1e-12)
    looks = _mean(directions * area[..., None], size_px)
    looks /= np.maximum(np.linalg.norm(looks, axis=1, keepdims=True), 1e-12)
    shares = [_mean(way * area[..., None], size_px) / weight[:, None] for way in ways]
    pixels = width * height / (columns * rows)
    return Cells(
        rows, columns, camera.is_whole, looks, weight * pixels,
        _mean(seen, size_px) >= _LEAST_SEEN, tuple(shares),
    )  # fmt: skip


def shaded(
    camera: Camera, before: ExposureSeries, after: ExposureSeries, table: Array
) -> Shaded | None:
    """Compare two brackets by the response (256, 3); None: a picture is missing or of other size.

    Each cell is compared at the longest exposure in which it clips neither before nor after, so
    that errors of exposure and response are the same in both.
    """
    found = [_bracket(camera, one, table) for one in (before, after)]
    if found[0] is None or found[1] is None:
        return None
    (first, size_px), (second, other_px) = found[0], found[1]
    if size_px != other_px or not np.array_equal(first.exposures_us, second.exposures_us):
        return None
    cells = cells_of(camera, size_px)
    good = ~(first.clipped | second.clipped)
    count = len(first.exposures_us)
    longest = count - 1 - np.argmax(good[::-1], axis=0)
    at = longest, np.arange(good.shape[1])
    usable = good.any(axis=0) & cells.seen
    light, left, sigma = (
        np.where(usable, one[at], np.nan) for one in (first.light, second.light, first.sigma)
    )
    sigma = np.hypot(sigma, _LIGHT_SIGMA * light)
    clipped, still = (one.clipped.all(axis=0) & cells.seen for one in (first, second))
    return Shaded(cells, light, left, sigma, clipped, still)


def _bracket(
    camera: Camera, series: ExposureSeries, table: Array
) -> tuple[_Bracket, tuple[int, int]] | None:
    steps: dict[float, tuple[Array, Array, NDArray[np.bool_]]] = {}
    size_px, gain = (0, 0), np.zeros(0)
    for group in series.steps():
        exposure_us, pictures = exposure_of(series, group), steady_frames(group)
        if not exposure_us or not pictures:
            continue
        if size_px == (0, 0):
            size_px = pictures[0].shape[1], pictures[0].shape[0]
            gain = _gain(camera, size_px)
        if any(one.shape[:2] != size_px[::-1] for one in pictures):
            return None
        light, sigma, clipped = _of_pictures(pictures, table[:, GREEN], gain)
        steps[group[-1].commanded_us or exposure_us] = (
            light / exposure_us, sigma / exposure_us, clipped,
        )  # fmt: skip
    if not steps:
        return None
    order = sorted(steps)
    lights, sigmas, clips = zip(*(steps[one] for one in order), strict=True)
    return _Bracket(np.array(order), np.stack(lights), np.stack(sigmas), np.stack(clips)), size_px


def _gain(camera: Camera, size_px: tuple[int, int]) -> Array:
    """By which pixels (H, W) count: what the lens' roll-off took; 0 where nothing is seen."""
    _, illumination = camera.look(*size_px)
    return np.where(illumination > 0.05, 1 / np.maximum(illumination, 0.05), 0)


def _of_pictures(
    pictures: list[Codes], curve: Array, gain: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Light of cells, its sigma by that of codes, and which clip."""
    size_px = gain.shape[1], gain.shape[0]
    codes = np.stack([one[..., GREEN] for one in pictures])
    seen = np.maximum(_mean((gain > 0).astype(np.float64), size_px), 1e-9)
    light = _mean(curve[codes].mean(axis=0) * gain, size_px) / seen
    slope = np.gradient(curve)[codes[0]]
    sigma = _CODE_SIGMA * _mean(slope * gain, size_px) / seen
    bright = (np.max(pictures, axis=(0, 3)) >= _CLIPPED_CODE) & (gain > 0)
    return light, sigma, _mean(bright.astype(np.float64), size_px) > 0


def _grid(size_px: tuple[int, int]) -> tuple[int, int]:
    return _CELLS, max(round(_CELLS * size_px[1] / size_px[0]), 1)


def _mean(values: Array, size_px: tuple[int, int]) -> Array:
    """Means (n, …) of cells of a picture (H, W, …)."""
    cells = cv2.resize(values, _grid(size_px), interpolation=cv2.INTER_AREA)
    columns, rows = _grid(size_px)
    return np.asarray(cells, dtype=np.float64).reshape(columns * rows, *values.shape[2:])
