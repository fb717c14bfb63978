"""Pictures of the world for Blender's equirectangular environment texture.

Blender looks the texture up at u = ½ − atan2(Y, X) / 2π, v = ½ + asin(Z) / π, so the middle of the
picture is Blender's +X, columns grow clockwise as seen from above, and row 0 is down (Blender
Manual, Environment Texture; `direction_to_equirectangular` in Cycles' kernel).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Literal

import numpy as np
from lightprobe import geometry, not_negative, sh
from lightprobe.estimate import SphericalHarmonics
from lightprobe.geometry import Array
from lightprobe.reflection_map import ReflectionMap, solid_angles, texels
from numpy.typing import ArrayLike, NDArray

from . import axes

#: Of a picture of SH: at order 4, what linear interpolation loses is below 0.1 %.
SH_WIDTH_PX = 128
#: Samples along an edge of a pixel, to find the texels of a reflection map in it.
_SAMPLES = 8


@dataclass(frozen=True, eq=False)
class Sky:
    """One picture of the world."""

    radiance: NDArray[np.float32]  # (height, 2 height, 3), row 0 is down; units of the packet
    source: Literal["SH", "MAP"]
    #: Largest error of irradiance against the packet, as a share of the largest irradiance.
    irradiance_error: float = 0.0
    #: x, y, z, w: turns the picture's frame, the probe's, into one that stays; None: no turn.
    orientation: tuple[float, float, float, float] | None = None

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.radiance.shape[1], self.radiance.shape[0]

    def rgba(self) -> NDArray[np.float32]:
        """Flat pixels as `Image.pixels.foreach_set` takes them."""
        height, width, _ = self.radiance.shape
        pixels = np.ones((height, width, 4), np.float32)
        pixels[..., :3] = self.radiance
        return pixels.ravel()


@functools.cache
def directions(width_px: int) -> Array:
    """Unit vectors (width/2, width, 3) to the centres of the pixels, Blender's axes; row 0 down."""
    return _directions(width_px, 1, slice(None))


def _directions(width_px: int, samples: int, which: slice) -> Array:
    """The same for a picture that is `samples` times as fine, and only for some of its rows."""
    columns, rows = width_px * samples, width_px // 2 * samples
    azimuth = np.pi - 2 * np.pi * (np.arange(columns) + 0.5) / columns
    elevation = (np.pi * ((np.arange(rows) + 0.5) / rows - 0.5))[which]
    flat = np.cos(elevation)[:, None]
    return np.stack(
        [
            flat * np.cos(azimuth),
            flat * np.sin(azimuth),
            np.broadcast_to(np.sin(elevation)[:, None], (len(elevation), columns)),
        ],
        axis=-1,
    )


def _tuple(orientation: ArrayLike | None) -> tuple[float, float, float, float] | None:
    if orientation is None:
        return None
    x, y, z, w = (float(one) for one in np.asarray(orientation, np.float64))
    return x, y, z, w


@functools.cache
def _basis(order: int, width_px: int) -> Array:
    return sh.evaluate(order, axes.to_probe(directions(width_px)))


def from_harmonics(of: SphericalHarmonics, orientation: ArrayLike | None = None) -> Sky:
    """Picture of SH in the probe frame, nowhere negative, with the irradiance of the SH."""
    fitted = not_negative.fit(of.coefficients)
    radiance = np.maximum(_basis(of.order, SH_WIDTH_PX) @ fitted, 0).astype(np.float32)
    error = not_negative.irradiance_error(of.coefficients, fitted)
    return Sky(radiance, "SH", error, _tuple(orientation))


def from_map(found: ReflectionMap, orientation: ArrayLike | None = None) -> Sky:
    """Picture of a reflection map, eight times as wide as a face, in the probe frame.

    Every texel keeps its light: its radiance times its solid angle.
    """
    pixel, texel, share = _shares(found.size)
    width_px = 8 * found.size
    shape = (width_px // 2, width_px)
    channels = [
        np.bincount(pixel, share * channel[texel], minlength=shape[0] * shape[1])
        for channel in found.radiance.reshape(-1, 3).T.astype(np.float64)
    ]
    radiance = np.stack(channels, axis=-1).reshape(*shape, 3).astype(np.float32)
    return Sky(radiance, "MAP", 0.0, _tuple(orientation))


@functools.cache
def _shares(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Which texels are in which pixels: pixel (N,), texel (N,), share (N,) of the pixel.

    Found by samples in each pixel, row by row. Then the shares of each texel are scaled so that
    they add up to its solid angle exactly: a lamp may be one texel alone.
    """
    width_px = 8 * size
    rows = [_row_shares(size, width_px, row) for row in range(width_px // 2)]
    pixel, texel, solid_angle_sr = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    sampled = np.bincount(texel, solid_angle_sr, minlength=6 * size * size)
    exact = solid_angles(size).ravel()
    solid_angle_sr *= (exact / sampled)[texel]
    of_pixel = geometry.equirect_solid_angles(width_px, width_px // 2)[pixel // width_px]
    return pixel, texel, solid_angle_sr / of_pixel


def _row_shares(
    size: int, width_px: int, row: int
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """The same for one row of pixels, with solid angles (N,) in sr instead of shares."""
    fine = slice(row * _SAMPLES, (row + 1) * _SAMPLES)
    face, line, column = texels(axes.to_probe(_directions(width_px, _SAMPLES, fine)), size)
    texel = (face * size + line) * size + column
    here = np.arange(width_px * _SAMPLES) // _SAMPLES
    heights = geometry.equirect_solid_angles(width_px * _SAMPLES, width_px // 2 * _SAMPLES)[fine]
    texels_in_all = 6 * size * size
    pairs, which = np.unique(here * texels_in_all + texel, return_inverse=True)
    weights = np.broadcast_to(heights[:, None], texel.shape).ravel()
    solid_angle_sr = np.asarray(np.bincount(which.ravel(), weights), np.float64)
    return row * width_px + pairs // texels_in_all, pairs % texels_in_all, solid_angle_sr
