"""Local sampling: what an AR camera sees around a virtual object's foot, for reflections downwards.

A reflection map is of what the probe sees, as if all of it were far away. The table that a virtual
object stands on is near: its reflection is where the ray meets the table. An AR app has a picture
of the table; this is the reference for how to use it. The picture stays in the app.

Positions are in metres in a frame whose axes are those of the estimate (+X right, +Y up, −Z
forward), with any origin. Pictures are linear (colour.srgb_table()) and without lens distortion.
Plane to picture is a homography: Hartley and Zisserman, "Multiple View Geometry", 2004, 8.1.1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe.errors import LightprobeError
from lightprobe.estimate import Estimate
from lightprobe.geometry import Array
from lightprobe.reflection_map import ReflectionMap

#: Points per texel along each edge are as many as pixels, up to this.
_MOST_POINTS = 8
#: At the border of the square, this share of its half, light fades to the reflection map.
_FADE = 0.2
_UP = np.array([0.0, 1.0, 0.0])


class LocalError(LightprobeError):
    """A picture that does not show the ground, or light that cannot be compared."""


@dataclass(frozen=True, eq=False)
class ArCamera:
    """A pinhole camera: pixels (x right, y down; centres at +0.5) and its pose.

    `matrix` (3, 3): focal lengths and centre, as OpenCV's camera matrix; `rotation` (3, 3) and
    `place_m` (3,): from the camera's frame (x right, y down, z forward) to the world's.
    """

    matrix: Array
    rotation: Array
    place_m: Array

    def look(self, points_m: ArrayLike) -> Array:
        """Pixels (…, 2) of points (…, 3) of the world; NaN behind the camera."""
        seen = (np.asarray(points_m, float) - self.place_m) @ self.rotation
        depth = seen[..., 2]
        pixels = seen @ np.asarray(self.matrix, float).T
        return np.asarray(pixels[..., :2] / np.where(depth > 0, depth, np.nan)[..., None])


@dataclass(frozen=True, eq=False)
class Ground:
    """A level square of the world, as the AR camera saw it."""

    centre_m: Array  # (3,)
    side_m: float
    radiance: NDArray[np.float64]  # (size, size, 3): rows from −Z to +Z, columns from −X to +X
    seen: NDArray[np.bool_]  # (size, size): in the picture

    def scaled(self, factor: ArrayLike) -> Ground:
        """Give the same with its radiance times a factor, or one (3,) for R, G and B."""
        return replace(self, radiance=self.radiance * np.asarray(factor, float))

    def mean(self) -> Array:
        """Mean radiance (3,) of what was seen."""
        return np.asarray(self.radiance[self.seen].mean(axis=0))


def sample(
    picture: ArrayLike, camera: ArCamera, centre_m: ArrayLike, side_m: float, size: int = 64
) -> Ground:
    """Straight view of a level square by a linear picture (H, W, 3); in the picture's units.

    Each texel is the mean over its area. Raises LocalError when nothing of it is in the picture.
    """
    pixels = np.asarray(picture, float)
    centre = np.asarray(centre_m, float)
    points = _points_per_texel(camera, centre, side_m, size)
    light, inside = _bilinear(pixels, camera.look(_places(centre, side_m, size * points)))
    inside &= camera.place_m[1] > centre[1]  # else it is seen from below
    light[~inside] = 0
    blocks = (size, points, size, points)
    seen = np.asarray(inside.reshape(blocks).all(axis=(1, 3)))
    if not seen.any():
        raise LocalError(
            f"local: ground: nothing of the {side_m:g} m square around {centre.tolist()} is in the "
            "picture: point the camera at the object's foot, from above, or take a larger square"
        )
    return Ground(centre, side_m, light.reshape(*blocks, 3).mean(axis=(1, 3)), seen)


def by_albedo(ground: Ground, estimate: Estimate, albedo: float = 0.5) -> Ground:
    """In the estimate's units, if the ground reflects this share of the light on it, diffusely.

    The ground keeps its colour. What lies in shadow, or an albedo that is wrong, is an error of as
    much; with a reflection map :func:`by_reflection_map` needs no guess.
    """
    light = float(np.mean(estimate.irradiance(_UP)))
    return _brought_to(ground, albedo * light / np.pi)


def by_reflection_map(ground: Ground, around: ReflectionMap, probe_m: ArrayLike) -> Ground:
    """In the map's units, as the probe at `probe_m` sees the same ground (brightness, not colour).

    The map's orientation is taken for that of the world. Raises LocalError when the probe is below
    the ground.
    """
    places = _places(ground.centre_m, ground.side_m, ground.radiance.shape[0])
    towards = places - np.asarray(probe_m, float)
    if not (towards[..., 1] < 0).all():
        raise LocalError("local: reflection map: the probe is not above the ground: check heights")
    # each texel counts by the solid angle that the probe sees it under
    weight = -towards[..., 1] / np.linalg.norm(towards, axis=-1) ** 3 * ground.seen
    light = around.sample(towards).mean(axis=-1)
    mean = (ground.radiance.mean(axis=-1) * weight).sum() / weight.sum()
    return _brought_to(ground, float((light * weight).sum() / weight.sum()), mean)


def _brought_to(ground: Ground, target: float, mean: float | None = None) -> Ground:
    mean = float(ground.mean().mean()) if mean is None else mean
    if not mean > 0:
        raise LocalError(
            "local: ground: it is black in the picture: expose longer, so that it can be scaled"
        )
    return ground.scaled(target / mean)


def radiance(
    ground: Ground, around: ReflectionMap, points_m: ArrayLike, towards: ArrayLike
) -> Array:
    """Radiance (…, 3) that comes to points (…, 3) from directions `towards` (…, 3), unit.

    Rays that meet the ground within its square take its light there, others the reflection map's;
    in between, and around what the camera did not see, one fades into the other.
    """
    points, rays = np.broadcast_arrays(np.asarray(points_m, float), np.asarray(towards, float))
    far = around.sample(rays).astype(float)
    height = points[..., 1] - ground.centre_m[1]
    down = rays[..., 1] < 0
    along = np.where(down, height / np.where(down, -rays[..., 1], 1.0), 0.0)
    met = points + along[..., None] * rays - ground.centre_m
    place = np.stack([met[..., 0], met[..., 2]], axis=-1) / (0.5 * ground.side_m)  # −1…1
    border = np.abs(place).max(axis=-1)
    size = ground.radiance.shape[0]
    texel = (place + 1) / 2 * size
    light, inside = _bilinear(ground.radiance * ground.seen[..., None], texel)
    seen, _ = _bilinear(np.asarray(ground.seen, float)[..., None], texel)
    known = seen[..., 0]
    near = np.clip((1 - border) / _FADE, 0, 1) * known
    share = np.where(down & inside & (height >= 0), near, 0.0)[..., None]
    light = light / np.where(known > 0, known, 1.0)[..., None]
    return np.asarray(share * light + (1 - share) * far)


def _points_per_texel(camera: ArCamera, centre: Array, side_m: float, size: int) -> int:
    """As many as pixels along the longest texel of the square's corners and its middle."""
    half, texel = side_m / 2, side_m / size
    corners = np.array([[0, 0], [-1, -1], [-1, 1], [1, -1], [1, 1]]) * half
    level = np.insert(corners, 1, 0.0, axis=1) + centre
    here = camera.look(level)
    steps = [camera.look(level + step) for step in ([texel, 0, 0], [0, 0, texel])]
    lengths = np.array([np.linalg.norm(there - here, axis=-1) for there in steps])
    longest = float(np.nanmax(lengths)) if np.isfinite(lengths).any() else 1.0
    return int(np.clip(np.ceil(longest), 1, _MOST_POINTS))


def _places(centre: Array, side_m: float, count: int) -> Array:
    """Middles (count, count, 3) of the cells of a level square."""
    place = ((np.arange(count) + 0.5) / count - 0.5) * side_m
    x, z = np.meshgrid(place, place)
    return np.asarray(centre + np.stack([x, np.zeros_like(x), z], axis=-1))


def _bilinear(values: Array, at: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Values (…, C) of a picture (H, W, C) at (…, 2), x and y, and whether that is within it."""
    height, width = values.shape[:2]
    with np.errstate(invalid="ignore"):
        inside = np.asarray(((at >= 0) & (at <= [width, height])).all(axis=-1))
    centred = np.where(inside[..., None], at, 0.5) - 0.5
    centred = np.clip(centred, 0, [width - 1, height - 1])
    low = np.minimum(centred.astype(int), [max(width - 2, 0), max(height - 2, 0)])
    x, y = low[..., 0], low[..., 1]
    right, below = np.minimum(x + 1, width - 1), np.minimum(y + 1, height - 1)
    u, v = (centred - low)[..., 0, None], (centred - low)[..., 1, None]
    top = (1 - u) * values[y, x] + u * values[y, right]
    bottom = (1 - u) * values[below, x] + u * values[below, right]
    return np.asarray((1 - v) * top + v * bottom), inside
