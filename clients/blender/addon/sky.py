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
from lightprobe import sh
from lightprobe.estimate import SphericalHarmonics
from lightprobe.geometry import Array
from lightprobe.reflection_map import ReflectionMap, texels
from numpy.typing import ArrayLike, NDArray

from . import axes, harmonics

#: Of a picture of SH: at order 4, what linear interpolation loses is below 0.1 %.
SH_WIDTH_PX = 128
#: Texels of a reflection map are averaged over this many samples along an edge of a pixel.
_SAMPLES = 3


@dataclass(frozen=True, eq=False)
class Sky:
    """One picture of the world."""

    radiance: NDArray[np.float32]  # (height, 2 height, 3), row 0 is down; units of the packet
    source: Literal["SH", "MAP"]
    #: Largest error of irradiance against the packet, as a share of the largest irradiance.
    irradiance_error: float = 0.0

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
def directions(width_px: int, samples: int = 1) -> Array:
    """Unit vectors (width/2 · samples, width · samples, 3) in Blender's axes; row 0 is down.

    They run through the centres of the pixels of a picture that is `samples` times as fine.
    """
    columns, rows = width_px * samples, width_px // 2 * samples
    azimuth = np.pi - 2 * np.pi * (np.arange(columns) + 0.5) / columns
    elevation = np.pi * ((np.arange(rows) + 0.5) / rows - 0.5)
    flat = np.cos(elevation)[:, None]
    return np.stack(
        [
            flat * np.cos(azimuth),
            flat * np.sin(azimuth),
            np.broadcast_to(np.sin(elevation)[:, None], (rows, columns)),
        ],
        axis=-1,
    )


def _probe_directions(width_px: int, samples: int, orientation: ArrayLike | None) -> Array:
    """The same directions in the probe frame at capture time."""
    return np.asarray(axes.to_probe(directions(width_px, samples)) @ axes.turn(orientation))


@functools.cache
def _still_basis(order: int, width_px: int) -> Array:
    return sh.evaluate(order, _probe_directions(width_px, 1, None))


def from_harmonics(harmonics_of: SphericalHarmonics, orientation: ArrayLike | None = None) -> Sky:
    """Picture of SH, nowhere negative, with the irradiance of the SH.

    `orientation`: (4,) x, y, z, w of the estimate, where the light is to stay when the probe turns.
    """
    given = harmonics_of.coefficients
    fitted = harmonics.not_negative(given)
    if orientation is None:
        basis = _still_basis(harmonics_of.order, SH_WIDTH_PX)
    else:
        basis = sh.evaluate(harmonics_of.order, _probe_directions(SH_WIDTH_PX, 1, orientation))
    radiance = np.maximum(basis @ fitted, 0).astype(np.float32)
    return Sky(radiance, "SH", harmonics.irradiance_error(given, fitted))


def from_map(found: ReflectionMap, orientation: ArrayLike | None = None) -> Sky:
    """Picture of a reflection map, eight times as wide as a face; pixels are means of texels."""
    width_px = 8 * found.size
    rounded = None
    if orientation is not None:  # to 0.1°: a probe at rest costs one look at the cache
        rounded = tuple(np.round(np.asarray(orientation, np.float64), 3).tolist())
    places = _texels(found.size, width_px, rounded)
    return Sky(_mean_pixels(found.radiance[places], width_px), "MAP")


@functools.lru_cache(maxsize=2)
def _texels(
    size: int, width_px: int, orientation: tuple[float, ...] | None
) -> tuple[NDArray[np.intp], ...]:
    return texels(_probe_directions(width_px, _SAMPLES, orientation), size)


def _mean_pixels(fine: NDArray[np.float32], width_px: int) -> NDArray[np.float32]:
    """Average the samples of each pixel, by their solid angles."""
    rows, _, channels = fine.shape
    weight = np.cos(np.pi * ((np.arange(rows) + 0.5) / rows - 0.5)).astype(np.float32)
    weight = weight.reshape(-1, _SAMPLES)
    weight /= weight.sum(axis=1, keepdims=True) * _SAMPLES
    blocks = fine.reshape(rows // _SAMPLES, _SAMPLES, width_px, _SAMPLES, channels)
    return np.asarray(np.einsum("rs,rscte->rce", weight, blocks), np.float32)
