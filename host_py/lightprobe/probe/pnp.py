"""Where known points are before a camera, by their places in its picture."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from lightprobe.geometry import Array
from lightprobe.imaging.ball import Pinhole

#: From the axes of OpenCV's camera (+Y down, +Z ahead) to ours (+Y up, −Z ahead).
FROM_OPENCV = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, eq=False)
class Solved:
    """A pose in the axes of OpenCV's camera."""

    matrix: Array  # (3, 3) turns the points' axes into the camera's
    shift: Array  # (3,) where their origin is
    off_px: float  # RMS of what the places differ by
    sigma_deg: float  # 1 sigma of the rotation, about its worst axis


def solve(
    points: Array, places_px: Array, pinhole: Pinhole, method: int, sigma_px: float
) -> Solved | None:
    """The pose of points (N, 3) that are seen at places (N, 2); None: there is none.

    `method`: of OpenCV's solvePnP; `sigma_px`: 1 sigma of a place at least.
    """
    distortion = np.asarray(pinhole.distortion or (0.0,) * 4)
    camera = pinhole.matrix
    try:
        found, turn, shift = cv2.solvePnP(points, places_px, camera, distortion, flags=method)
        if not found:
            return None
        turn, shift = cv2.solvePnPRefineLM(points, places_px, camera, distortion, turn, shift)
        seen, slopes = cv2.projectPoints(points, turn, shift, camera, distortion)
        off = seen.reshape(-1, 2) - places_px
        off_px = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
        noise_px = max(off_px, sigma_px)
        covariance = noise_px**2 * np.linalg.inv(slopes[:, :6].T @ slopes[:, :6])[:3, :3]
        sigma_deg = float(np.degrees(np.sqrt(np.linalg.eigvalsh(covariance)[-1])))
    except (cv2.error, np.linalg.LinAlgError, ValueError):  # a camera that cannot be
        return None
    matrix = Rotation.from_rotvec(np.ravel(turn)).as_matrix()
    if not np.isfinite([off_px, sigma_deg, *np.ravel(shift)]).all():
        return None
    return Solved(matrix, np.ravel(shift), off_px, sigma_deg)
