"""What the printed board shows of the light: its white paper and its toner, cell by cell."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.calibrate.lens_board import Board
from lightprobe.geometry import Array
from lightprobe.imaging.ball import Pinhole
from lightprobe.probe import board as boards

#: Of office paper and of toner: the share of light that they reflect; and 1 sigma of the paper's,
#: of it.
PAPER, TONER = 0.8, 0.04
PAPER_SIGMA = 0.1


def squares_per_px(pinhole: Pinhole, pose: boards.Pose, board: Board) -> float:
    """How much of the board a pixel covers in its middle, in squares."""
    middle = pose.corner + np.array([board.columns / 2, 0, board.rows / 2]) @ pose.rotation
    return float(np.linalg.norm(middle) / np.sqrt(pinhole.fx_px * pinhole.fy_px))


def printed(
    board: Board, cell: float, across: int, down: int, edge: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which cells are white paper, and which are toner, away from the borders between them."""
    per_square = 40
    grey = board.draw(per_square)
    row = np.minimum(((np.arange(down) + 0.5) * cell * per_square).astype(int), grey.shape[0] - 1)
    column = np.minimum(
        ((np.arange(across) + 0.5) * cell * per_square).astype(int), grey.shape[1] - 1
    )
    cells = grey[np.ix_(row, column)]
    side = 2 * int(np.ceil(edge / cell)) + 1
    kernel = np.ones((side, side), np.uint8)
    white, black = (
        cv2.erode(
            np.asarray(part, np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0.0
        ).astype(bool)
        for part in (cells > 127, cells <= 127)
    )
    return white, black


def looked_up(picture: NDArray[np.float32], at_px: NDArray[np.float32], beyond: float) -> Array:
    """Values of a picture between its pixels; `beyond` outside of it."""
    column, row = (np.ascontiguousarray(at_px[..., axis]) for axis in (0, 1))
    found = cv2.remap(
        picture, column, row, cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT, borderValue=(beyond,) * 4,
    )  # fmt: skip
    return np.asarray(found, np.float64)
