"""Scenes with known light: lamps over a background, rendered as equirectangular radiance maps.

A scene is linear: a base map, plus one layer per lamp that can be switched and dimmed. Rendering
and truth come from the same numbers, and truth is exact: closed forms for procedural scenes, sums
in float64 over the unclipped map for panoramas.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe import geometry, sh
from lightprobe.colour import luminance
from lightprobe.geometry import Array
from lightprobe.imaging import image
from lightprobe.lamp import Lamp, disc_pixels

#: Rows of a map that are computed at a time.
_ROWS = 16
#: Highest SH order of truth.
ORDER = sh.MAX_ORDER


@dataclass(frozen=True, eq=False)
class Layer:
    """What a lamp adds to a map, at full power: pixels by flat index, or all of them."""

    index: NDArray[np.int64] | slice
    values: NDArray[np.float32]  # (len(index), 3)
    polarized: NDArray[np.float32] | None = None  # (2, len(index), 3): S1, S2; None: zero


@dataclass(frozen=True, eq=False)
class Layers:
    """A rendered scene: base map (H, W, 3) and one layer per lamp.

    Polarized light is Stokes' S1 and S2 in each pixel's own frame: x = d × up, y up, angles
    counter-clockwise as seen from the probe; radiance is S0. The frame turns with the scene about
    the vertical, so a map may be rolled as it is.
    """

    base: NDArray[np.float32]
    lamps: tuple[Layer, ...]
    polarized: NDArray[np.float32] | None = None  # (2, H, W, 3): S1, S2 of the base; None: zero

    @property
    def unpolarized(self) -> bool:
        """True when no part of the scene is polarized."""
        return self.polarized is None and all(layer.polarized is None for layer in self.lamps)

    def compose(self, powers: ArrayLike) -> NDArray[np.float32]:
        """Radiance with each lamp at its power (0 off, 1 full): (lamps,), or by row (H, lamps)."""
        radiance = self.base.copy()
        self._add_lamps(radiance.reshape(-1, 3), powers)
        return radiance

    def compose_lamps(self, powers: ArrayLike) -> NDArray[np.float32]:
        """Radiance of the lamps alone."""
        radiance = np.zeros_like(self.base)
        self._add_lamps(radiance.reshape(-1, 3), powers)
        return radiance

    def _add_lamps(self, flat: NDArray[np.float32], powers: ArrayLike) -> None:
        by_lamp = np.asarray(powers, dtype=np.float32).T
        for layer, power in zip(self.lamps, by_lamp, strict=True):
            if not power.any():
                continue
            if power.ndim and isinstance(layer.index, slice):
                self._add_rows(flat, power, layer.values)
            else:
                flat[layer.index] += self._spread(power, layer.index) * layer.values

    def _add_rows(
        self, flat: NDArray[np.float32], power: NDArray[np.float32], values: NDArray[np.float32]
    ) -> None:
        """Add a layer of all pixels, each row at its power; what is at work stays in the cache."""
        height = len(power)
        radiance, layer = flat.reshape(height, -1), values.reshape(height, -1)
        for top in range(0, height, _ROWS):
            rows = slice(top, top + _ROWS)
            radiance[rows] += power[rows, None] * layer[rows]

    def _spread(
        self, power: NDArray[np.float32], index: NDArray[np.int64] | slice
    ) -> NDArray[np.float32]:
        """A lamp's power at its layer's pixels: one number, or that of each pixel's row."""
        if power.ndim == 0:
            return power
        by_pixel = np.repeat(power, self.base.shape[1])[index]
        return np.asarray(by_pixel[:, None])

    def compose_polarized(self, powers: ArrayLike) -> NDArray[np.float32]:
        """S1 and S2 (2, H, W, 3) with each lamp at its power, as :meth:`compose` takes them."""
        stokes = np.zeros((2, *self.base.shape), np.float32)
        if self.polarized is not None:
            stokes += self.polarized
        flat = stokes.reshape(2, -1, 3)
        by_lamp = np.asarray(powers, dtype=np.float32).T
        for layer, power in zip(self.lamps, by_lamp, strict=True):
            if power.any() and layer.polarized is not None:
                flat[:, layer.index] += self._spread(power, layer.index) * layer.polarized
        return stokes


class Truth(Protocol):
    """Light that a scene really casts."""

    @property
    def lamps(self) -> tuple[Lamp, ...]:
        """Lamps that are lit, as bright as they are."""

    @property
    def total(self) -> Array:
        """SH of everything, TOTAL: ((ORDER+1)², 3)."""

    def irradiance(self, normals: ArrayLike) -> Array:
        """Irradiance (N, 3) on surfaces with normals (N, 3)."""


class Scene(Protocol):
    """Anything with a name, lamps, a picture, and the truth about its light."""

    def __hash__(self) -> int:
        """Scenes that are equal shine alike; most are equal to themselves alone."""

    @property
    def name(self) -> str:
        """For tables."""

    @property
    def lamps(self) -> tuple[Lamp, ...]:
        """All lamps, at full power."""

    def render(self, width_px: int, height_px: int) -> Layers:
        """Equirectangular map of radiance."""

    def truth(self, powers: ArrayLike, rotation: ArrayLike = geometry.UNTURNED) -> Truth:
        """Truth in the camera's frame with lamps at their powers; `rotation`: camera to scene."""

    def scaled(self, factor: float) -> Scene:
        """Give the same scene, brighter by a factor."""


@runtime_checkable
class Walkable(Scene, Protocol):
    """A scene in which a probe can leave its place."""

    def contains(self, places_m: Array) -> NDArray[np.bool_]:
        """Tell which places (…, 3), metres, it can be seen from."""

    def seen_from(self, place_m: tuple[float, float, float]) -> Scene:
        """Give the same scene with the probe elsewhere; UsageError where it cannot be."""


# ---------------------------------------------------------------- procedural scenes


@dataclass(frozen=True, eq=False)
class ProceduralScene:
    """Disc lamps over a smooth gradient (SH of order ≤ 2, positive everywhere)."""

    name: str
    background: Array  # (9, 3) SH of radiance
    lamps: tuple[Lamp, ...]

    def render(self, width_px: int, height_px: int) -> Layers:
        """Render anti-aliased discs; each one's flux is its irradiance to float32's precision."""
        directions = geometry.equirect_directions(width_px, height_px)
        base = sh.radiance(self.background, directions).astype(np.float32)
        return Layers(base, tuple(disc_layer(lamp, width_px, height_px) for lamp in self.lamps))

    def scaled(self, factor: float) -> ProceduralScene:
        """See :class:`Scene`."""
        lamps = tuple(lamp.scaled(factor) for lamp in self.lamps)
        return ProceduralScene(self.name, factor * self.background, lamps)

    def truth(self, powers: ArrayLike, rotation: ArrayLike = geometry.UNTURNED) -> ProceduralTruth:
        """Give closed forms."""
        background = sh.rotate(self.background, geometry.inverse(rotation))
        return ProceduralTruth(background, lit_lamps(self.lamps, powers, rotation))


@dataclass(frozen=True, eq=False)
class ProceduralTruth:
    """Closed forms: a gradient's SH, and uniform discs."""

    background: Array
    lamps: tuple[Lamp, ...]

    @property
    def total(self) -> Array:
        """See :class:`Truth`."""
        total = np.zeros((sh.count(ORDER), 3))
        total[: len(self.background)] = self.background
        for lamp in self.lamps:
            total += np.outer(sh.lamp(lamp.direction, ORDER, lamp.radius_deg), lamp.irradiance)
        return total

    def irradiance(self, normals: ArrayLike) -> Array:
        """See :class:`Truth`; discs as 256 points of equal solid angle, so that they set softly."""
        n = np.asarray(normals, dtype=np.float64)
        total = sh.irradiance(self.background, n)
        for lamp in self.lamps:
            points = geometry.disc_points(lamp.direction, lamp.radius_deg, 256)
            share = np.maximum(n @ points.T, 0).mean(axis=-1)
            total += share[:, None] * lamp.irradiance
        return total


def disc_layer(lamp: Lamp, width_px: int, height_px: int) -> Layer:
    """Pixels of a lamp's disc, as a layer; see :func:`lightprobe.lamp.disc_pixels`."""
    return Layer(*disc_pixels(lamp, width_px, height_px))


def lit_lamps(lamps: tuple[Lamp, ...], powers: ArrayLike, rotation: ArrayLike) -> tuple[Lamp, ...]:
    """Lamps that are on, as bright as they are, in the frame of a camera that is turned."""
    turned = geometry.inverse(rotation)
    return tuple(
        Lamp(geometry.rotate(turned, lamp.direction), lamp.radius_deg, power * lamp.irradiance)
        for lamp, power in zip(lamps, np.asarray(powers, dtype=np.float64), strict=True)
        if power > 0
    )


# ---------------------------------------------------------------- panoramas


def has_exact_lamps(scene: Scene) -> bool:
    """Whether its lamps are what it was made of, and not found in a picture of it."""
    return not isinstance(scene, PanoramaScene)


@dataclass(frozen=True, eq=False)
class PanoramaScene:
    """A real radiance map; its lamps are what stands out of it (see :func:`split_lamps`)."""

    name: str
    radiance: NDArray[np.float32]  # (H, W, 3), unclipped, lamps included
    base: NDArray[np.float32]  # without the lamps
    lamps: tuple[Lamp, ...]
    layers: tuple[Layer, ...]

    @classmethod
    def load(cls, path: str | Path) -> PanoramaScene:
        """Read any picture :mod:`lightprobe.imaging.image` reads."""
        picture = image.read(path)
        height, width, _ = picture.radiance.shape
        if width != 2 * height:
            raise image.ImageError(
                f"image: {path}: {width}×{height}: an equirectangular map is twice as wide as high"
            )
        if not np.all(np.isfinite(picture.radiance)):
            raise image.ImageError(
                f"image: {path}: contains NaN or infinite samples, so there is no exact truth"
            )
        return cls.of(Path(path).stem, picture.radiance)

    @classmethod
    def of(cls, name: str, radiance: NDArray[np.float32]) -> PanoramaScene:
        """Make a scene of a map (H, 2H, 3)."""
        base, lamps, layers = split_lamps(radiance)
        return cls(name, radiance, base, lamps, layers)

    def render(self, width_px: int, height_px: int) -> Layers:
        """Resample to another size; seamless at the seam."""
        height, width, _ = self.radiance.shape
        if (height, width) == (height_px, width_px):
            return Layers(self.base, self.layers)
        base = resize(self.base, width_px, height_px)
        layers = []
        for layer in self.layers:
            alone = np.zeros_like(self.base)
            alone.reshape(-1, 3)[layer.index] = layer.values
            flat = resize(alone, width_px, height_px).reshape(-1, 3)
            index = np.flatnonzero(flat.any(axis=1))
            layers.append(Layer(index, flat[index]))
        return Layers(base, tuple(layers))

    def scaled(self, factor: float) -> PanoramaScene:
        """See :class:`Scene`."""
        gain = np.float32(factor)
        return PanoramaScene(
            self.name,
            gain * self.radiance,
            gain * self.base,
            tuple(lamp.scaled(factor) for lamp in self.lamps),
            tuple(Layer(layer.index, gain * layer.values) for layer in self.layers),
        )

    def truth(self, powers: ArrayLike, rotation: ArrayLike = geometry.UNTURNED) -> MapTruth:
        """Sum over the map."""
        radiance = Layers(self.base, self.layers).compose(powers)
        return MapTruth(radiance, rotation, lit_lamps(self.lamps, powers, rotation))


@dataclass(frozen=True, eq=False)
class MapTruth:
    """Sums in float64 over all pixels of a map, for a camera that is turned in it."""

    radiance: NDArray[np.float32]
    rotation: ArrayLike = geometry.UNTURNED  # camera to map
    lamps: tuple[Lamp, ...] = field(default=())

    @property
    def total(self) -> Array:
        """See :class:`Truth`."""
        return sh.rotate(sh.project(self.radiance, ORDER), geometry.inverse(self.rotation))

    def irradiance(self, normals: ArrayLike) -> Array:
        """See :class:`Truth`."""
        n = geometry.rotate(self.rotation, normals)
        height, width, _ = self.radiance.shape
        solid_angle = geometry.equirect_solid_angles(width, height)
        # Directions of a row: those of the horizon times a cosine, plus up times a sine.
        horizon = geometry.equirect_direction(np.arange(width), (height - 1) / 2, width, height).T
        up = geometry.equirect_direction(0, np.arange(height), width, height)[:, 1]
        total = np.zeros((len(n), 3))
        # In blocks that the BLAS does not spread over threads, which would fight for the cores.
        for block in (slice(first, first + 128) for first in range(0, len(n), 128)):
            along, upwards = n[block] @ horizon, n[block, 1:2]
            for row in range(height):
                cosine = along * np.sqrt(1 - up[row] ** 2)
                cosine += upwards * up[row]
                np.maximum(cosine, 0, out=cosine)
                total[block] += cosine @ (self.radiance[row].astype(np.float64) * solid_angle[row])
        return total


def resize(radiance: NDArray[np.float32], width_px: int, height_px: int) -> NDArray[np.float32]:
    """Resample an equirectangular map; area means when smaller, bilinear when larger."""
    height, width, _ = radiance.shape
    if width_px <= width:
        return np.asarray(
            cv2.resize(radiance, (width_px, height_px), interpolation=cv2.INTER_AREA), np.float32
        )
    padded = cv2.copyMakeBorder(radiance, 0, 0, 1, 1, cv2.BORDER_WRAP)
    columns = ((np.arange(width_px) + 0.5) * width / width_px + 0.5).astype(np.float32)
    rows = ((np.arange(height_px) + 0.5) * height / height_px - 0.5).astype(np.float32)
    x, y = np.meshgrid(columns, rows)
    return np.asarray(
        cv2.remap(padded, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32
    )


def split_lamps(
    radiance: NDArray[np.float32], most: int = 8, least_share: float = 0.04
) -> tuple[NDArray[np.float32], tuple[Lamp, ...], tuple[Layer, ...]]:
    """Split a map into what remains and its lamps: bright regions, strongest first.

    A lamp is a connected region above 12 times the mean luminance, at most 3.5° in radius, that
    casts at least `least_share` of the light on a surface facing it. This decides what can be
    switched and what a picture marks; no measure of accuracy on panoramas uses it.
    """
    height, width, _ = radiance.shape
    solid_angle = np.repeat(geometry.equirect_solid_angles(width, height), width)
    brightness = luminance(radiance.astype(np.float64))
    mean = float(brightness.ravel() @ solid_angle) / (4 * np.pi)
    labels = wrapped_regions(brightness > 12 * mean)
    flat, flux = radiance.reshape(-1, 3), brightness.ravel() * solid_angle
    strength = np.bincount(labels.ravel(), weights=flux)
    strength[0] = 0
    base, lamps, layers = radiance.copy(), [], []
    directions = geometry.equirect_directions(width, height).reshape(-1, 3)
    for label in np.argsort(-strength)[:most]:
        inside = labels == label
        size = solid_angle[inside.ravel()].sum()
        if strength[label] < least_share * np.pi * mean:
            break
        if size > geometry.cap_solid_angle_sr(3.5):
            continue  # a window or a bright sky: no lamp
        ring = cv2.dilate(inside.astype(np.uint8), np.ones((7, 7), np.uint8)).astype(bool) & ~inside
        surround = np.median(radiance[ring], axis=0)
        index = np.flatnonzero(inside)
        values = np.maximum(flat[index] - surround, 0)
        base.reshape(-1, 3)[index] = flat[index] - values
        weight = values * solid_angle[index, None]
        direction = geometry.normalize(luminance(weight) @ directions[index])
        lamps.append(Lamp(direction, float(geometry.cap_radius_deg(size)), weight.sum(axis=0)))
        layers.append(Layer(index, values.astype(np.float32)))
    return base, tuple(lamps), tuple(layers)


def wrapped_regions(mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Label connected regions of an equirectangular mask, across the seam and over the poles."""
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    same = list(range(count))

    def root(label: int) -> int:
        while same[label] != label:
            label = same[label]
        return label

    pairs = [(labels[row, 0], labels[row, -1]) for row in range(len(mask))]
    for edge in (labels[0], labels[-1]):  # all pixels of the first row touch the pole
        touching = [int(label) for label in np.unique(edge) if label]
        pairs += [(touching[0], label) for label in touching[1:]]
    for a, b in pairs:
        if a and b:
            same[root(int(a))] = root(int(b))
    return np.asarray(np.array([root(label) for label in range(count)], dtype=np.int32)[labels])
