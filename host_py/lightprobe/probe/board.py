"""How the camera stands to a printed board (ChArUco, `lightprobe calibrate lens --draw`).

The probe frame is the board's: +X to the right on the paper, +Y out of the paper, −Z up on it. So a
board that lies on a table has +Y up, and what stands at its upper edge is ahead.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.calibrate.lens_board import Board
from lightprobe.geometry import Array
from lightprobe.imaging.ball import Pinhole
from lightprobe.probe import pnp
from lightprobe.probe.kinds import ProbeError

#: From OpenCV's board (+X right, +Y down on the paper, +Z into it) to the probe frame.
_TO_PROBE = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
_CORNER_SIGMA_PX = 0.1
#: Corners that fit worse than this, RMS and relative to a square's side, contradict each other.
_MOST_PX, _MOST_SHARE = 1.5, 0.06


@dataclass(frozen=True, eq=False)
class Pose:
    """Where the camera is over the board."""

    rotation: Array  # (3, 3) camera frame → probe frame
    corner: Array  # (3,) the board's upper left corner, camera frame, in squares
    sigma_deg: float  # 1 sigma of the rotation about its worst axis

    def plane_squares(self, axis: Array) -> float:
        """How far along the ray `axis` (3,), camera frame, the board's plane is, in squares."""
        up = self.rotation[1]
        return float((self.corner @ up) / (axis @ up))


def find(picture: NDArray[np.uint8], pinhole: Pinhole, board: Board) -> Pose | None:
    """Find the board in a grey picture (H, W); None: it is not there.

    Raises ProbeError for a mirrored board, and for corners that contradict each other.
    """
    corners = board.find(picture)
    if corners is None:
        if board.find(np.ascontiguousarray(picture[:, ::-1])) is not None:
            raise ProbeError(
                "the board is mirrored: print it as it is, and use pictures that the camera did "
                "not mirror (selfie cameras often do)"
            )
        return None
    solved = pnp.solve(
        np.asarray(corners.board, np.float64), np.asarray(corners.picture_px, np.float64),
        pinhole, cv2.SOLVEPNP_IPPE, _CORNER_SIGMA_PX,
    )  # fmt: skip
    off_px = solved.off_px if solved else np.inf
    ahead = max(float(solved.shift[2]), 1e-9) if solved else 1.0
    side_px = np.sqrt(pinhole.fx_px * pinhole.fy_px) / ahead
    if solved is None or not off_px < max(_MOST_PX, _MOST_SHARE * side_px):
        raise ProbeError(
            f"the corners of the board contradict each other by {off_px:.1f} pixels: is it flat, "
            "is it the only one in the picture, and are --intrinsics those of this camera?"
        )
    return Pose(
        rotation=_TO_PROBE @ solved.matrix.T @ pnp.FROM_OPENCV,
        corner=pnp.FROM_OPENCV @ solved.shift,
        sigma_deg=solved.sigma_deg,
    )
