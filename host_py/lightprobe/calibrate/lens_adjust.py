"""A lens and the poses of a board together, by least squares (bundle adjustment).

The lens is that of camera files: r = f·(θ + k1·θ³ + k2·θ⁵ + k3·θ⁷ + k4·θ⁹), OpenCV's fisheye model
(Kannala and Brandt 2006). OpenCV's own calibration of it has no place for corners beyond 90 degrees
off the axis, because it undistorts them onto a plane. Here corners are projected, to any angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation

from lightprobe.calibrate.lens_board import Corners
from lightprobe.geometry import Array
from lightprobe.imaging.camera import Lens

#: cx, cy, fx, fy, k1 … k4; then rotation vector and shift of each picture.
_OF_LENS, _OF_POSE = 8, 6
_SCALES = np.array([100, 100, 100, 100, 0.1, 0.1, 0.1, 0.1])
#: Corners farther off than this count less: a marker that was read wrongly is no Gaussian error.
_ROBUST_PX = 0.5
_MOST_EVALUATIONS = 300


@dataclass(frozen=True, eq=False)
class Adjusted:
    """A lens, and how it explains the corners."""

    lens: Lens  # max_theta_deg: the farthest corner off the axis
    picture_rms_px: tuple[float, ...]  # distance of corners
    covariance: Array  # (8, 8) of cx, cy, fx, fy, k1 … k4; squares of what is 1 sigma


def adjust(pictures: Sequence[Corners], size_px: tuple[int, int], focal_px: float) -> Adjusted:
    """Fit from an equidistant lens of this focal length in the middle of the picture."""
    start = np.zeros(_OF_LENS + _OF_POSE * len(pictures))
    start[:4] = size_px[0] / 2, size_px[1] / 2, focal_px, focal_px
    poses = start[_OF_LENS:].reshape(-1, _OF_POSE)
    for pose, corners in zip(poses, pictures, strict=True):
        pose[:] = pose_of(corners, rays(corners, size_px, focal_px))
    problem = _Problem(pictures)
    scales = np.concatenate([_SCALES, np.ones(len(start) - _OF_LENS)])
    found = least_squares(
        problem.errors_px, start, jac_sparsity=problem.sparsity(), x_scale=scales,
        loss="soft_l1", f_scale=_ROBUST_PX, max_nfev=_MOST_EVALUATIONS,
    )  # fmt: skip
    return problem.result(found.x, found.jac.toarray())


def rays(corners: Corners, size_px: tuple[int, int], focal_px: float) -> Array:
    """Directions (N, 3), x right, y down, z forward, that an equidistant lens gives corners."""
    offset = (corners.picture_px - np.array(size_px) / 2) / focal_px
    theta = np.hypot(*offset.T)
    sideways = offset * np.sinc(theta / np.pi)[:, None]
    return np.column_stack([sideways, np.cos(theta)])


def pose_of(corners: Corners, directions: Array) -> Array:
    """Rotation vector and shift (6,) of a board whose corners are seen in these directions."""
    middle = directions.mean(axis=0)
    to_front, _ = Rotation.align_vectors([[0.0, 0, 1]], [middle / np.linalg.norm(middle)])
    ahead = to_front.apply(directions)
    plane = ahead[:, :2] / np.maximum(ahead[:, 2:], 0.05)  # the board fills less than all in front
    homography, _ = cv2.findHomography(corners.board[:, :2], plane)
    if homography is None:
        homography = np.diag([0.1, 0.1, 1.0])
    homography = homography / np.sqrt(np.prod(np.linalg.norm(homography[:, :2], axis=0)))
    if homography[2, 2] < 0:
        homography = -homography
    across, down, shift = homography.T
    left, _, right = np.linalg.svd(np.column_stack([across, down, np.cross(across, down)]))
    turn = to_front.inv() * Rotation.from_matrix(left @ right)
    return np.concatenate([turn.as_rotvec(), to_front.inv().apply(shift)])


def rms_px_of(lens: Lens, corners: Corners, turn: Array, shift: Array) -> float:
    """Distance of one picture's corners, at a pose of the board (3,), (3,), through a lens."""
    values = np.concatenate([lens.centre_px, lens.focal_px, lens.k, turn, shift])
    squares = _Problem([corners]).errors_px(values).reshape(-1, 2) ** 2
    return float(np.sqrt(np.mean(np.sum(squares, axis=1))))


class _Problem:
    """Corners of all pictures in one row."""

    def __init__(self, pictures: Sequence[Corners]) -> None:
        self._count = len(pictures)
        self._board = np.concatenate([p.board for p in pictures]).astype(np.float64)
        self._seen = np.concatenate([p.picture_px for p in pictures]).astype(np.float64)
        self._of = np.repeat(np.arange(self._count), [len(p.board) for p in pictures])

    def _towards(self, values: Array) -> tuple[Array, Array]:
        """Directions (N, 2) across the axis, of length 1, and angles (N,) off it."""
        poses = values[_OF_LENS:].reshape(-1, _OF_POSE)
        turned = Rotation.from_rotvec(poses[self._of, :3]).apply(self._board)
        places = turned + poses[self._of, 3:]
        across = np.hypot(places[:, 0], places[:, 1])
        theta = np.arctan2(across, places[:, 2])
        return places[:, :2] / np.maximum(across, 1e-12)[:, None], theta

    def errors_px(self, values: Array) -> Array:
        """From where corners were seen to where they should be, x and y in turn."""
        towards, theta = self._towards(values)
        lens = _lens(values, 0)
        projected = values[:2] + values[2:4] * lens.radius(theta)[:, None] * towards
        return np.asarray((projected - self._seen).ravel())

    def sparsity(self) -> csr_matrix:
        """Which values move which errors: the lens all, a pose those of its picture."""
        rows = np.arange(2 * len(self._of))
        of_pose = _OF_LENS + _OF_POSE * np.repeat(self._of, 2)
        columns = [np.full_like(rows, k) for k in range(_OF_LENS)]
        columns += [of_pose + k for k in range(_OF_POSE)]
        every = np.tile(rows, len(columns))
        shape = len(rows), _OF_LENS + _OF_POSE * self._count
        return csr_matrix((np.ones(len(every)), (every, np.concatenate(columns))), shape=shape)

    def result(self, values: Array, jacobian: Array) -> Adjusted:
        """Give what was found, with its uncertainty by the corners' scatter."""
        squares = np.sum(self.errors_px(values).reshape(-1, 2) ** 2, axis=1)
        per_picture = np.bincount(self._of, squares) / np.bincount(self._of)
        free = max(2 * len(squares) - len(values), 1)
        inverse = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-18, hermitian=True)
        covariance = inverse[:_OF_LENS, :_OF_LENS] * (squares.sum() / free)
        farthest = float(np.degrees(self._towards(values)[1].max()))
        return Adjusted(_lens(values, farthest), tuple(np.sqrt(per_picture).tolist()), covariance)


def _lens(values: Array, max_theta_deg: float) -> Lens:
    cx, cy, fx, fy, k1, k2, k3, k4 = (float(value) for value in values[:_OF_LENS])
    return Lens((cx, cy), (fx, fy), (k1, k2, k3, k4), max_theta_deg)


def sigma_deg(adjusted: Adjusted, theta_deg: NDArray[np.float64]) -> Array:
    """1 sigma of where pixels look, at angles (N,) off the axis; the worst direction around it."""
    lens, theta = adjusted.lens, np.radians(theta_deg)
    powers = theta[:, None] ** np.array([3, 5, 7, 9])
    radius = lens.radius(theta)
    slope = 1 + sum((2 * i + 3) * k * theta ** (2 * i + 2) for i, k in enumerate(lens.k))
    worst = np.zeros(len(theta))
    for around in np.arange(0, 2 * np.pi, np.pi / 4):
        per_value = np.zeros((len(theta), 2, _OF_LENS))
        for axis, share in enumerate((np.cos(around), np.sin(around))):
            per_value[:, axis, axis] = 1
            per_value[:, axis, 2 + axis] = radius * share
            per_value[:, axis, 4:] = lens.focal_px[axis] * powers * share
        variance = np.einsum("nai,ij,naj->n", per_value, adjusted.covariance, per_value)
        worst = np.maximum(worst, variance)
    return np.asarray(np.degrees(np.sqrt(worst) / (min(lens.focal_px) * np.abs(slope))))
