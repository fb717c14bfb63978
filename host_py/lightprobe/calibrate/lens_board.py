"""A printed board of squares and markers (ChArUco), and where its corners are in pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.errors import UsageError

_MARKER_SHARE = 0.75  # of a square's side
_MARKERS = 250  # of the dictionary DICT_4X4_250
#: A picture with fewer corners says too little of its pose.
LEAST_CORNERS = 8


@dataclass(frozen=True)
class Corners:
    """What one picture shows of the board."""

    board: NDArray[np.float32]  # (N, 3) on the board, in squares; z = 0
    picture_px: NDArray[np.float32]  # (N, 2); the first pixel's centre is at (0.5, 0.5)


@dataclass(frozen=True)
class Board:
    """So many squares across and down; half of the white ones' number are markers."""

    columns: int = 11
    rows: int = 8

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (self.columns >= 4 and self.rows >= 4 and self.columns * self.rows <= 2 * _MARKERS):
            raise UsageError(
                f"calibrate: --board {self.columns}x{self.rows}: expected at least 4 squares each "
                f"way, and at most {2 * _MARKERS} in all"
            )

    @cached_property
    def _board(self) -> Any:
        markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250)
        return cv2.aruco.CharucoBoard((self.columns, self.rows), 1.0, _MARKER_SHARE, markers)

    def draw(self, square_px: int) -> NDArray[np.uint8]:
        """Give the board as a grey picture, without a margin."""
        size = (self.columns * square_px, self.rows * square_px)
        return np.asarray(self._board.generateImage(size, marginSize=0), np.uint8)

    def find(self, picture: NDArray[np.uint8]) -> Corners | None:
        """Find its corners in a picture (H, W[, 3]); None: too few are seen."""
        grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        places, numbers, _, _ = cv2.aruco.CharucoDetector(self._board).detectBoard(grey)
        if numbers is None or len(numbers) < LEAST_CORNERS:
            return None
        on_board = np.asarray(self._board.getChessboardCorners(), np.float32)
        found = on_board[numbers.ravel()]
        if len(np.unique(found[:, 0])) < 2 or len(np.unique(found[:, 1])) < 2:
            return None  # all in one line
        return Corners(found, np.asarray(places, np.float32).reshape(-1, 2) + 0.5)


def parse(text: str) -> Board:
    """Read `COLUMNSxROWS`; raises UsageError."""
    columns, _, rows = text.partition("x")
    if not (columns.isdecimal() and rows.isdecimal()):
        raise UsageError(f"calibrate: --board {text}: expected COLUMNSxROWS in squares, like 11x8")
    return Board(int(columns), int(rows))
