"""Equirectangular maps as pictures: rolled by columns, smeared along rows, looked up by rays."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.geometry import Array
from lightprobe.imaging.camera import Camera

Pixel = TypeVar("Pixel", np.float32, np.int16)


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


class Rays:
    """Resamples an equirectangular map to what lenses see."""

    def __init__(self, lens: Camera, size_px: tuple[int, int], map_px: tuple[int, int]) -> None:
        """Sizes are (width, height)."""
        directions, illumination = lens.look(*size_px)
        seen = illumination > 0
        directions = np.where(seen[..., None], directions, [0.0, 0, -1])
        self._directions = np.moveaxis(directions, -1, 0).astype(np.float32)  # (3, H, W)
        self._map_px = map_px
        self._illumination = np.repeat((illumination * seen).astype(np.float32)[..., None], 3, -1)
        self._level = self._places(self._directions)

    def _places(self, directions: NDArray[np.float32]) -> Places:
        """As :func:`lightprobe.geometry.equirect_pixel` has it, in single precision."""
        (x, up, back), (width_px, height_px) = directions, self._map_px
        longitude, theta = np.arctan2(x, -back), np.arctan2(np.hypot(x, back), up)
        column = longitude * np.float32(width_px / (2 * np.pi)) + np.float32((width_px - 1) / 2)
        row = theta * np.float32(height_px / np.pi) - np.float32(0.5)
        return Places(column, row, self._illumination, width_px)

    def turned(self, nod_deg: Array) -> Places:
        """Where the rays end while the camera looks up; `nod_deg`: of each of H rows, or (1,)."""
        if not nod_deg.any():
            return self._level
        x, y, z = self._directions
        nod = np.radians(nod_deg)[:, None]
        cosine, sine = np.cos(nod).astype(np.float32), np.sin(nod).astype(np.float32)
        return self._places(np.stack([x, y * cosine - z * sine, y * sine + z * cosine]))


@dataclass(frozen=True, eq=False)
class Places:
    """Where rays (H, W) end in an equirectangular map."""

    column: NDArray[np.float32]
    row: NDArray[np.float32]
    illumination: NDArray[np.float32]  # (H, W, 3)
    width_px: int  # of the map

    def sample(self, radiance: NDArray[np.float32], yaw_deg: Array) -> NDArray[np.float32]:
        """Radiance (H, W, 3) behind the lenses, roll-off included, of a map turned to the right.

        `yaw_deg`: of each of the H rows, or (1,) of all.
        """
        padded = cv2.copyMakeBorder(radiance, 0, 0, 1, 1, cv2.BORDER_WRAP)
        shift = (yaw_deg[:, None] / 360 * self.width_px) % self.width_px - 1  # -1: padded
        column = self.column - shift.astype(np.float32)
        np.add(column, np.float32(self.width_px), out=column, where=column < 1)
        seen = cv2.remap(
            padded, column, self.row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(np.multiply(seen, self.illumination, out=seen), dtype=np.float32)
