"""The polarizer wheel in front of the lens: Malus' law on the Stokes parameters of every pixel.

One flat sheet in front of each lens, across its axis; an equirectangular camera has one sheet
across the forward axis for both halves. The sheet's transmission axis is p = cos θ · X + sin θ · Y
of the lens: θ = 0 along +X, counter-clockwise as seen from inside looking out. Off the lens' axis
the light of direction d that passes is polarized along e ∝ d × (n × p), n the sheet's normal: e
is p seen along d. With ψ the angle of e in the pixel's own frame and r the extinction ratio:

    I = ½ · transmission · (S0 + (r − 1)/(r + 1) · (S1 cos 2ψ + S2 sin 2ψ))

(the first row of a linear diattenuator's Mueller matrix: Goldstein, Polarized Light, ch. 5). Of
unpolarized light it passes ½ · transmission at every angle. Left out: Fresnel losses at the sheet
and its falling extinction at grazing angles; real sheets serve to about 75° off the axis.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.geometry import Array, rotation_matrix
from lightprobe.imaging.camera import Camera
from lightprobe.imaging.film import Sheet

#: Rows of a picture that are computed at a time.
_ROWS = 16


class Polarizer:
    """A sheet in front of a camera's lenses, for one picture size."""

    def __init__(self, sheet: Sheet, lens: Camera, size_px: tuple[int, int]) -> None:
        """`size_px` (width, height)."""
        self.sheet = sheet
        # e is linear in p: e(θ) = cos θ · e(X) + sin θ · e(Y), each in the pixels' own frames.
        self._zero, self._quarter = _projected_axes(lens, size_px)

    def axis(
        self, wheel_deg: float, rows: slice = slice(None)
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """cos 2ψ and sin 2ψ (H, W) of the light that passes in each pixel (of some rows)."""
        axis_rad = np.radians(wheel_deg + self.sheet.offset_deg)
        cosine, sine = (np.float32(f(axis_rad)) for f in (np.cos, np.sin))
        x = cosine * self._zero[0][rows] + sine * self._quarter[0][rows]
        y = cosine * self._zero[1][rows] + sine * self._quarter[1][rows]
        xx, yy = x * x, y * y
        over = 1 / np.maximum(xx + yy, np.float32(1e-12))
        return (xx - yy) * over, 2 * x * y * over

    def through(
        self,
        radiance: NDArray[np.float32],
        polarized: NDArray[np.float32] | None,
        wheel_deg: Sequence[float],
    ) -> NDArray[np.float32]:
        """Radiance (H, W, 3) behind the sheet, the mean over the wheel's angles.

        `radiance` S0 (H, W, 3), `polarized` S1, S2 (2, H, W, 3) or None for none.
        """
        gain = np.float32(self.sheet.unpolarized_gain)
        if polarized is None:
            return gain * radiance
        seen = np.empty_like(radiance)
        for top in range(0, len(radiance), _ROWS):  # what is at work stays in the cache
            rows = slice(top, top + _ROWS)
            self._mix(radiance[rows], polarized[:, rows], wheel_deg, rows, seen[rows])
        return seen

    def through_stack(
        self,
        radiance: NDArray[np.float32],
        polarized: NDArray[np.float32] | None,
        stack_deg: Sequence[float],
    ) -> NDArray[np.float32]:
        """Radiance (H, W, 3) behind several such sheets, the outermost first.

        The first row of the product of their Mueller matrices, pixel by pixel: what one sheet
        leaves is polarized, and meets the next one.
        """
        row = np.zeros((3, *radiance.shape[:2]), np.float32)
        row[0] = 1
        for angle in reversed(stack_deg):
            row = self._before(row, angle)
        seen = row[0][..., None] * radiance
        if polarized is not None:
            seen += row[1][..., None] * polarized[0] + row[2][..., None] * polarized[1]
        return np.asarray(np.maximum(seen, 0), np.float32)

    def _before(self, row: NDArray[np.float32], angle_deg: float) -> NDArray[np.float32]:
        """A row vector (3, H, W) times the sheet's Mueller matrix, without S3.

        a = k1 + k2, b = k1 - k2, c = 2 √(k1 k2) (Goldstein, Polarized Light, ch. 5).
        """
        a = np.float32(self.sheet.transmission)
        b = np.float32(self.sheet.transmission * self.sheet.diattenuation)
        c = np.sqrt(np.maximum(a * a - b * b, 0))
        x, y = self.axis(angle_deg)
        along, across = x * row[1] + y * row[2], x * row[2] - y * row[1]
        total, along = (a * row[0] + b * along) / 2, (b * row[0] + a * along) / 2
        across = across * c / 2
        return np.stack([total, x * along - y * across, y * along + x * across])

    def _mix(
        self,
        radiance: NDArray[np.float32],
        polarized: NDArray[np.float32],
        wheel_deg: Sequence[float],
        rows: slice,
        seen: NDArray[np.float32],
    ) -> None:
        """Write the rows' radiance behind the sheet into `seen`."""
        gain = np.float32(self.sheet.unpolarized_gain)
        if not polarized.any():
            np.multiply(radiance, gain, out=seen)
            return
        cosine, sine = self.axis(wheel_deg[0], rows)
        for angle in wheel_deg[1:]:
            c, s = self.axis(angle, rows)
            cosine, sine = cosine + c, sine + s
        depth = gain * np.float32(self.sheet.diattenuation / len(wheel_deg))
        np.multiply(radiance, gain, out=seen)
        for share, part in zip((depth * cosine, depth * sine), polarized, strict=True):
            seen += cv2.merge([share, share, share]) * part  # thrice as fast as broadcasting
        np.maximum(seen, 0, out=seen)


def pixel_frame(directions: Array) -> tuple[Array, Array]:
    """Right (d × up, horizontal) and up (right × d) of directions (…, 3); unit vectors.

    At the poles, where there is no right, +X.
    """
    right = np.cross(directions, [0.0, 1.0, 0.0])
    length = np.linalg.norm(right, axis=-1, keepdims=True)
    right = np.where(length > 1e-9, right / np.maximum(length, 1e-9), [1.0, 0.0, 0.0])
    return right, np.cross(right, directions)


def lens_rotations(camera: Camera) -> list[Array]:
    """Rotation matrices (3, 3) from each lens to the probe frame; of an equirectangular camera one.

    The sheet of a lens faces along its -Z.
    """
    return [rotation_matrix(lens.rotation_wxyz) for lens in camera.lenses] or [np.eye(3)]


def _projected_axes(
    lens: Camera, size_px: tuple[int, int]
) -> tuple[tuple[NDArray[np.float32], ...], tuple[NDArray[np.float32], ...]]:
    """Components x, y (H, W) of e for p along X and along Y of each pixel's lens."""
    directions, owner = lens.look(*size_px)[0], lens.owner(*size_px)
    seen = np.isfinite(directions[..., :1])
    directions = np.where(seen, directions, [0.0, 0.0, -1.0])
    right, up = pixel_frame(directions)
    turns = lens_rotations(lens)
    axes = []
    for own in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):
        across = np.array([turn @ np.cross([0.0, 0.0, -1.0], own) for turn in turns])
        field = np.cross(directions, across[owner])
        axes.append(tuple(_dot(field, part).astype(np.float32) for part in (right, up)))
    return axes[0], axes[1]


def _dot(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(axis=-1))
