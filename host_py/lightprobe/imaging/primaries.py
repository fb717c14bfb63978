"""Primaries of a picture as CIE x, y of red, green, blue and white, and the way to Rec. 709."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe.geometry import Array

REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
#: Those of a picture whose samples are CIE X, Y and Z themselves.
XYZ = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)
#: Primaries that differ by less are the same.
_SAME = 2e-3
_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)


def to_rec709(primaries: ArrayLike) -> Array:
    """3×3 matrix from primaries (rx, ry, gx, gy, bx, by, wx, wy) to Rec. 709, D65.

    White is adapted by the Bradford transform (Lindbloom), so that neutral stays neutral. Not of
    CIE X, Y, Z: they state what was measured, whatever is white there. Raises ValueError for eight
    numbers that are no primaries.
    """
    c = np.asarray(primaries, dtype=np.float64)
    to_xyz = rgb_to_xyz(c)
    from_xyz = np.linalg.inv(rgb_to_xyz(REC709))
    if np.allclose(c[:6], XYZ[:6], atol=_SAME):
        return np.asarray(from_xyz @ to_xyz)
    cones = [_BRADFORD @ _white(white) for white in (c, np.asarray(REC709))]
    adapt = np.linalg.inv(_BRADFORD) @ np.diag(cones[1] / cones[0]) @ _BRADFORD
    return np.asarray(from_xyz @ adapt @ to_xyz)


def or_rec709(stated: Sequence[float]) -> tuple[float, ...]:
    """Give what a file states; zeros, as Photoshop writes them, state nothing: Rec. 709."""
    return tuple(float(number) for number in stated) if any(stated) else REC709


def is_rec709(matrix: Array) -> bool:
    """Tell whether a matrix of :func:`to_rec709` changes nothing."""
    return np.allclose(matrix, np.eye(3), atol=_SAME)


def rgb_to_xyz(primaries: ArrayLike) -> Array:
    """3×3 matrix to CIE X, Y, Z; its second row are the weights of luminance."""
    c = np.asarray(primaries, dtype=np.float64)
    if c.shape != (8,) or not np.isfinite(c).all() or c[7] <= 0:
        raise ValueError("primaries are x and y of red, green, blue and white")
    columns = np.stack([_place(c[i], c[i + 1]) for i in (0, 2, 4)], axis=1)
    if abs(np.linalg.det(columns)) < _SAME:
        raise ValueError("red, green and blue lie on one line")
    return np.asarray(columns * np.linalg.solve(columns, _white(c)))


def _place(x: float, y: float) -> NDArray[np.float64]:
    return np.array([x, y, 1 - x - y])


def _white(c: Array) -> Array:
    """Of luminance 1."""
    return np.asarray(_place(c[6], c[7]) / c[7])
