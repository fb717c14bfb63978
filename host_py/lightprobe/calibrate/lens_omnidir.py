"""OpenCV's omnidir model (Mei and Rives 2007), rewritten as the polynomial of camera files.

A direction is put on the unit sphere and seen from ξ behind its middle: r = sin θ / (cos θ + ξ),
then distorted by 1 + k1·r² + k2·r⁴. Its tangential distortion has no place in camera files and is
left out; what that costs is in the distance of the corners.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from lightprobe.calibrate.lens_adjust import rms_px_of
from lightprobe.calibrate.lens_board import Corners
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.geometry import Array
from lightprobe.imaging.camera import Lens

_STEPS = 256
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-10)


def fit(
    pictures: Sequence[Corners], size_px: tuple[int, int], max_theta_deg: float
) -> tuple[Lens, tuple[float, ...]]:
    """Give a lens that holds to an angle off the axis, and each picture's RMS in pixels.

    NaN: OpenCV left that picture out. Raises UsageError where this OpenCV has no omnidir, and
    LightprobeError where the model does not reach that far, or nothing fits.
    """
    if not hasattr(cv2, "omnidir"):
        raise UsageError(
            "calibrate: --model omnidir: this OpenCV lacks it: pip install "
            "opencv-contrib-python-headless in place of opencv-python-headless, or use fisheye"
        )
    board = [c.board.reshape(1, -1, 3).astype(np.float64) for c in pictures]
    seen = [(c.picture_px - 0.5).reshape(1, -1, 2).astype(np.float64) for c in pictures]
    try:
        _, matrix, xi, distortion, turns, shifts, used = cv2.omnidir.calibrate(
            board, seen, size_px, np.zeros((3, 3)), np.zeros((1, 1)), np.zeros((1, 4)),
            cv2.omnidir.CALIB_FIX_SKEW, _STOP,
        )  # fmt: skip
    except cv2.error:
        raise LightprobeError(
            "calibrate: --model omnidir: OpenCV finds no such lens: use --model fisheye, or take "
            "more pictures, with the board tilted and near the edges"
        ) from None
    numbers = np.asarray(distortion, np.float64).ravel()
    lens = _as_polynomial(np.asarray(matrix, np.float64), float(np.ravel(xi)[0]), numbers,
                          max_theta_deg)  # fmt: skip
    rms_px = np.full(len(pictures), np.nan)
    for number, turn, shift in zip(np.ravel(used).astype(int).tolist(), turns, shifts, strict=True):
        rms_px[number] = rms_px_of(lens, pictures[number], np.ravel(turn), np.ravel(shift))
    return lens, tuple(rms_px.tolist())


def _as_polynomial(matrix: Array, xi: float, distortion: Array, max_theta_deg: float) -> Lens:
    """The polynomial of the same radius, by least squares over the angle."""
    theta = np.linspace(0, np.radians(max_theta_deg), _STEPS + 1)[1:]
    if np.cos(theta[-1]) + xi < 0.05:
        raise LightprobeError(
            f"calibrate: --model omnidir: its lens ends before {max_theta_deg:.0f} degrees, where "
            "corners were seen: use --model fisheye"
        )
    plain = np.sin(theta) / (np.cos(theta) + xi)
    radius = plain * (1 + plain**2 * (distortion[0] + plain**2 * distortion[1]))
    powers = theta[:, None] ** np.array([1, 3, 5, 7, 9])
    first, *higher = np.linalg.lstsq(powers, radius, rcond=None)[0]
    k1, k2, k3, k4 = (float(value / first) for value in higher)
    return Lens(
        (float(matrix[0, 2]) + 0.5, float(matrix[1, 2]) + 0.5),
        (float(first * matrix[0, 0]), float(first * matrix[1, 1])),
        (k1, k2, k3, k4),
        max_theta_deg,
    )
