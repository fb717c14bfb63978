"""Roll-off of a lens (vignetting) from pictures of a steady place by a camera that is turned.

Every place of the room is seen at several angles off the axis. Its own radiance, which may be as
uneven as it likes, is an unknown; so is each picture's gain. What remains between pictures is the
lens (after Goldman, "Vignette and exposure calibration and compensation", 2010; here with known
directions, in logarithms, so that all unknowns are linear):

    ln L = ln radiance(place) + ln gain(picture) + b1·θ² + b2·θ⁴ + b3·θ⁶ + b4·θ⁸
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.errors import LightprobeError
from lightprobe.geometry import Array, angle_deg, rotate
from lightprobe.imaging.camera import Camera, Lens

Codes = NDArray[np.uint8]
Value = TypeVar("Value", np.uint8, np.float64, np.bool_)
#: Picture, cell, angle off the axis and logarithm of the level, (N,) each.
Rows = tuple[NDArray[np.intp], NDArray[np.intp], Array, Array]

LEAST_PICTURES = 6
#: Blocks of pixels that are averaged: so many across the picture. Of each the darkest and the
#: brightest pixel must be within these codes, and its spread below this share of its mean.
_BLOCKS, _CODES, _MOST_SPREAD = 160, (12, 243), 0.12
#: Pixels beside the picture's dark corners are left out: JPEG mixes blocks of 16.
_RIM_PX = 16
#: Cells of the sphere, all of one size: rows (even in the sine of the elevation) and columns.
_ROWS, _COLUMNS = 48, 96
_TERMS = 4
#: Differences beyond this, of the logarithm, count less (Huber): things that moved, parallax.
_ROBUST, _ITERATIONS, _AGAIN = 0.02, 10, 2
#: A place tells something when it was seen at angles that differ by so much.
_LEAST_SPREAD_RAD, _LEAST_CELLS = 0.15, 150
#: Beyond what was seen nothing is known: so much of the lens' field must have been.
_LEAST_REACH = 0.9
_MOST_SIGMA = 0.05
#: Of the room, by azimuth: each is left out once, to see how well the rest tells the roll-off.
_PARTS = 8
_ANGLES = 200


class RollOffError(LightprobeError):
    """Pictures that do not tell the roll-off; says why, and what to do."""


@dataclass(frozen=True, eq=False)
class RollOff:
    """Relative illumination 1 + a1·θ² + a2·θ⁴ + a3·θ⁶ of one lens."""

    rolloff: tuple[float, float, float]
    sigma: float  # 1 sigma at the worst angle that was seen, relative
    misfit: float  # of the polynomial to what was found, relative, at the worst angle
    at_rim: float  # relative illumination at max_theta_deg
    seen_deg: float  # the farthest off the axis
    scatter: float  # of places between pictures, relative, median
    cells: int


def fit(pictures: Sequence[Codes], turned: Sequence[Array], camera: Camera, number: int) -> RollOff:
    """Fit lens `number` to RGB pictures of one size and their rotations; raises RollOffError."""
    lens = camera.lenses[number]
    rows = _observations(pictures, turned, camera, number)
    if rows is None:
        raise RollOffError(_too_little(number, "no place is seen twice at different angles"))
    picture, cell, theta, level = rows
    b, error = _solve(rows, len(pictures), np.ones(len(cell)), _ITERATIONS)
    most = float(np.percentile(theta, 99.9))
    seen_deg = float(np.degrees(most))
    if seen_deg < _LEAST_REACH * lens.max_theta_deg:
        raise RollOffError(
            _too_little(number, f"places are seen up to {seen_deg:.0f} degrees off its axis, and "
                        f"it is used to {lens.max_theta_deg:g}")
        )  # fmt: skip
    angles = np.linspace(0, most, _ANGLES)
    terms = _terms(angles)
    parts = []  # jackknife over parts of the room: errors of neighbouring places are alike
    for part in range(_PARTS):
        rest = cell % _COLUMNS * _PARTS // _COLUMNS != part
        less = picture[rest], cell[rest], theta[rest], level[rest]
        parts.append(terms @ _solve(less, len(pictures), _weight(error[rest]), _AGAIN)[0])
    sigma = float(np.sqrt((_PARTS - 1) * np.var(parts, axis=0)).max())
    if not sigma < _MOST_SIGMA:
        raise RollOffError(
            _too_little(number, f"its roll-off is known to {100 * sigma:.0f} % only")
        )
    scatter = float(np.median(np.abs(error)))
    return _as_polynomial(angles, terms @ b, lens, sigma, scatter, len(np.unique(cell)))


def _too_little(number: int, what: str) -> str:
    return (
        f"calibrate: roll-off: lens.{number}: {what}: take more pictures, each turned by about 15 "
        "degrees, once around and also up and down, with large even surfaces that do not clip"
    )


def _blocks(values: NDArray[Value], size: int) -> NDArray[Value]:
    """Blocks (rows, columns, size², …) of a picture (H, W, …); what is over is cut."""
    rows, columns = values.shape[0] // size, values.shape[1] // size
    cut = values[: rows * size, : columns * size]
    tiles = cut.reshape(rows, size, columns, size, *values.shape[2:]).swapaxes(1, 2)
    return tiles.reshape(rows, columns, size * size, *values.shape[2:])


def _observations(
    pictures: Sequence[Codes], turned: Sequence[Array], camera: Camera, number: int
) -> Rows | None:
    """What each picture shows of each cell.

    Only of cells that were seen at angles that differ; None: there are too few.
    """
    height, width = pictures[0].shape[:2]
    size = max(2, width // _BLOCKS)
    table = camera.response_table()
    directions, illumination = camera.look(width, height)
    owner = camera.owner(width, height)
    inside = ((illumination > 0) & (owner == number)).astype(np.uint8)
    inside = cv2.erode(inside, np.ones((2 * _RIM_PX + 1,) * 2, np.uint8), borderValue=1)
    usable = _blocks(inside > 0, size).all(axis=2)
    middle = np.asarray(np.nan_to_num(_blocks(directions, size)).mean(axis=2))
    middle /= np.maximum(np.linalg.norm(middle, axis=2, keepdims=True), 1e-9)
    theta = _theta(middle, camera.lenses[number])
    parts = []
    for index, (codes, turn) in enumerate(zip(pictures, turned, strict=True)):
        tiles = _blocks(codes, size)
        light = np.stack([table[tiles[..., c], c] for c in range(3)], axis=-1).mean(axis=-1)
        mean = light.mean(axis=2)
        good = usable & (tiles.min(axis=(2, 3)) >= _CODES[0])
        good &= (tiles.max(axis=(2, 3)) <= _CODES[1]) & (light.std(axis=2) < _MOST_SPREAD * mean)
        cells = _cell(middle[good] @ turn.T)
        count = np.bincount(cells, minlength=_ROWS * _COLUMNS)
        there = np.flatnonzero(count)
        logs = np.bincount(cells, np.log(mean[good]), len(count))[there] / count[there]
        angles = np.bincount(cells, theta[good], len(count))[there] / count[there]
        parts.append((np.full(len(there), index), there, angles, logs))
    picture, cell, angle, level = (np.concatenate(column) for column in zip(*parts, strict=True))
    low = np.full(_ROWS * _COLUMNS, np.inf)
    high = np.full(_ROWS * _COLUMNS, -np.inf)
    np.minimum.at(low, cell, angle)
    np.maximum.at(high, cell, angle)
    tells = (high - low > _LEAST_SPREAD_RAD)[cell]
    if len(np.unique(cell[tells])) < _LEAST_CELLS:
        return None
    return picture[tells], cell[tells], angle[tells], level[tells]


def _theta(directions: Array, lens: Lens) -> Array:
    """Angles off the lens' axis of directions (…, 3) of the probe frame."""
    axis = rotate(lens.rotation_wxyz, [0.0, 0.0, -1.0])
    return np.radians(angle_deg(directions, axis))


def _cell(directions: Array) -> NDArray[np.intp]:
    """Number of the cell that directions (N, 3) fall into."""
    row = np.clip(((directions[:, 1] + 1) / 2 * _ROWS).astype(int), 0, _ROWS - 1)
    around = np.arctan2(directions[:, 0], -directions[:, 2]) / (2 * np.pi) + 0.5
    return np.asarray(row * _COLUMNS + (around * _COLUMNS).astype(int) % _COLUMNS)


def _terms(theta: Array) -> Array:
    return np.asarray(theta[:, None] ** (2 * np.arange(1, _TERMS + 1)))


def _weight(error: Array) -> Array:
    return np.asarray(1 / np.maximum(np.abs(error) / _ROBUST, 1))


def _solve(rows: Rows, count: int, weight: Array, iterations: int) -> tuple[Array, Array]:
    """b (_TERMS,) and errors (N,), from weights to start with; cells are eliminated."""
    picture, cell, theta, level = rows
    _, cell = np.unique(cell, return_inverse=True)
    gains = np.eye(count)[picture][:, 1:]  # the first picture's is 1
    columns = np.column_stack([_terms(theta), gains, level]).T
    for _ in range(iterations):
        total = np.bincount(cell, weight)
        means = np.stack([np.bincount(cell, weight * column) / total for column in columns])
        *left, right = columns - means[:, cell]
        matrix = np.stack(left)
        weighed = matrix * weight
        found = np.linalg.lstsq(weighed @ matrix.T, weighed @ right, rcond=None)[0]
        error = right - found @ matrix
        weight = _weight(error)
    return found[:_TERMS], error


def _as_polynomial(
    angles: Array, logs: Array, lens: Lens, sigma: float, scatter: float, cells: int
) -> RollOff:
    """What a camera file holds, with the least relative error."""
    found = np.exp(logs)
    terms = angles[:, None] ** np.array([2, 4, 6])
    weights = np.sin(angles)  # solid angle
    a, *_ = np.linalg.lstsq(
        terms / found[:, None] * weights[:, None], (found - 1) / found * weights, rcond=None
    )
    misfit = np.abs((1 + terms @ a) / found - 1).max()
    rim = np.radians(lens.max_theta_deg)
    at_rim = float(1 + rim ** np.array([2, 4, 6]) @ a)
    if at_rim <= 0.02:
        raise RollOffError(
            f"calibrate: roll-off: the lens is dark at {lens.max_theta_deg:g} degrees off its "
            "axis: calibrate it to a smaller angle, lightprobe calibrate lens --max-theta-deg"
        )
    a1, a2, a3 = (float(value) for value in a)
    return RollOff(
        (a1, a2, a3), sigma, float(misfit), at_rim, float(np.degrees(angles[-1])), scatter, cells
    )
