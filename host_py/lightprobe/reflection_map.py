"""Reflection maps: radiance on the six faces of a cube, as a probe sends it on request.

Faces come as +X −X +Y −Y +Z −Z, in OpenGL's and WebXR's orientation (docs/users/conventions.md),
in the probe frame: +X right, +Y up, −Z forward.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe import geometry
from lightprobe import room as box
from lightprobe.estimate import Frame, Kind, Room
from lightprobe.geometry import Array

#: Texels along an edge that a probe may offer.
SIZES = (16, 32, 64)

#: Of each face: its axis, and where columns and rows lead. OpenGL 4.6, table 8.19.
AXES = np.array([
    [[1, 0, 0], [0, 0, -1], [0, -1, 0]], [[-1, 0, 0], [0, 0, 1], [0, -1, 0]],
    [[0, 1, 0], [1, 0, 0], [0, 0, 1]], [[0, -1, 0], [1, 0, 0], [0, 0, -1]],
    [[0, 0, 1], [1, 0, 0], [0, -1, 0]], [[0, 0, -1], [-1, 0, 0], [0, -1, 0]],
], dtype=np.float64)  # fmt: skip


@dataclass(frozen=True, eq=False)
class ReflectionMap:
    """What shiny surfaces around the probe mirror."""

    sequence: int  # of the estimate that is the same light
    boot_id: int
    capture_time_unix_ns: int
    subscription: int  # number of the subscription that it answers
    kind: Kind  # AMBIENT: without the lights that the estimate lists; TOTAL: with them
    radiance: NDArray[np.float32]  # (6, size, size, 3): face, row, column, RGB; units of the SH
    orientation: Array | None = None  # (4,) x, y, z, w: as Estimate.orientation
    drawn: dict[str, float] | None = None  # error to expect of glossy and mirrors, 1 sigma

    @property
    def size(self) -> int:
        """Texels along an edge."""
        return int(self.radiance.shape[1])

    def irradiance(self, normals: ArrayLike) -> Array:
        """Irradiance (…, 3) on surfaces with the given normals (…, 3)."""
        n = np.asarray(normals, dtype=np.float64)
        cosines = np.maximum(n @ directions(self.size).reshape(-1, 3).T, 0)
        flux = self.radiance.astype(np.float64) * solid_angles(self.size)[..., None]
        return np.asarray(cosines @ flux.reshape(-1, 3))

    def sample(self, towards: ArrayLike) -> NDArray[np.float32]:
        """Radiance (…, 3) of the texels along the given directions (…, 3), of any length > 0."""
        face, row, column = texels(towards, self.size)
        return np.asarray(self.radiance[face, row, column])

    def at(self, room: Room, position_m: ArrayLike, frame: Frame) -> ReflectionMap:
        """Give what shiny surfaces at `position_m` mirror: the map as it would be seen from there.

        `room` and `frame` are those of an estimate, best of the one with the same `sequence`;
        `position_m` (3,) is in metres from the probe, in the axes of that frame. The new map is in
        the probe's axes, as this one is. Lamps in a map of TOTAL move as if they were on the walls:
        take one of AMBIENT, and the lamps of `estimate.at(position_m)`. Raises ValueError where the
        frame is WORLD and the map does not know its orientation.
        """
        offset_m = np.asarray(position_m, dtype=np.float64)
        if offset_m.shape != (3,) or not np.isfinite(offset_m).all():
            raise ValueError(f"reflection map: at {position_m!r}: expected x, y, z in metres")
        if not offset_m.any():
            return self
        turn = self._turn(frame)
        towards = directions(self.size).reshape(-1, 3) @ turn.T
        found = _between(self.radiance, box.seen(room, offset_m, towards) @ turn)
        return replace(self, radiance=found.reshape(self.radiance.shape).astype(np.float32))

    def _turn(self, frame: Frame) -> Array:
        """Give the matrix that turns the probe's axes into a frame."""
        if frame == "PROBE":
            return np.eye(3)
        if self.orientation is None:
            raise ValueError("reflection map: at: its orientation in the WORLD is not known")
        x, y, z, w = self.orientation
        return geometry.rotation_matrix((w, x, y, z))

    def environment_map(self, width_px: int) -> NDArray[np.float32]:
        """Equirectangular radiance (width / 2, width, 3); the centre is forward (−Z)."""
        return self.sample(geometry.equirect_directions(width_px, width_px // 2))


def _places(size: int) -> Array:
    """Centres of the texels along an edge, −1…1."""
    return (2 * np.arange(size) + 1) / size - 1


def directions(size: int) -> Array:
    """Unit vectors (6, size, size, 3) through the centres of the texels."""
    t, s = np.meshgrid(_places(size), _places(size), indexing="ij")
    main, across, down = (AXES[:, None, None, k] for k in range(3))
    return geometry.normalize(main + s[..., None] * across + t[..., None] * down)


def solid_angles(size: int) -> Array:
    """Solid angles (6, size, size) of the texels, exact; they sum to 4π."""
    edges = 2 * np.arange(size + 1) / size - 1
    s, t = np.meshgrid(edges, edges)
    corner = np.arctan2(s * t, np.sqrt(s * s + t * t + 1))
    face = np.diff(np.diff(corner, axis=0), axis=1)
    return np.broadcast_to(face, (6, size, size))


def texels(towards: ArrayLike, size: int) -> tuple[NDArray[np.intp], ...]:
    """Face, row and column (…) of the texels along directions (…, 3)."""
    face, place = _on_faces(np.asarray(towards, dtype=np.float64))
    index = np.clip(np.floor((place + 1) / 2 * size), 0, size - 1).astype(np.intp)
    return face, index[..., 1], index[..., 0]


def _on_faces(d: Array) -> tuple[NDArray[np.intp], Array]:
    """Give the face (…) that directions (…, 3) meet, and where: (…, 2), column and row, −1…1."""
    axis = np.argmax(np.abs(d), axis=-1)
    main = np.take_along_axis(d, axis[..., None], axis=-1)[..., 0]
    face = 2 * axis + (main < 0)
    return face, np.einsum("...ij,...j->...i", AXES[face, 1:], d) / np.abs(main)[..., None]


@cache
def _rim(size: int) -> tuple[NDArray[np.intp], ...]:
    """Give the texels next to each face, beyond its first row, last row, first and last column.

    Face, row and column, each (6, 4, size).
    """
    along, out = _places(size), np.full(size, 1 + 1 / size)
    place = np.stack([[along, -out], [along, out], [-out, along], [out, along]])
    main, across, down = (AXES[:, None, None, k] for k in range(3))
    return texels(main + place[:, 0, :, None] * across + place[:, 1, :, None] * down, size)


def _between(radiance: NDArray[np.float32], towards: Array) -> Array:
    """Give radiance (n, 3) along directions (n, 3), linear between texels, also across edges.

    Beyond a face lie the texels next to it on other faces. At a corner of the cube, where only
    three texels meet, their mean is the fourth.
    """
    size = radiance.shape[1]
    wide = np.empty((6, size + 2, size + 2, 3))
    wide[:, 1:-1, 1:-1] = radiance
    rim = radiance[_rim(size)]
    wide[:, 0, 1:-1], wide[:, -1, 1:-1], wide[:, 1:-1, 0], wide[:, 1:-1, -1] = (
        rim[:, k] for k in range(4)
    )
    for row, inner_row in ((0, 1), (-1, -2)):
        for column, inner in ((0, 1), (-1, -2)):
            near = wide[:, inner_row, inner] + wide[:, row, inner] + wide[:, inner_row, column]
            wide[:, row, column] = near / 3
    face, place = _on_faces(towards)
    at = (place + 1) / 2 * size + 0.5  # of the wide faces; 0.5…size + 0.5
    first = np.clip(np.floor(at), 0, size).astype(np.intp)
    (s, t), (column, row) = np.moveaxis(at - first, -1, 0)[..., None], np.moveaxis(first, -1, 0)
    above = (1 - s) * wide[face, row, column] + s * wide[face, row, column + 1]
    below = (1 - s) * wide[face, row + 1, column] + s * wide[face, row + 1, column + 1]
    return np.asarray((1 - t) * above + t * below)


def decode_rgb9e5(texels: bytes, scale: float) -> NDArray[np.float32]:
    """Radiance (number, 3) of RGB9E5 texels, little-endian (OpenGL 4.6, 8.5.2), times `scale`."""
    bits = np.frombuffer(texels, dtype="<u4")
    mantissas = np.stack([bits & 511, bits >> 9 & 511, bits >> 18 & 511], axis=-1)
    exponents = (bits >> 27).astype(np.int32) - 24
    values = np.ldexp(mantissas.astype(np.float64), exponents[:, None]) * scale
    return values.astype(np.float32)


def encode_rgb9e5(radiance: ArrayLike) -> tuple[bytes, float]:
    """Texels (number, 3) as RGB9E5, little-endian, and the scale that :func:`decode_rgb9e5` needs.

    Negative values become 0. The brightest has the largest exponent.
    """
    values = np.maximum(np.asarray(radiance, dtype=np.float64), 0)
    largest = values.max(axis=-1)
    brightest = float(largest.max(initial=0)) or 1.0
    scale = float(np.exp2(np.ceil(np.log2(brightest / 511)) - 7))  # mantissas of 2^(31 - 24)
    with np.errstate(divide="ignore"):
        exponents = np.ceil(np.log2(largest / scale / 511.5))
    exponents = np.clip(exponents, -24, 7)
    mantissas = np.minimum(np.rint(values / scale / np.exp2(exponents)[:, None]), 511)
    bits = mantissas.astype(np.uint32) << np.array([0, 9, 18], np.uint32)
    bits = np.bitwise_or.reduce(bits, axis=-1) | (exponents + 24).astype(np.uint32) << 27
    return bits.astype("<u4").tobytes(), scale
