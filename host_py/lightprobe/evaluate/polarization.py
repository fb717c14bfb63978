"""How every pixel of pictures through a polarizer is polarized: S0, S1, S2 by least squares.

The geometry is that of :mod:`lightprobe.sim.polarizer`: one flat sheet in front of each lens, so
that a pixel has its own angle ψ of the sheet. I = ½ t (S0 + D (S1 cos 2ψ + S2 sin 2ψ)).
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
from lightprobe.geometry import Array, rotation_matrix
from lightprobe.imaging import image
from lightprobe.imaging.camera import Camera
from lightprobe.sim.polarizer import Polarizer, Sheet

#: Beyond this angle off its normal a real sheet does not polarize any more.
EDGE_ON_DEG = 75.0
#: Angles of the wheel that are closer than this, modulo 180°, are one.
_LEAST_APART_DEG = 5.0
_CLIPPED_CODE = 254
_ROWS = 32


@dataclass(frozen=True, eq=False)
class Polarization:
    """Stokes parameters of every pixel, in its own frame (right, up); NaN: not known."""

    stokes: NDArray[np.float32]  # (3, H, W, 3): S0, S1, S2 of R, G, B

    @property
    def dolp(self) -> Array:
        """Degree of linear polarization of luminance (H, W), at most 1."""
        s0, s1, s2 = self._luminance()
        return np.asarray(np.minimum(np.hypot(s1, s2) / np.where(s0 > 0, s0, np.nan), 1))

    @property
    def aolp_deg(self) -> Array:
        """Angle (H, W), 0…180: 0 horizontal, counter-clockwise as seen from inside."""
        _, s1, s2 = self._luminance()
        return np.asarray(np.degrees(np.arctan2(s2, s1)) / 2 % 180)

    def _luminance(self) -> Array:
        return luminance(self.stokes.astype(np.float64))

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


def read(files: Sequence[Path], lens: Camera) -> list[NDArray[np.float32]]:
    """Linear light (H, W, 3) of pictures of one size, 8-bit ones by the camera's response.

    Clipped pixels are NaN.
    """
    pictures = [_read_one(file, lens) for file in files]
    for file, picture in zip(files, pictures, strict=True):
        if picture.shape != pictures[0].shape:
            raise UsageError(
                f"polarization: {file}: {picture.shape[1]}×{picture.shape[0]}, but {files[0]}: "
                f"{pictures[0].shape[1]}×{pictures[0].shape[0]}: all must have the same size"
            )
    return pictures


def _read_one(file: Path, lens: Camera) -> NDArray[np.float32]:
    if file.suffix.lower() in image.HDR_SUFFIXES:
        return image.read(file).radiance
    codes = image.read_srgb8(file)
    table = lens.response_table()
    light = np.stack([table[codes[..., c], c] for c in range(3)], axis=-1).astype(np.float32)
    light[(codes >= _CLIPPED_CODE).any(axis=-1)] = np.nan
    return light


def measure(
    pictures: Sequence[NDArray[np.float32]],
    wheel_deg: Sequence[float],
    lens: Camera,
    sheet: Sheet | None = None,
) -> Polarization:
    """Solve every pixel for S0, S1, S2, in the units of the pictures without the sheet.

    Not known where a picture is clipped, and where the sheet is seen edge-on.
    """
    check_angles(wheel_deg, len(pictures))
    height, width, _ = pictures[0].shape
    polarizer = Polarizer(sheet or Sheet(), lens, (width, height))
    stokes = np.full((3, height, width, 3), np.nan, np.float32)
    hidden = _edge_on(lens, (width, height))
    for top in range(0, height, _ROWS):
        rows = slice(top, min(top + _ROWS, height))
        seen = np.stack([picture[rows] for picture in pictures], axis=-2)  # rows, W, angles, RGB
        solved = _solve(polarizer, wheel_deg, rows, seen)
        solved[hidden[rows]] = np.nan
        stokes[:, rows] = np.moveaxis(solved, 2, 0)
    return Polarization(stokes)


def _solve(
    polarizer: Polarizer, wheel_deg: Sequence[float], rows: slice, seen: NDArray[np.float32]
) -> Array:
    sheet = polarizer.sheet
    axes = [np.stack(polarizer.axis(angle, rows), axis=-1) for angle in wheel_deg]
    design = np.concatenate(
        [
            np.ones((*seen.shape[:2], len(axes), 1)),
            sheet.diattenuation * np.stack(axes, axis=-2).astype(np.float64),
        ],
        axis=-1,
    )
    turned = np.swapaxes(design, -1, -2)
    normal = turned @ design + 1e-9 * np.eye(3)
    return np.asarray(np.linalg.solve(normal, turned @ (seen / sheet.unpolarized_gain)))


def _edge_on(lens: Camera, size_px: tuple[int, int]) -> NDArray[np.bool_]:
    directions, owner = lens.look(*size_px)[0], lens.owner(*size_px)
    turns = [rotation_matrix(part.rotation_wxyz) for part in lens.lenses] or [np.eye(3)]
    normals = np.array([turn @ [0.0, 0.0, -1.0] for turn in turns])[owner]
    cosine = np.abs((directions * normals).sum(axis=-1))
    return np.asarray(~(cosine >= np.cos(np.radians(EDGE_ON_DEG))))
