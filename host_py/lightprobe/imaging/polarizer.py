"""The polarizer wheel in front of the lens, by Jones' matrices of every pixel's ray.

One flat sheet in front of each lens, across its axis; an equirectangular camera has one sheet
across the forward axis for both halves. The sheet's transmission axis is p = cos θ · X + sin θ · Y
of the lens: θ = 0 along +X, counter-clockwise as seen from inside looking out.

Light from direction d is refracted by the sheet's first surface to d'. The inside lets pass what is
polarized along e' ∝ d' × (n × p), n the sheet's normal. Each surface takes its share of the field
across and along the plane of incidence (Fresnel), so that of the Jones matrix `leave · e' e'ᵀ ·
enter` remain the field u = enter · e' that passes, and the share |u|² |leave · e'|² of it. What the
surfaces reflect to and fro inside adds to it, without interference. With G that share against the
one of light along the normal, ψ the angle of u in the pixel's own frame, r the extinction ratio:

    I = ½ · transmission · G · (S0 + (r − 1)/(r + 1) · (S1 cos 2ψ + S2 sin 2ψ))

(the first row of a linear diattenuator's Mueller matrix: Goldstein, Polarized Light, ch. 5). What
leaks across the axis takes the same G. An index of 1 is an ideal sheet: G = 1, and u is p seen
along d. Left out: the sheet's falling extinction at grazing angles; real sheets serve to about 75°
off the axis, beyond which G is taken as there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.geometry import Array, cross, rotation_matrix
from lightprobe.imaging.camera import Lens
from lightprobe.imaging.film import Sheet

#: Beyond this angle off its normal a real sheet does not polarize any more.
EDGE_ON_DEG = 75.0
#: Rows of a picture that are computed at a time.
_ROWS = 16


class Optics(Protocol):
    """What is asked of a camera."""

    @property
    def lenses(self) -> tuple[Lens, ...]:
        """The sheet of each faces along its -Z; none: one faces ahead."""

    def look(self, width_px: int, height_px: int) -> tuple[Array, Array]:
        """Directions (H, W, 3) of the pixels, and their illumination."""

    def owner(self, width_px: int, height_px: int) -> NDArray[np.intp]:
        """Which lens each pixel (H, W) belongs to."""


class Polarizer:
    """A sheet in front of a camera's lenses, for one picture size."""

    def __init__(self, sheet: Sheet, lens: Optics, size_px: tuple[int, int]) -> None:
        """`size_px` (width, height)."""
        self.sheet = sheet
        self._surfaces = _surfaces(lens, size_px, sheet.index)
        self._kept: tuple[tuple[float, ...], NDArray[np.float32]] | None = None

    def axis(
        self, wheel_deg: float, rows: slice = slice(None)
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """cos 2ψ and sin 2ψ (H, W) of the light that passes in each pixel (of some rows)."""
        x, y = self._turned(self._surfaces.field, wheel_deg, rows)
        xx, yy = x * x, y * y
        over = np.asarray(1 / np.maximum(xx + yy, np.float32(1e-12)), np.float32)
        return (xx - yy) * over, np.float32(2) * x * y * over

    def gain(self, wheel_deg: float, rows: slice = slice(None)) -> NDArray[np.float32]:
        """G (H, W): 1 along the normal."""
        surfaces = self._surfaces
        inside = self._turned(surfaces.inside, wheel_deg, rows)
        across, along = inside[0] * inside[0], inside[1] * inside[1]
        over = np.float32(1) / (across + along)
        across, along = across * over, along * over
        # Mirrored, e' has the other sign across the plane of incidence.
        back = surfaces.mirrored[1, rows] * along - surfaces.mirrored[0, rows] * across
        enters, leaves = (
            one[0, rows] * across + one[1, rows] * along
            for one in (surfaces.entering, surfaces.leaving)
        )
        back *= back
        share = enters * leaves / (np.float32(surfaces.head_on) * (1 - back * back))
        return np.asarray(share, np.float32)

    def _turned(
        self, fields: NDArray[np.float32], wheel_deg: float, rows: slice
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Both parts of fields (2, 2, H, W), which are linear in p: those of X, those of Y."""
        axis_rad = np.radians(wheel_deg + self.sheet.offset_deg)
        cosine, sine = (np.float32(f(axis_rad)) for f in (np.cos, np.sin))
        turned = cosine * fields[0][:, rows] + sine * fields[1][:, rows]
        return turned[0], turned[1]

    def through(
        self,
        radiance: NDArray[np.float32],
        polarized: NDArray[np.float32] | None,
        wheel_deg: Sequence[float],
    ) -> NDArray[np.float32]:
        """Radiance (H, W, 3) behind the sheet, the mean over the wheel's angles.

        `radiance` S0 (H, W, 3), `polarized` S1, S2 (2, H, W, 3) or None for none.
        """
        shares = self._shares(tuple(wheel_deg))
        seen = np.empty_like(radiance)
        for top in range(0, len(radiance), _ROWS):  # what is at work stays in the cache
            rows = slice(top, top + _ROWS)
            parts = [radiance[rows]]
            if polarized is not None and polarized[:, rows].any():
                parts += list(polarized[:, rows])
            mixed = [cv2.merge([share[rows]] * 3) * part  # thrice as fast as broadcasting
                     for share, part in zip(shares, parts, strict=False)]  # fmt: skip
            seen[rows] = np.maximum(sum(mixed[1:], start=mixed[0]), 0)
        return seen

    def _shares(self, wheel_deg: tuple[float, ...]) -> NDArray[np.float32]:
        """What of S0, S1, S2 is seen (3, H, W), the mean over the angles; the last are kept."""
        if self._kept is None or self._kept[0] != wheel_deg:
            shares = np.zeros((3, *self._surfaces.field.shape[2:]), np.float32)
            depth = np.float32(self.sheet.diattenuation)
            for top in range(0, shares.shape[1], _ROWS):
                rows = slice(top, top + _ROWS)
                for angle in wheel_deg:
                    gain, (cosine, sine) = self.gain(angle, rows), self.axis(angle, rows)
                    shares[0, rows] += gain
                    shares[1, rows] += depth * gain * cosine
                    shares[2, rows] += depth * gain * sine
            shares *= np.float32(self.sheet.unpolarized_gain / len(wheel_deg))
            self._kept = (wheel_deg, shares)
        return self._kept[1]

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
        gain = self.gain(angle_deg)
        a = self.sheet.transmission * gain
        b = np.float32(self.sheet.diattenuation) * a
        c = np.sqrt(np.maximum(a * a - b * b, 0))
        x, y = self.axis(angle_deg)
        along, across = x * row[1] + y * row[2], x * row[2] - y * row[1]
        total, along = (a * row[0] + b * along) / 2, (b * row[0] + a * along) / 2
        across = across * c / 2
        return np.stack([total, x * along - y * across, y * along + x * across])


def pixel_frame(directions: Array) -> tuple[Array, Array]:
    """Right (d × up, horizontal) and up (right × d) of directions (…, 3); unit vectors.

    At the poles, where there is no right, +X.
    """
    right = np.cross(directions, [0.0, 1.0, 0.0])
    length = np.linalg.norm(right, axis=-1, keepdims=True)
    right = np.where(length > 1e-9, right / np.maximum(length, 1e-9), [1.0, 0.0, 0.0])
    return right, np.cross(right, directions)


def lens_rotations(camera: Optics) -> list[Array]:
    """Rotation matrices (3, 3) from each lens to the probe frame; of an equirectangular camera one.

    The sheet of a lens faces along its -Z.
    """
    return [rotation_matrix(lens.rotation_wxyz) for lens in camera.lenses] or [np.eye(3)]


@dataclass(frozen=True)
class _Surfaces:
    """What the surfaces of each pixel's sheet do; H, W last."""

    #: e' across and along the plane of incidence, for p along X and along Y.
    inside: NDArray[np.float32]  # (2, 2, H, W)
    #: What passes, in the pixel's own frame, for the same.
    field: NDArray[np.float32]  # (2, 2, H, W)
    #: Shares of light that enters and leaves, across and along.
    entering: NDArray[np.float32]  # (2, H, W)
    leaving: NDArray[np.float32]  # (2, H, W)
    #: Amplitudes that are reflected inside, across and along.
    mirrored: NDArray[np.float32]  # (2, H, W)
    #: Share of light along the normal.
    head_on: float


def _surfaces(lens: Optics, size_px: tuple[int, int], index: float) -> _Surfaces:
    directions, owner = lens.look(*size_px)[0], lens.owner(*size_px)
    directions = np.where(np.isfinite(directions[..., :1]), directions, [0.0, 0.0, -1.0])
    turns = np.array(lens_rotations(lens))
    parts = [
        _part(directions[top : top + _ROWS], turns[owner[top : top + _ROWS]], index)
        for top in range(0, len(directions), _ROWS)
    ]
    whole = [np.concatenate(one, axis=-2) for one in zip(*parts, strict=True)]
    enter, leave, back = _fresnel(np.ones(()), index)
    head_on = float(enter[0] ** 2 * leave[0] ** 2 / (1 - back[0] ** 4))
    return _Surfaces(whole[0], whole[1], whole[2], whole[3], whole[4], head_on)


def _part(directions: Array, turns: Array, index: float) -> list[NDArray[np.float32]]:
    """What _Surfaces holds of each pixel; turns (…, 3, 3) of its lens."""
    normals, own = -turns[..., 2], (turns[..., 0], turns[..., 1])
    facing = np.where(_dot(normals, directions)[..., None] < 0, -1.0, 1.0) * normals
    across = cross(facing, directions)  # the plane of incidence
    length = np.linalg.norm(across, axis=-1, keepdims=True)
    across = np.where(length > 1e-6, across / np.maximum(length, 1e-9), own[0])
    along, frame = cross(across, directions), pixel_frame(directions)
    cosine = np.clip(_dot(facing, directions), 1e-4, 1)
    kept = np.maximum(cosine, np.cos(np.radians(EDGE_ON_DEG)))
    enter = _fresnel(cosine, index)[0]
    inside, field = [], []
    for axis in own:
        absorbed = cross(normals, axis)
        inside.append(_passing(facing, across, absorbed, kept, index))
        u = enter * _passing(facing, across, absorbed, cosine, index)
        field.append([u[0] * _dot(across, part) + u[1] * _dot(along, part) for part in frame])
    entering, leaving, mirrored = _fresnel(kept, index)
    found = (inside, field, entering**2, leaving**2, mirrored)
    return [np.array(one, np.float32) for one in found]


def _inner(cosine: Array, index: float) -> Array:
    """Cosine of the angle inside (Snell)."""
    return np.asarray(np.sqrt(1 - (1 - cosine**2) / index**2))


def _passing(facing: Array, across: Array, absorbed: Array, cosine: Array, index: float) -> Array:
    """e' (2, H, W) across and along the plane of incidence."""
    inner = _inner(cosine, index)[..., None]
    refracted = np.sqrt(1 - inner**2) * cross(across, facing) + inner * facing
    passing = cross(refracted, absorbed)
    return np.stack([_dot(passing, across), _dot(passing, cross(across, refracted))])


def _fresnel(cosine: Array, index: float) -> tuple[Array, Array, Array]:
    """Amplitudes across and along the plane of incidence: that enter, that leave, mirrored inside.

    Each (2, …); signs as in Hecht, Optics, ch. 4.
    """
    inner, n = _inner(cosine, index), index
    across, along = cosine + n * inner, n * cosine + inner
    enter = np.stack([2 * cosine / across, 2 * cosine / along])
    leave = np.stack([2 * n * inner / across, 2 * n * inner / along])
    mirrored = np.stack([(n * inner - cosine) / across, (inner - n * cosine) / along])
    return enter, leave, mirrored


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))
