"""Orientations, and perhaps places, over time of one thing: a head, or a probe."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, Slerp

from lightprobe.errors import LightprobeError
from lightprobe.geometry import Array

#: Between samples further apart than this nothing is interpolated.
LONGEST_GAP_S = 0.25
_NOT_UNIT = 0.01
#: Samples that are not further apart are the same: clocks are mapped to each other so exactly.
_SAME_S = 1e-6


class AlignError(LightprobeError):
    """The measurements do not tell the rotation."""


@dataclass(frozen=True, eq=False)
class Track:
    """Rotations of one thing to a fixed frame of the world, at increasing times of one clock."""

    name: str  # for messages: a file, an address
    start_ns: int  # when the first was taken, by the thing's own clock
    time_s: Array  # (N,) since then
    rotation: Rotation  # N of them, thing → world
    position_m: Array | None = None  # (N, 3) in that world; NaN: not known then. None: never

    @property
    def duration_s(self) -> float:
        """From the first to the last sample."""
        return float(self.time_s[-1])

    def changed(self, change: Callable[[Rotation], Rotation]) -> Track:
        """Give the same times with other rotations."""
        return Track(self.name, self.start_ns, self.time_s, change(self.rotation), self.position_m)

    def turns_deg(self, start_s: Array, length_s: float) -> Array:
        """Rotation vectors (N, 3), in the thing's own frame, of the turns from `start_s` (N,) on.

        NaN where the track has no samples around both ends, or a gap between them.
        """
        known = self.knows(start_s, length_s)
        turns = np.full((len(start_s), 3), np.nan)
        if known.any():
            at, start_s = self._interpolated, start_s[known]
            turn = at(start_s).inv() * at(start_s + length_s)
            turns[known] = np.degrees(turn.as_rotvec())
        return turns

    def rotations(self, at_s: Array) -> Rotation:
        """Give the rotations at these times (N,), all inside the track."""
        return self._interpolated(at_s)

    def positions_m(self, at_s: Array) -> Array:
        """Give the positions (N, 3) at these times (N,), all inside the track; NaN: not known."""
        if self.position_m is None:
            return np.full((len(at_s), 3), np.nan)
        axes = [np.interp(at_s, self.time_s, along) for along in self.position_m.T]
        return np.stack(axes, axis=-1)

    @cached_property
    def _interpolated(self) -> Slerp:
        return Slerp(self.time_s, self.rotation)

    def knows(self, start_s: Array, length_s: float) -> NDArray[np.bool_]:
        """Tell of each stretch of time (N,) whether it is inside the track and without a gap."""
        end_s = start_s + length_s
        inside = (start_s >= 0) & (end_s <= self.duration_s)
        gaps = np.concatenate([[0], np.cumsum(np.diff(self.time_s) > LONGEST_GAP_S)])
        first = np.searchsorted(self.time_s, start_s, side="right") - 1
        last = np.searchsorted(self.time_s, end_s, side="left")
        top = len(self.time_s) - 1
        return np.asarray(inside & (gaps[np.clip(first, 0, top)] == gaps[np.clip(last, 0, top)]))


def make(
    name: str, time_ns: Sequence[int], rotation_xyzw: ArrayLike, position_m: Array | None = None
) -> Track:
    """Check samples and make a track of them; samples of the same moment count once.

    N times of one clock, quaternions (N, 4) of unit length, and positions (N, 3) or None; raises
    :class:`AlignError`.
    """
    if len(time_ns) < 2:
        raise AlignError(f"align: {name}: {len(time_ns)} poses: record some seconds of them")
    quaternions = np.asarray(rotation_xyzw, dtype=np.float64).reshape(-1, 4)
    finite = np.isfinite(quaternions).all(axis=1)
    if not finite.all():
        raise AlignError(
            f"align: {name}: pose {int(np.argmin(finite)) + 1} is not finite: leave out poses "
            "while tracking is lost"
        )
    length = np.linalg.norm(quaternions, axis=1)
    if (wrong := np.abs(length - 1) > _NOT_UNIT).any():
        at = int(np.argmax(wrong))
        raise AlignError(
            f"align: {name}: pose {at + 1} is no rotation: its quaternion has the length "
            f"{length[at]:.3g}; expected 1"
        )
    since = np.asarray([time - time_ns[0] for time in time_ns], dtype=np.float64) * 1e-9
    steps_s = np.diff(since)
    if (back := steps_s < -_SAME_S).any():
        at = int(np.argmax(back))
        raise AlignError(
            f"align: {name}: the time goes back by {-steps_s[at]:.3g} s after pose {at + 1}: "
            "give the poses of one session, stamped by a clock that is never set"
        )
    new = np.concatenate([[True], since[1:] > np.maximum.accumulate(since)[:-1] + _SAME_S])
    places_m = None if position_m is None else position_m[new]
    turned = Rotation.from_quat(quaternions[new])
    return Track(name, int(time_ns[0]), since[new], turned, places_m)
