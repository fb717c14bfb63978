"""How the simulated probe is turned, and where it is, over time.

An orientation is one rotation everywhere in the simulator: a unit quaternion w, x, y, z that turns
a direction in the camera's frame into the scene's. What the camera sees at d, the scene shows at
`geometry.rotate(rotation, d)`; the scene's light turns into the camera's frame by the inverse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lightprobe import geometry
from lightprobe.geometry import Array

#: Keys of a track that are closer than this (radians, as vectors of four) are mixed linearly.
_SAME_RAD = 1e-6


def turned(yaw_deg: ArrayLike = 0.0, nod_deg: ArrayLike = 0.0, roll_deg: ArrayLike = 0.0) -> Array:
    """Rotation (…, 4) of a probe by angles that are broadcast, each about its own axis.

    By `yaw_deg` to its left, so that the scene moves to the right; then it looks up by `nod_deg`;
    then its right side goes down by `roll_deg`.
    """
    left, up, down = (
        (np.cos(half), np.sin(half))
        for half in np.radians(np.broadcast_arrays(yaw_deg, nod_deg, roll_deg)) / 2
    )
    still = np.zeros_like(left[0])
    about_y = np.stack([left[0], still, left[1], still], axis=-1)
    about_x = np.stack([up[0], up[1], still, still], axis=-1)
    about_ahead = np.stack([down[0], still, still, -down[1]], axis=-1)
    return geometry.turn_after(about_y, geometry.turn_after(about_x, about_ahead))


def angles_deg(rotation: ArrayLike) -> tuple[float, float, float]:
    """Yaw −180…180, nod −90…90 and roll −180…180 of one rotation; see :func:`turned`."""
    matrix = geometry.rotation_matrix(rotation)
    yaw = np.arctan2(matrix[0, 2], matrix[2, 2])
    nod = np.arcsin(np.clip(-matrix[1, 2], -1, 1))
    roll = -np.arctan2(matrix[1, 0], matrix[1, 1])
    return float(np.degrees(yaw)), float(np.degrees(nod)), float(np.degrees(roll))


def is_level(rotations: ArrayLike) -> bool:
    """Tell whether rotations (…, 4) turn about the vertical alone."""
    q = np.asarray(rotations)
    return not (q[..., 1].any() or q[..., 3].any())


def level_yaw_deg(rotations: ArrayLike) -> Array:
    """Yaw (…), −180…180, of rotations about the vertical."""
    q = np.asarray(rotations, dtype=np.float64)
    yaw_deg = np.degrees(2 * np.arctan2(q[..., 2], q[..., 0]))
    return np.asarray((yaw_deg + 180) % 360 - 180)


def way_deg(rotations: Array) -> float:
    """Sum of the angles from each rotation (N, 4) to the next."""
    steps = geometry.turn_after(rotations[1:], geometry.inverse(rotations[:-1]))
    halves = np.arctan2(np.linalg.norm(steps[:, 1:], axis=-1), np.abs(steps[:, 0]))
    return float(np.degrees(2 * halves.sum()))


@dataclass(frozen=True, eq=False)
class Track:
    """A motion by its keys, as recorded from a head.

    Between keys rotations go the shortest way at an even rate (slerp), and places straight. From
    the last key the motion goes back as it came, and forth again, so that it never jumps.
    """

    t_s: Array  # (N,) of the keys, rising from 0
    rotations: Array  # (N, 4)
    places_m: Array  # (N, 3) in the scene's frame
    name: str = "path"  # for messages

    @property
    def is_level(self) -> bool:
        """Tell whether it turns about the vertical alone."""
        return is_level(self.rotations)

    @property
    def moves(self) -> bool:
        """Tell whether it goes anywhere."""
        return bool(self.places_m.any())

    def rotation(self, t_s: ArrayLike) -> Array:
        """Rotations (…, 4) at times (…)."""
        key, share = self._between(t_s)
        first, second = self.rotations[key], self.rotations[np.minimum(key + 1, len(self.t_s) - 1)]
        second = np.where(np.sum(first * second, axis=-1, keepdims=True) < 0, -second, second)
        angle = 2 * np.arctan2(
            np.linalg.norm(second - first, axis=-1), np.linalg.norm(second + first, axis=-1)
        )
        near = angle < _SAME_RAD
        sine = np.where(near, 1, np.sin(angle))
        before = np.where(near, 1 - share, np.sin((1 - share) * angle) / sine)
        after = np.where(near, share, np.sin(share * angle) / sine)
        return np.asarray(before[..., None] * first + after[..., None] * second)

    def place_m(self, t_s: ArrayLike) -> Array:
        """Places (…, 3) at times (…)."""
        key, share = self._between(t_s)
        first, second = self.places_m[key], self.places_m[np.minimum(key + 1, len(self.t_s) - 1)]
        return np.asarray(first + share[..., None] * (second - first))

    def _between(self, t_s: ArrayLike) -> tuple[Array, Array]:
        """Key before each time, and the share of the way to the next one."""
        end_s = self.t_s[-1]
        t = np.asarray(t_s, dtype=np.float64)
        if not end_s:
            return np.zeros(t.shape, int), np.zeros(t.shape)
        there = t % (2 * end_s)
        there = np.where(there > end_s, 2 * end_s - there, there)
        key = np.clip(np.searchsorted(self.t_s, there, side="right") - 1, 0, len(self.t_s) - 2)
        return key, (there - self.t_s[key]) / (self.t_s[key + 1] - self.t_s[key])
