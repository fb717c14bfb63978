"""How every pixel of pictures through a polarizer is polarized: S0, S1, S2 by least squares.

The geometry is that of :mod:`lightprobe.imaging.polarizer`: one flat sheet in front of each lens,
so that a pixel has its own angle ψ and share G of it. I = ½ t G (S0 + D (S1 cos 2ψ + S2 sin 2ψ)).
Several
exposures of one angle count by their noise: the short ones tell of what clips in the long ones.
What noise is left is lessened by the neighbours (:mod:`lightprobe.imaging.stokes_filter`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.colour import luminance
from lightprobe.errors import UsageError
from lightprobe.geometry import Array
from lightprobe.imaging import image, jpeg_noise
from lightprobe.imaging.camera import Camera
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.polarizer import EDGE_ON_DEG, Polarizer, lens_rotations
from lightprobe.imaging.stokes_filter import smoothed

#: Angles of the wheel that are closer than this, modulo 180°, are one.
_LEAST_APART_DEG = 5.0
_CLIPPED_CODE = 250
#: 1 sigma of a code without JPEG: rounding and the sensor's noise.
_CODE_SIGMA = 1.0
#: Determinant of the angles' normal equations, 0.25 for four at 45°: three at 5° have 1e-6.
_LEAST_DETERMINANT = 1e-7
_ROWS = 32


@dataclass(frozen=True, eq=False)
class Picture:
    """Linear light behind the sheet."""

    light: NDArray[np.float32]  # (H, W, 3); NaN: clipped
    sigma: NDArray[np.float32] | None = None  # (H, W), of luminance; None: exact


@dataclass(frozen=True, eq=False)
class Polarization:
    """Stokes parameters of every pixel, in its own frame (right, up); NaN: not known."""

    stokes: NDArray[np.float32]  # (3, H, W, 3): S0, S1, S2 of R, G, B
    covariance: Array | None = None  # (H, W, 3, 3), of luminance; None: exact

    @property
    def dolp(self) -> Array:
        """Degree of linear polarization of luminance (H, W), at most 1.

        Freed of the bias that noise brings (Wardle and Kronberg 1974).
        """
        biased = self._biased()
        degree = np.sqrt(np.maximum(biased**2 - self.dolp_sigma**2, 0))
        return np.asarray(np.minimum(degree, 1))

    @property
    def dolp_sigma(self) -> Array:
        """1 sigma of it (H, W), to first order."""
        along, _ = self._sigmas()
        return along

    @property
    def aolp_sigma_deg(self) -> Array:
        """1 sigma of the angle (H, W), at most 90."""
        _, across = self._sigmas()
        degree = np.maximum(self._biased(), 1e-9)
        return np.asarray(np.minimum(np.degrees(across / (2 * degree)), 90))

    @property
    def aolp_deg(self) -> Array:
        """Angle (H, W), 0…180: 0 horizontal, counter-clockwise as seen from inside."""
        _, s1, s2 = self._luminance()
        return np.asarray(np.degrees(np.arctan2(s2, s1)) / 2 % 180)

    def _luminance(self) -> Array:
        return luminance(self.stokes.astype(np.float64))

    def _biased(self) -> Array:
        s0, s1, s2 = self._luminance()
        return np.asarray(np.hypot(s1, s2) / np.where(s0 > 0, s0, np.nan))

    def _sigmas(self) -> tuple[Array, Array]:
        """1 sigma of (S1, S2) / S0 along itself and across."""
        s0, s1, s2 = self._luminance()
        if self.covariance is None:
            return np.zeros_like(s0), np.zeros_like(s0)
        s0 = np.where(s0 > 0, s0, np.nan)
        q, u, degree = s1 / s0, s2 / s0, np.maximum(np.hypot(s1, s2) / s0, 1e-9)
        x, y, zero = q / degree, u / degree, np.zeros_like(q)
        # of degree = (x S1 + y S2) / S0, and across of (-y S1 + x S2) / S0
        slopes = np.stack([-degree, x, y], axis=-1), np.stack([zero, -y, x], axis=-1)
        along, across = (
            np.sqrt(np.einsum("hwi,hwij,hwj->hw", slope, self.covariance, slope)) / s0
            for slope in slopes
        )
        return along, across

    def write(self, folder: Path) -> list[Path]:
        """Write s0.pfm, stokes.npz (a scene of the simulator), dolp.png and aolp.png.

        aolp.png is HSV as usual: hue the angle (180° once round), saturation the degree, value S0.
        """
        folder.mkdir(parents=True, exist_ok=True)
        known = np.nan_to_num(self.stokes)
        image.write_pfm(folder / "s0.pfm", known[0])
        fourth = np.zeros_like(known[0])
        np.savez_compressed(folder / "stokes.npz", S=np.stack([*known, fourth], axis=2))
        dolp = np.nan_to_num(self.dolp)
        hsv = np.stack([self.aolp_deg, 255 * dolp, 255 * _display(luminance(known[0]))], axis=-1)
        hsv = np.nan_to_num(hsv).astype(np.uint8)
        cv2.imwrite(str(folder / "dolp.png"), (255 * dolp).round().astype(np.uint8))
        cv2.imwrite(str(folder / "aolp.png"), cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR))
        return [folder / name for name in ("s0.pfm", "stokes.npz", "dolp.png", "aolp.png")]


def _display(light: Array) -> Array:
    """Bring light to 0…1 for the eye: its 99th percentile is white."""
    return np.asarray(np.clip(light / max(np.percentile(light, 99), 1e-30), 0, 1) ** (1 / 2.2))


def check_angles(wheel_deg: Sequence[float], pictures: int) -> None:
    """One angle for each picture, at least three different ones; raises UsageError otherwise."""
    if len(wheel_deg) != pictures:
        raise UsageError(
            f"polarization: {pictures} pictures and {len(wheel_deg)} angles of the wheel: "
            "one for each picture (--wheel-deg 0,45,90,135)"
        )
    turned = np.sort(np.mod(wheel_deg, 180.0))
    gaps = np.diff(turned, append=turned[0] + 180)
    different = max(int((gaps > _LEAST_APART_DEG).sum()), 1)
    if different < 3:
        raise UsageError(
            f"polarization: angles {', '.join(f'{angle:g}' for angle in wheel_deg)} are "
            f"{different} different one{'s' * (different > 1)} modulo 180°: S0, S1 and S2 need "
            "three, like 0,60,120"
        )


def read(files: Sequence[Path], lens: Camera, exposures_us: Sequence[float] = ()) -> list[Picture]:
    """Linear light of pictures of one size, 8-bit ones by the camera's response.

    `exposures_us`: of each 8-bit file; then radiance 1 is full scale at one second.
    """
    if exposures_us and len(exposures_us) != len(files):
        raise UsageError(
            f"polarization: {len(files)} pictures and {len(exposures_us)} exposures: "
            "one for each picture (--exposure-us 8000,500,8000,500)"
        )
    scales = [1e6 / exposure for exposure in exposures_us] or [1.0] * len(files)
    pictures = [_read_one(file, lens, scale) for file, scale in zip(files, scales, strict=True)]
    shape = pictures[0].light.shape
    for file, picture in zip(files, pictures, strict=True):
        height, width, _ = picture.light.shape
        if (height, width) != shape[:2]:
            raise UsageError(
                f"polarization: {file}: {width}×{height}, but {files[0]}: "
                f"{shape[1]}×{shape[0]}: all must have the same size"
            )
    return pictures


def _read_one(file: Path, lens: Camera, scale: float) -> Picture:
    if file.suffix.lower() in image.HDR_SUFFIXES:
        return Picture(image.read(file).radiance)
    jpeg_sigma = jpeg_noise.code_sigma(file.read_bytes()) if file.is_file() else None
    return of_codes(image.read_srgb8(file), lens, scale, jpeg_sigma)


def of_codes(
    codes: NDArray[np.uint8], lens: Camera, scale: float = 1.0, jpeg_sigma: float | None = None
) -> Picture:
    """Linear light of 8-bit codes (H, W, 3), `scale` at full scale.

    `jpeg_sigma`: of codes, by JPEG's rounding (:func:`lightprobe.imaging.jpeg_noise.code_sigma`).
    """
    table = lens.response_table()
    slope = luminance(np.gradient(table, axis=0))
    light = np.stack([table[codes[..., c], c] for c in range(3)], axis=-1)
    light[(codes >= _CLIPPED_CODE).any(axis=-1)] = np.nan
    sigma = np.hypot(_CODE_SIGMA, jpeg_sigma or 0.0) * slope[codes[..., 1]]
    return Picture((scale * light).astype(np.float32), (scale * sigma).astype(np.float32))


def measure(
    pictures: Sequence[Picture],
    wheel_deg: Sequence[float],
    lens: Camera,
    sheet: Sheet | None = None,
) -> Polarization:
    """Solve every pixel for S0, S1, S2, in the units of the pictures without the sheet.

    `sheet`: default that of the camera file.
    Not known where fewer than three different angles are left that do not clip, and where the
    sheet is seen edge-on.
    """
    check_angles(wheel_deg, len(pictures))
    height, width, _ = pictures[0].light.shape
    polarizer = Polarizer(sheet or lens.sheet, lens, (width, height))
    stokes = np.full((3, height, width, 3), np.nan, np.float32)
    covariance = np.full((height, width, 3, 3), np.nan)
    hidden = _edge_on(lens, (width, height))
    for top in range(0, height, _ROWS):
        rows = slice(top, min(top + _ROWS, height))
        solved, covariance[rows] = _solve(polarizer, wheel_deg, rows, pictures)
        solved[hidden[rows]] = np.nan
        stokes[:, rows] = np.moveaxis(solved, 2, 0)
    if all(picture.sigma is None for picture in pictures):
        return Polarization(stokes)
    return Polarization(*smoothed(stokes, covariance))


def _solve(
    polarizer: Polarizer, wheel_deg: Sequence[float], rows: slice, pictures: Sequence[Picture]
) -> tuple[Array, Array]:
    """Weighted least squares: S0, S1, S2 (rows, W, 3, RGB), their covariance (rows, W, 3, 3)."""
    sheet = polarizer.sheet
    light = np.stack([picture.light[rows] for picture in pictures], axis=-2)  # rows, W, N, RGB
    valid = np.asarray(np.isfinite(light).all(axis=-1), np.bool_)
    gains = [polarizer.gain(angle, rows) for angle in wheel_deg]
    gain = sheet.unpolarized_gain * np.stack(gains, axis=-1).astype(np.float64)
    seen: Array = np.where(valid[..., None], light.astype(np.float64) / gain[..., None], 0.0)
    axes = [np.stack(polarizer.axis(angle, rows), axis=-1) for angle in wheel_deg]
    design = np.concatenate(
        [np.ones((*valid.shape, 1)), sheet.diattenuation * np.stack(axes, axis=-2)], axis=-1
    )
    least = _normal(design, valid / np.maximum(valid.sum(axis=-1, keepdims=True), 1))
    known = np.asarray(np.linalg.det(least) > _LEAST_DETERMINANT)
    weight = valid / _variance(pictures, rows, gain)
    normal = np.where(known[..., None, None], _normal(design, weight), np.eye(3))
    right = np.swapaxes(design, -1, -2) @ (weight[..., None] * seen)
    solved = np.where(known[..., None, None], np.linalg.solve(normal, right), np.nan)
    return solved, np.asarray(np.linalg.inv(normal), np.float64)


def _normal(design: Array, weight: Array) -> Array:
    return np.asarray(np.swapaxes(design, -1, -2) @ (weight[..., None] * design))


def _variance(pictures: Sequence[Picture], rows: slice, gain: Array) -> Array:
    """Of luminance without the sheet (rows, W, N), gains alike; 1 of exact pictures."""
    ones = np.ones(pictures[0].light[rows].shape[:2])
    sigmas = [ones if one.sigma is None else one.sigma[rows] / gain[..., k]
              for k, one in enumerate(pictures)]  # fmt: skip
    return np.asarray(np.stack(sigmas, axis=-1).astype(np.float64) ** 2)


def _edge_on(lens: Camera, size_px: tuple[int, int]) -> NDArray[np.bool_]:
    directions, owner = lens.look(*size_px)[0], lens.owner(*size_px)
    normals = np.array([turn @ [0.0, 0.0, -1.0] for turn in lens_rotations(lens)])[owner]
    cosine = np.abs((directions * normals).sum(axis=-1))
    return np.asarray(~(cosine >= np.cos(np.radians(EDGE_ON_DEG))))
