"""Directions on the sphere, in the probe frame (docs/users/conventions.md).

Probe frame: right-handed, +X right, +Y up, −Z forward. A direction is a unit vector of shape (…, 3)
that points *towards* what is seen. Angles at interfaces are degrees and carry ``_deg``.
"""

from __future__ import annotations

import functools
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: No pair further apart than this is called the same lamp by :func:`match_directions`.
MATCH_LIMIT_DEG = 10.0


def normalize(vectors: ArrayLike) -> Array:
    """Scale vectors (…, 3) to unit length; a zero vector raises ValueError."""
    array = np.asarray(vectors, dtype=np.float64)
    length = np.linalg.norm(array, axis=-1, keepdims=True)
    if np.any(length == 0):
        raise ValueError("geometry: normalize: a vector of length zero has no direction")
    return np.asarray(array / length)


def equirect_direction(
    column_px: ArrayLike, row_px: ArrayLike, width_px: float, height_px: float
) -> Array:
    """Directions (…, 3) seen at continuous pixel coordinates; whole numbers are pixel centres."""
    theta = np.pi * (np.asarray(row_px, dtype=np.float64) + 0.5) / height_px
    longitude = 2 * np.pi * ((np.asarray(column_px, dtype=np.float64) + 0.5) / width_px - 0.5)
    sine, up = np.sin(theta), np.cos(theta)  # of rows and columns, before there are pixels
    parts = np.broadcast_arrays(sine * np.sin(longitude), up, -sine * np.cos(longitude))
    return np.stack(parts, axis=-1)


def equirect_directions(width_px: int, height_px: int) -> Array:
    """Directions (height, width, 3) of the pixel centres of an equirectangular image."""
    return equirect_direction(
        np.arange(width_px)[None, :], np.arange(height_px)[:, None], width_px, height_px
    )


def equirect_pixel(directions: ArrayLike, width_px: int, height_px: int) -> tuple[Array, Array]:
    """(column, row) where directions (…, 3) are seen; the inverse of :func:`equirect_direction`."""
    d = np.asarray(directions, dtype=np.float64)
    theta = np.arctan2(np.hypot(d[..., 0], d[..., 2]), d[..., 1])
    longitude = np.arctan2(d[..., 0], -d[..., 2])
    return (longitude / (2 * np.pi) + 0.5) * width_px - 0.5, theta / np.pi * height_px - 0.5


def equirect_solid_angles(width_px: int, height_px: int) -> Array:
    """Solid angle in sr, exact, of one pixel of each row: shape (height,)."""
    edge = np.cos(np.pi * np.arange(height_px + 1) / height_px)
    return (edge[:-1] - edge[1:]) * (2 * np.pi / width_px)


def direction_from_angles(azimuth_deg: ArrayLike, elevation_deg: ArrayLike) -> Array:
    """Direction (…, 3): azimuth 0 is forward (−Z), positive to the right (+X); elevation is up."""
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
    flat = np.cos(elevation)
    return np.stack([flat * np.sin(azimuth), np.sin(elevation), -flat * np.cos(azimuth)], axis=-1)


def angles_from_direction(directions: ArrayLike) -> tuple[Array, Array]:
    """(azimuth_deg, elevation_deg) of directions (…, 3); see :func:`direction_from_angles`."""
    d = np.asarray(directions, dtype=np.float64)
    elevation = np.arctan2(d[..., 1], np.hypot(d[..., 0], d[..., 2]))
    return np.degrees(np.arctan2(d[..., 0], -d[..., 2])), np.degrees(elevation)


def angle_deg(a: ArrayLike, b: ArrayLike) -> Array:
    """Angle between vectors (…, 3), accurate for tiny and for straight angles alike."""
    u, v = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    sine = np.linalg.norm(cross(u, v), axis=-1)
    return np.asarray(np.degrees(np.arctan2(sine, np.sum(u * v, axis=-1))))


def cross(a: Array, b: Array) -> Array:
    """Like np.cross for vectors (…, 3), several times as fast."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def cap_solid_angle_sr(radius_deg: ArrayLike) -> Array:
    """Solid angle of a disc of the given angular radius: 2π(1 − cos r), without cancellation."""
    return np.asarray(4 * np.pi * np.sin(np.radians(radius_deg) / 2) ** 2)


def cap_radius_deg(solid_angle_sr: ArrayLike) -> Array:
    """Angular radius of the disc of that solid angle; inverse of :func:`cap_solid_angle_sr`."""
    sine = np.sqrt(np.asarray(solid_angle_sr, dtype=np.float64) / (4 * np.pi))
    return np.asarray(np.degrees(2 * np.arcsin(np.clip(sine, 0, 1))))


@functools.cache
def sphere_normals(subdivisions: int = 3) -> Array:
    """Nearly even directions (10·4^n + 2, 3) of a subdivided icosahedron; read-only."""
    golden = (1 + 5**0.5) / 2
    corners = [(s, t * golden, 0) for s in (-1, 1) for t in (-1, 1)]
    points = [
        np.array(np.roll(corner, k), dtype=np.float64) for k in range(3) for corner in corners
    ]
    vertices = list(normalize(points))
    edge = min(angle_deg(vertices[0], vertices[i]) for i in range(1, 12)) + 1e-6
    faces = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if max(angle_deg(vertices[a], vertices[b]) for a, b in ((i, j), (j, k), (k, i))) < edge
    ]
    for _ in range(subdivisions):
        middle: dict[tuple[int, int], int] = {}
        finer = []
        for i, j, k in faces:
            ij, jk, ki = (_midpoint(a, b, vertices, middle) for a, b in ((i, j), (j, k), (k, i)))
            finer += [(i, ij, ki), (ij, j, jk), (ki, jk, k), (ij, jk, ki)]
        faces = finer
    normals = np.array(vertices)
    normals.flags.writeable = False
    return normals


def fibonacci_sphere(number: int) -> Array:
    """Directions (number, 3), evenly over the sphere."""
    k = np.arange(number) + 0.5
    y, phi = 1 - 2 * k / number, np.pi * (1 + np.sqrt(5)) * k
    ring = np.sqrt(1 - y * y)
    return np.stack([ring * np.cos(phi), y, ring * np.sin(phi)], axis=-1)


def _midpoint(i: int, j: int, vertices: list[Array], known: dict[tuple[int, int], int]) -> int:
    """Index of the vertex halfway between two others; made once per edge."""
    key = (min(i, j), max(i, j))
    if key not in known:
        known[key] = len(vertices)
        vertices.append(normalize(vertices[i] + vertices[j]))
    return known[key]


# ---------------------------------------------------------------- quaternions, (w, x, y, z)

#: The quaternion that leaves everything where it is.
UNTURNED: Final = (1.0, 0.0, 0.0, 0.0)


def quaternion(axis: ArrayLike, angle_deg: float) -> Array:
    """Unit quaternion that turns by `angle_deg` about `axis` (right-handed)."""
    half = np.radians(angle_deg) / 2
    return np.concatenate([[np.cos(half)], np.sin(half) * normalize(axis)])


def turn_after(outer_wxyz: ArrayLike, inner_wxyz: ArrayLike) -> Array:
    """Hamilton's product of quaternions (…, 4): first turn by `inner`, then by `outer`."""
    a, b = np.asarray(outer_wxyz, dtype=np.float64), np.asarray(inner_wxyz, dtype=np.float64)
    w, x, y, z = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    s, t, u, v = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    product = (
        w * s - x * t - y * u - z * v,
        w * t + x * s + y * v - z * u,
        w * u - x * v + y * s + z * t,
        w * v + x * u - y * t + z * s,
    )
    return np.stack(product, axis=-1)


def inverse(quaternion_wxyz: ArrayLike) -> Array:
    """Turn back: the conjugates of unit quaternions (…, 4)."""
    q = np.asarray(quaternion_wxyz, dtype=np.float64)
    if q.shape[-1:] != (4,):
        raise ValueError(f"geometry: {quaternion_wxyz!r} is no rotation: expected (w, x, y, z)")
    return q * [1, -1, -1, -1]


def rotation_matrix(quaternion_wxyz: ArrayLike) -> Array:
    """Matrices R (…, 3, 3) of quaternions (…, 4), any length but zero: turned = R @ vector."""
    q = np.asarray(quaternion_wxyz, dtype=np.float64)
    if q.shape[-1:] != (4,) or not np.all(np.isfinite(q)) or not np.all(np.any(q, axis=-1)):
        raise ValueError(
            f"geometry: {quaternion_wxyz!r} is no rotation: expected (w, x, y, z), not all zero"
        )
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip
    return np.stack(rows, axis=-1).reshape(*q.shape[:-1], 3, 3)


def rotate(quaternion_wxyz: ArrayLike, vectors: ArrayLike) -> Array:
    """Turn vectors (…, 3) by a quaternion."""
    return np.asarray(vectors, dtype=np.float64) @ rotation_matrix(quaternion_wxyz).T


# ---------------------------------------------------------------- who is who


def match_directions(
    true: ArrayLike, estimated: ArrayLike, limit_deg: float = MATCH_LIMIT_DEG
) -> list[tuple[int, int, float]]:
    """Match two sets of directions one to one by the least total angle.

    Returns (index in `true`, index in `estimated`, angle in degrees) per pair. A pair further
    apart than `limit_deg` is none: its two members stay alone (missed, and false). Exact, by
    dynamic programming over the subsets of `estimated` (at most 16).
    """
    t = np.asarray(true, dtype=np.float64).reshape(-1, 3)
    e = np.asarray(estimated, dtype=np.float64).reshape(-1, 3)
    if len(e) > 16:
        raise ValueError(f"geometry: match: {len(e)} estimated directions; at most 16")
    angles = angle_deg(t[:, None], e[None, :]).reshape(len(t), len(e))

    @functools.cache
    def best(i: int, taken: int) -> tuple[float, tuple[tuple[int, int], ...]]:
        if i == len(t):
            return 0.0, ()
        cost, pairs = best(i + 1, taken)
        choice = (cost + limit_deg, pairs)
        for j in range(len(e)):
            if not taken >> j & 1 and angles[i, j] <= limit_deg:
                cost, pairs = best(i + 1, taken | 1 << j)
                choice = min(choice, (cost + float(angles[i, j]), ((i, j), *pairs)))
        return choice

    return [(i, j, float(angles[i, j])) for i, j in best(0, 0)[1]]


def disc_points(direction: ArrayLike, radius_deg: float, number: int) -> Array:
    """Unit vectors (number, 3) that share a disc's solid angle evenly (a sunflower's spiral)."""
    k = np.arange(number)
    cosine = 1 - (k + 0.5) / number * 2 * np.sin(np.radians(radius_deg) / 2) ** 2
    turn = k * np.pi * (3 - 5**0.5)
    d = normalize(direction)
    side = normalize(np.cross(d, [1.0, 0, 0] if abs(d[0]) < 0.7 else [0, 1.0, 0]))
    around = np.outer(np.cos(turn), side) + np.outer(np.sin(turn), np.cross(d, side))
    return np.asarray(cosine[:, None] * d + np.sqrt(1 - cosine**2)[:, None] * around)
