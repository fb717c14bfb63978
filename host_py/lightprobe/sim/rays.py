"""Equirectangular maps as pictures: rolled by columns, smeared along rows, looked up by rays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry
from lightprobe.geometry import Array
from lightprobe.imaging.camera import Camera
from lightprobe.sim.motion import is_level, level_yaw_deg

Pixel = TypeVar("Pixel", np.float32, np.int16)
#: Pixels that are less wider at the horizon are left as they are.
_AS_WIDE = 1.02
#: Rows of a picture that are computed at a time.
_ROWS = 16


def rolled(picture: NDArray[Pixel], shift_px: NDArray[np.int64]) -> NDArray[Pixel]:
    """Roll rows to the right, each by its own number of columns, or all by one (1,)."""
    if len(shift_px) == 1:
        return np.roll(picture, shift_px[0], axis=1)
    rolled = np.empty_like(picture)
    first = np.concatenate([[0], np.flatnonzero(np.diff(shift_px)) + 1, [len(shift_px)]])
    for start, end in pairwise(first):  # neighbours mostly move alike
        rolled[start:end] = np.roll(picture[start:end], shift_px[start], axis=1)
    return rolled


def smeared(radiance: NDArray[np.float32], smear_px: int) -> NDArray[np.float32]:
    """Mean over `smear_px` columns, an odd number, of an equirectangular map."""
    if smear_px == 1:
        return radiance
    side = smear_px // 2
    padded = cv2.copyMakeBorder(radiance, 0, 0, side, side, cv2.BORDER_WRAP)
    mean = cv2.blur(padded, (smear_px, 1))
    return np.asarray(mean[:, side : side + radiance.shape[1]], dtype=np.float32)


def padded(radiance: NDArray[np.float32]) -> NDArray[np.float32]:
    """Give a map with a column more on each side, as :meth:`Places.sample` takes it."""
    return np.asarray(cv2.copyMakeBorder(radiance, 0, 0, 1, 1, cv2.BORDER_WRAP), np.float32)


def evened(radiance: NDArray[np.float32]) -> NDArray[np.float32]:
    """Give a map (H, W, 3) whose pixels are as wide everywhere as at its horizon.

    Pixels near the poles are narrow. A camera of the same size that is tilted would step over some
    of them, and miss a small lamp, or see it twice. So each is the mean of what is as wide.
    """
    height, width, _ = radiance.shape
    found = radiance.copy()
    for row in range(height):
        wide = min(1 / np.sin(np.pi * (row + 0.5) / height), width - 2)
        if wide < _AS_WIDE:
            continue
        side = math.ceil(wide / 2 + 0.5)
        columns = np.arange(-side, width + side) % width
        below = np.cumsum(radiance[row, columns], axis=0, dtype=np.float64)
        below = np.concatenate([np.zeros((1, 3)), below])  # of the columns left of each edge
        first = side + 0.5 - wide / 2  # edge at the left of column 0's mean
        whole, part = divmod(first, 1)
        left = _between(below, int(whole), part, width)
        whole, part = divmod(first + wide, 1)
        found[row] = (_between(below, int(whole), part, width) - left) / wide
    return found


def _between(sums: Array, first: int, part: float, count: int) -> Array:
    return (1 - part) * sums[first : first + count] + part * sums[first + 1 : first + count + 1]


class Rays:
    """Resamples an equirectangular map to what lenses see."""

    def __init__(
        self,
        lens: Camera,
        size_px: tuple[int, int],
        map_px: tuple[int, int],
        lookups_px: Sequence[float] = (0.0,),
    ) -> None:
        """Sizes are (width, height); `lookups_px`: see :attr:`Places.lookups_px`."""
        self._lookups_px = tuple(lookups_px)
        directions, illumination = lens.look(*size_px)
        # Beside a circle in a wide picture nothing is seen: these columns are left out.
        within = np.flatnonzero((illumination > 0).any(axis=0))
        first, last = (within[0], within[-1]) if len(within) else (0, size_px[0] - 1)
        self._beside_px = (int(first), int(size_px[0] - 1 - last))
        directions, illumination = (one[:, first : last + 1] for one in (directions, illumination))
        seen = illumination > 0
        directions = np.where(seen[..., None], directions, [0.0, 0, -1])
        # (H, 3, W): so each row has its own rotation in one product.
        self._directions = np.ascontiguousarray(np.moveaxis(directions, -1, 1), np.float32)
        self._map_px = map_px
        self._illumination: NDArray[np.float32] | None = None
        if not np.all(illumination * seen == 1):
            shares = (illumination * seen).astype(np.float32)
            self._illumination = np.repeat(shares[..., None], 3, -1)
        self._level = replace(self._places(np.eye(3, dtype=np.float32)[None]), tilt=None)

    def turned(self, rotations: Array) -> Places:
        """Where the rays end in the map; `rotations`, camera to map: of each of H rows, or (1, 4).

        What turns about the vertical alone shifts columns, and is exact however far it turns.
        """
        if is_level(rotations):
            return replace(self._level, yaw_deg=level_yaw_deg(rotations))
        return self._places(geometry.rotation_matrix(rotations).astype(np.float32))

    def _places(self, matrices: NDArray[np.float32]) -> Places:
        """As :func:`lightprobe.geometry.equirect_pixel` has it, in single precision.

        `matrices`: (1, 3, 3), or (H, 3, 3) of each row.
        """
        height, _, width = self._directions.shape
        column, row = np.empty((2, height, width), np.float32)
        width_px, height_px = self._map_px
        for top in range(0, height, _ROWS):  # what is at work stays in the cache
            rows = slice(top, top + _ROWS)
            turn = matrices if len(matrices) == 1 else matrices[rows]
            x, up, back = np.moveaxis(turn @ self._directions[rows], 1, 0)
            np.arctan2(x, -back, out=column[rows])
            np.arctan2(np.sqrt(x * x + back * back), up, out=row[rows])
            column[rows] *= np.float32(width_px / (2 * np.pi))
            column[rows] += np.float32((width_px - 1) / 2)
            row[rows] *= np.float32(height_px / np.pi)
            row[rows] -= np.float32(0.5)
        tilt = (matrices, self._directions)
        return Places(
            column, row, self._illumination, width_px, self._lookups_px, self._beside_px, tilt=tilt
        )


@dataclass(frozen=True, eq=False)
class Places:
    """Where rays end in an equirectangular map."""

    column: NDArray[np.float32]  # (H, W), of the columns that see anything
    row: NDArray[np.float32]
    illumination: NDArray[np.float32] | None  # (H, W, 3); None: 1
    width_px: int  # of the map
    lookups_px: tuple[float, ...]  # what is seen is the mean of so far beside, along both axes
    beside_px: tuple[int, int] = (0, 0)  # columns of the picture at the left and right of those
    yaw_deg: Array = field(default_factory=lambda: np.zeros(1))  # besides: of the H rows, or (1,)
    # Matrices (H or 1, 3, 3) camera to map, and the camera's rays (H, 3, W); None: up is up.
    tilt: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None

    def sample(self, radiance: NDArray[np.float32]) -> NDArray[np.float32]:
        """Radiance (H, W, 3) behind the lenses, roll-off included, of a map that is `padded`."""
        return self._whole(self._sample(radiance))

    def _whole(self, seen: NDArray[np.float32]) -> NDArray[np.float32]:
        """Add the columns that see nothing."""
        if self.beside_px == (0, 0):
            return seen
        return np.pad(seen, ((0, 0), self.beside_px, (0, 0)))

    def _sample(self, radiance: NDArray[np.float32]) -> NDArray[np.float32]:
        seen = self._look_up(radiance, self.lookups_px[0])
        for beside_px in self.lookups_px[1:]:
            cv2.accumulate(self._look_up(radiance, beside_px), seen)
        if len(self.lookups_px) > 1:
            seen /= np.float32(len(self.lookups_px))
        if self.illumination is not None:
            np.multiply(seen, self.illumination, out=seen)
        return seen

    def _look_up(self, radiance: NDArray[np.float32], beside_px: float) -> NDArray[np.float32]:
        shift = (self.yaw_deg[:, None] / 360 * self.width_px) % self.width_px - 1  # -1: padded
        column = self.column - (shift - beside_px).astype(np.float32)
        np.add(column, np.float32(self.width_px), out=column, where=column < 1)
        row = self.row + np.float32(beside_px) if beside_px else self.row
        seen = cv2.remap(radiance, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(seen, dtype=np.float32)

    def sample_polarized(self, parts: NDArray[np.float32]) -> NDArray[np.float32]:
        """S1 and S2 (2, H, W, 3) in the frames of the camera's pixels, of maps of both.

        The frames are as of :class:`lightprobe.sim.scene.Layers`: x = d × up. Of a camera that is
        tilted another up counts than of the map.
        """
        s1, s2 = (self._sample(part) for part in parts)
        if self.tilt is None:
            return np.stack([self._whole(s1), self._whole(s2)])
        matrices, directions = self.tilt
        x, y, z = np.moveaxis(matrices @ directions, 1, 0)
        up = matrices[..., 1].T[..., None]  # the camera's, in the map
        # x of the camera's pixel along x and y of the map's, times the sines of d's angles to ups.
        along = up[1] - (x * up[0] + y * up[1] + z * up[2]) * y
        across = z * up[0] - x * up[2]
        over = 1 / np.maximum(along * along + across * across, np.float32(1e-12))
        cosine = ((along * along - across * across) * over)[..., None]
        sine = (2 * along * across * over)[..., None]
        turned = (s1 * cosine + s2 * sine, s2 * cosine - s1 * sine)
        return np.stack([self._whole(part) for part in turned])
