"""How cameras are turned in one box: by how they turn together, and by what two of them see.

While the box turns, each camera's pictures tell how it turns (the daemon's visual orientation);
hand-eye calibration gives its rotation against the first one (:mod:`lightprobe.align.hand_eye`).
Pictures of the box at rest refine it where lenses overlap
(:mod:`lightprobe.calibrate.rig_overlap`). Both are weighed by their covariances, and must not
contradict each other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from lightprobe.align import hand_eye
from lightprobe.align.hand_eye import TURN_S
from lightprobe.align.track import AlignError, Track
from lightprobe.calibrate import rig_overlap
from lightprobe.calibrate.rig_overlap import LEAST_POINTS, View
from lightprobe.errors import LightprobeError
from lightprobe.geometry import Array

#: RMS of turns in :data:`~lightprobe.align.hand_eye.TURN_S`: about the main axis, and besides it.
LEAST_TURN_DEG, LEAST_OFF_AXIS_DEG = 2.0, 1.0
#: What the scatter does not show, 1 sigma about each axis: rows that are read one after the other
#: while the box turns, and a map of half a sphere; of overlaps: lenses blur askew near their rim.
_TURNING_SYSTEMATIC_DEG, _OVERLAP_SYSTEMATIC_DEG = 0.3, 0.08
#: So many sigmas of turning off, overlaps are tried, too: what they then tell must be the same.
_ASTRAY = 1.5
#: Square of the distance, in sigmas, at which both contradict each other: 1 in 1000 of good ones.
_CONTRADICTION = 16.3
#: Frames of both are stamped by one clock. Motion that is repeated, or turned back, would agree at
#: other times, and tell a wrong rotation.
_LATEST_S = 0.5
_TURN = "turn the box for half a minute, left and right and up and down, not too fast"


class RigError(LightprobeError):
    """The pictures do not tell the rotations."""


@dataclass(frozen=True, eq=False)
class Turned:
    """Rotation of a camera against the first, and how well it is known."""

    rotation: Rotation  # from its camera file's frame to that of the first
    covariance: Array  # (3, 3) of a turn in degrees, in the first one's frame

    @property
    def sigma_deg(self) -> float:
        """1 sigma about the axis known worst."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance)[-1]))


@dataclass(frozen=True, eq=False)
class Found:
    """What is known of a camera in the end."""

    turned: Turned
    by_turning: Turned
    by_overlap: Turned | None  # None: only turning was used
    time_offset_s: float  # by which its frames are stamped later than the first one's

    @property
    def changed_deg(self) -> float:
        """How far its camera file was off."""
        return float(np.degrees(self.turned.rotation.magnitude()))


def solve(names: Sequence[str], tracks: Sequence[Track], views: Sequence[View]) -> list[Found]:
    """Find the rotation of every camera but the first.

    `tracks`: of each camera's own frame; `views`: of all lenses, of the box at rest, or none: then
    only turning counts. Raises :class:`RigError` that names camera, stage and next step.
    """
    hands = [_by_turning(names, tracks, k) for k in range(1, len(names))]
    turned = [
        Turned(hand.rotation, _square(hand.sigma_deg) + _square(_TURNING_SYSTEMATIC_DEG))
        for hand in hands
    ]
    overlaps = _by_overlap(names, views, turned) if views else [None] * len(turned)
    return [
        Found(
            one if other is None else _merged(names[k], one, other), one, other,
            -hands[k - 1].time_offset_s,
        )
        for k, (one, other) in enumerate(zip(turned, overlaps, strict=True), 1)
    ]  # fmt: skip


def _square(sigma_deg: float) -> Array:
    return sigma_deg**2 * np.eye(3)


def _by_turning(names: Sequence[str], tracks: Sequence[Track], number: int) -> hand_eye.HandEye:
    for k in (0, number):
        _require_turning(names[k], tracks[k])
    try:
        return hand_eye.solve(tracks[0], tracks[number], latest_s=_LATEST_S)
    except AlignError as error:
        raise RigError(
            f"rig: {names[number]}: turning: it does not turn as {names[0]} does: is it fixed in "
            f"the box, and does each source have its own camera file? {_TURN} ({error})"
        ) from None


def _require_turning(name: str, track: Track) -> None:
    turns = track.turns_deg(np.arange(0, max(track.duration_s - TURN_S, 0), 0.05), TURN_S)
    turns = turns[np.isfinite(turns).all(axis=1)]
    if len(turns) < 3:
        raise RigError(f"rig: {name}: turning: only {track.duration_s:.1f} s of it: {_TURN}")
    main, second, _ = np.linalg.svd(turns, compute_uv=False) / np.sqrt(len(turns))
    if main < LEAST_TURN_DEG:
        raise RigError(
            f"rig: {name}: turning: too little, {main:.1f}° in {TURN_S:g} s (RMS), at least "
            f"{LEAST_TURN_DEG:g}° are needed: {_TURN}"
        )
    if second < LEAST_OFF_AXIS_DEG:
        raise RigError(
            f"rig: {name}: turning: about one axis only, besides it {second:.1f}° in {TURN_S:g} s "
            f"(RMS), at least {LEAST_OFF_AXIS_DEG:g}° are needed: {_TURN}"
        )


def _by_overlap(
    names: Sequence[str], views: Sequence[View], turned: Sequence[Turned]
) -> list[Turned]:
    overlap = rig_overlap.align(views, [Rotation.identity(), *(one.rotation for one in turned)])
    elsewhere = [
        rig_overlap.align(views, [Rotation.identity(), *start]) for start in _starts(turned)
    ]
    found = []
    for k in range(1, len(names)):
        shared = [n for pair, n in overlap.points.items() if k in pair]
        block = slice(3 * k - 3, 3 * k)
        covariance = overlap.covariance[block, block]
        if max(shared, default=0) < LEAST_POINTS or not np.isfinite(covariance).all():
            raise RigError(
                f"rig: {names[k]}: overlap: its lens sees next to nothing that another one sees, "
                "or nothing with edges: lenses of more than 180 degrees overlap; their "
                "max_theta_deg and mask say how far they are used; show a furnished room; or "
                "take --turning-only, and have less certain rotations"
            )
        apart = np.stack(
            [(one.rotations[k] * overlap.rotations[k].inv()).as_rotvec() for one in elsewhere]
        )
        ambiguity = np.degrees(apart).T @ np.degrees(apart) / len(elsewhere)
        known = covariance + ambiguity + _square(_OVERLAP_SYSTEMATIC_DEG)
        found.append(Turned(overlap.rotations[k], known))
    return found


def _starts(turned: Sequence[Turned]) -> Iterator[list[Rotation]]:
    """Where else the cameras may stand by what turning tells: small or plain pictures agree with
    the first one's in more than one place.
    """
    for axis in np.eye(3):
        for sign in (1, -1):
            yield [
                Rotation.from_rotvec(sign * _ASTRAY * one.sigma_deg * axis, degrees=True)
                * one.rotation
                for one in turned
            ]


def _merged(name: str, one: Turned, other: Turned) -> Turned:
    """Both, weighed by how well they are known."""
    apart = np.degrees((other.rotation * one.rotation.inv()).as_rotvec())
    if apart @ np.linalg.solve(one.covariance + other.covariance, apart) > _CONTRADICTION:
        raise RigError(
            f"rig: {name}: overlap: it contradicts the turning by {np.linalg.norm(apart):.1f}°: "
            "hold the box still while pictures are taken, with nothing nearer than two metres "
            "beside it; or take --turning-only"
        )
    gain = one.covariance @ np.linalg.inv(one.covariance + other.covariance)
    step = Rotation.from_rotvec(gain @ apart, degrees=True)
    return Turned(step * one.rotation, (np.eye(3) - gain) @ one.covariance)
