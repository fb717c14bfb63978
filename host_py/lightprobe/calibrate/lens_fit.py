"""A fisheye lens from pictures of a board, by OpenCV's model of Kannala and Brandt (2006).

r = f·(θ + k1·θ³ + k2·θ⁵ + k3·θ⁷ + k4·θ⁹): the model of camera files (lightprobe.imaging.camera).
OpenCV's calibration needs a start; poses at several focal lengths give it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from lightprobe.calibrate.lens_board import Corners
from lightprobe.errors import LightprobeError
from lightprobe.geometry import Array
from lightprobe.imaging.camera import Lens

LEAST_PICTURES = 6
#: Where the flags of cv2.fisheye are: in OpenCV 5, and in OpenCV 4.
_FLAGS = cv2 if hasattr(cv2, "CALIB_RECOMPUTE_EXTRINSIC") else cv2.fisheye
#: Corners farther off the axis have no place on OpenCV's plane in front of the lens.
MOST_THETA_DEG = 85.0
#: Fields of view across the picture's shorter side that are tried as a start.
_STARTS_DEG = (90.0, 120.0, 150.0, 180.0, 210.0)
#: A picture is left out when it is so many times as wrong as the middle one, and by so many pixels.
_OUTLIER, _OUTLIER_PX = 3.0, 0.5


class LensError(LightprobeError):
    """The pictures do not say what the lens is; says why, and what to do."""


@dataclass(frozen=True)
class Fit:
    """A lens, and how well it explains the corners."""

    lens: Lens  # max_theta_deg: the farthest corner off the axis
    size_px: tuple[int, int]
    rms_px: float  # distance of corners, root mean square
    picture_rms_px: tuple[float, ...]  # of each picture; NaN: it was left out
    corners: int
    covered: float  # share of the picture's inscribed circle that corners reach, 12 parts by angle


def fit(pictures: Sequence[Corners], size_px: tuple[int, int]) -> Fit:
    """Fit a lens to what pictures of one size (width, height) show; raises :class:`LensError`."""
    if len(pictures) < LEAST_PICTURES:
        raise LensError(
            f"calibrate: lens: the board is found in {len(pictures)} pictures, expected at least "
            f"{LEAST_PICTURES}: take more, sharp and well lit, with the board large and tilted"
        )
    focal_px = min((_start_error(pictures, size_px, deg), deg) for deg in _STARTS_DEG)[1]
    used = list(range(len(pictures)))
    lens, rms = _calibrate(pictures, size_px, _focal(size_px, focal_px))
    worst = max(_OUTLIER * float(np.median(rms)), _OUTLIER_PX)
    kept = [k for k in used if rms[k] <= worst]
    if len(kept) < len(used):
        if len(kept) < LEAST_PICTURES:
            raise LensError(
                "calibrate: lens: the pictures contradict each other: is the board flat, and the "
                "focus fixed?"
            )
        lens, of_kept = _calibrate([pictures[k] for k in kept], size_px, lens.focal_px[0])
        rms = [of_kept[kept.index(k)] if k in kept else np.nan for k in used]
    chosen = [pictures[k] for k in kept]
    every = np.concatenate([c.picture_px for c in chosen])
    mean_square = np.average(
        [rms[k] ** 2 for k in kept], weights=[len(pictures[k].board) for k in kept]
    )
    return Fit(
        lens, size_px, float(np.sqrt(mean_square)), tuple(float(r) for r in rms), len(every),
        _covered(every, lens, size_px),
    )  # fmt: skip


def _focal(size_px: tuple[int, int], field_deg: float) -> float:
    return min(size_px) / float(np.radians(field_deg))


def _plane(corners: Corners, size_px: tuple[int, int], focal_px: float) -> Array | None:
    """Corners (N, 2) on the plane before an equidistant lens; None: one is beside it."""
    offset = (corners.picture_px - np.array(size_px) / 2) / focal_px
    theta = np.hypot(*offset.T)
    if np.any(theta > np.radians(MOST_THETA_DEG)):
        return None
    scale = np.tan(theta) / np.maximum(theta, 1e-9)
    return np.asarray(offset * scale[:, None])


def _start_error(pictures: Sequence[Corners], size_px: tuple[int, int], field_deg: float) -> float:
    """How badly boards look flat through an equidistant lens of this field of view."""
    errors = []
    for corners in pictures:
        plane = _plane(corners, size_px, _focal(size_px, field_deg))
        if plane is None:
            return np.inf
        homography, _ = cv2.findHomography(corners.board[:, :2], plane)
        if homography is None:
            return np.inf
        seen = cv2.perspectiveTransform(corners.board[None, :, :2], homography)[0]
        # In angles: far off the axis the plane stretches everything.
        stretch = 1 + np.sum(plane**2, axis=1)
        errors.append(np.mean(np.hypot(*(seen - plane).T) / stretch))
    return float(np.median(errors))


def _calibrate(
    pictures: Sequence[Corners], size_px: tuple[int, int], focal_px: float
) -> tuple[Lens, list[float]]:
    """OpenCV's calibration from a start; gives the lens and each picture's RMS in pixels."""
    matrix: Any = np.array(
        [[focal_px, 0, size_px[0] / 2 - 0.5], [0, focal_px, size_px[1] / 2 - 0.5], [0, 0, 1]]
    )
    k: Any = np.zeros((4, 1))
    board = [c.board.reshape(1, -1, 3).astype(np.float64) for c in pictures]
    seen = [(c.picture_px - 0.5).reshape(1, -1, 2).astype(np.float64) for c in pictures]
    flags = (
        _FLAGS.CALIB_RECOMPUTE_EXTRINSIC | _FLAGS.CALIB_FIX_SKEW | _FLAGS.CALIB_USE_INTRINSIC_GUESS
    )
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-9)
    try:
        _, matrix, k, turns, shifts = cv2.fisheye.calibrate(
            board, seen, size_px, matrix, k, flags=flags, criteria=stop
        )
    except cv2.error:
        raise LensError(
            "calibrate: lens: no lens explains the pictures: take some with the board near the "
            "edges and tilted, and none with it beyond 85 degrees off the axis"
        ) from None
    rms, farthest = [], 0.0
    for points, places, turn, shift in zip(board, seen, turns, shifts, strict=True):
        again, _ = cv2.fisheye.projectPoints(points, turn, shift, matrix, k)
        rms.append(float(np.sqrt(np.mean(np.sum((again - places) ** 2, axis=-1)))))
        rotated = points[0] @ cv2.Rodrigues(turn)[0].T + shift.reshape(3)
        theta = np.arctan2(np.hypot(rotated[:, 0], rotated[:, 1]), rotated[:, 2])
        farthest = max(farthest, float(np.degrees(theta.max())))
    k1, k2, k3, k4 = (float(value) for value in k.ravel())
    lens = Lens(
        centre_px=(float(matrix[0, 2]) + 0.5, float(matrix[1, 2]) + 0.5),
        focal_px=(float(matrix[0, 0]), float(matrix[1, 1])),
        k=(k1, k2, k3, k4), max_theta_deg=farthest,
    )  # fmt: skip
    return lens, rms


def _covered(places_px: Array, lens: Lens, size_px: tuple[int, int]) -> float:
    """Mean over 12 sectors of how far out corners reach, of the way to the picture's edge."""
    offset = places_px - np.array(lens.centre_px)
    sector = ((np.degrees(np.arctan2(offset[:, 1], offset[:, 0])) % 360) // 30).astype(int)
    reach = np.hypot(*offset.T) / (min(size_px) / 2)
    return float(np.mean([min(reach[sector == k].max(initial=0), 1.0) for k in range(12)]))
