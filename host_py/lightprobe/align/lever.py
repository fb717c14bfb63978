"""Where the probe is on the head: the lever arm, from lamps seen as the head moves and turns.

The app tells how the head is turned, R, and where it is, p (metres, in its world); the probe tells
directions d of lamps in its own frame. A lamp at L is seen along L − p − R o, with the offset o
of the probe in the head's frame. L of each lamp, o, a small turn of the mount and a delay of the
poses are found together: by robust least squares (Gauss–Newton with Levenberg's damping and
Cauchy's weights), each lamp as its direction and its inverse distance from the middle of the way,
so that far lamps do no harm (Civera, Davison and Montiel, "Inverse depth parametrization for
monocular SLAM", IEEE Trans. Robotics 24(5), 2008).

What tells o: the head must turn about several axes, or o and L shift together; and it must change
its place by known metres, or only o in units of the lamps' distances follows.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lightprobe.align.track import Track
from lightprobe.geometry import Array, normalize

#: Known to so much, 1 sigma about the worst axis, an offset is told; a ruler does as well.
MOST_SIGMA_M = 0.02
#: Further than this from the head's origin it is no offset, but positions in another unit.
_MOST_OFFSET_M = 2.0
#: Lamps seen less often say nothing; of the others those that are seen most are used.
_LEAST_SIGHTINGS, _MOST_LAMPS, _MOST_SIGHTINGS = 40, 12, 8000
#: A direction is not known better than so.
_LEAST_SIGMA_DEG = 0.1
#: What is believed beforehand, 1 sigma: offset, turn of the mount as found by turns (pictures of a
#: near room turn, as it were, while the head moves), delay, and lamps at 1/m around a usual one.
_OFFSET_SIGMA_M, _TURN_SIGMA_DEG, _DELAY_SIGMA_S = 0.3, 5.0, 0.05
_USUAL_PER_M, _SIGMA_PER_M = 0.4, 1.0
_COMMON = 7  # unknowns that all lamps share: offset, turn, delay
_REACH_S, _DELAY_STEP_S = 0.2, 0.005
_MOST_STEPS, _SMALL_STEP = 60, 1e-6
_CAUCHY = 2.4 / 1.54  # of the median: 95 % efficient where the noise is Gaussian, in space
_BLOCKS = 8  # of the jackknife
_FEW_BLOCKS = 1.5  # its variance of so few blocks is often too small
#: Half of the sightings must agree so well.
_AGREES_DEG = 2.0
#: Below these the motion is named as what is missing: places, RMS; turns besides the main axis.
_LEAST_WAY_M, _LEAST_TURN_DEG = 0.05, 4.0


@dataclass(frozen=True, eq=False)
class Sightings:
    """Directions towards lamps, N of them."""

    time_ns: tuple[int, ...]  # by the probe's clock
    lamp: NDArray[np.int64]  # (N,) which: numbers that the probe gave
    directions: Array  # (N, 3) unit vectors in the probe's frame
    sigma_deg: Array  # (N,)

    @classmethod
    def of(cls, seen: Iterable[tuple[int, int, Array, float | None]]) -> Sightings:
        """Make of time (ns), number of the lamp, direction (3,) and its sigma in degrees."""
        rows = list(seen)
        sigma = np.array([_LEAST_SIGMA_DEG if row[3] is None else row[3] for row in rows])
        return cls(
            tuple(row[0] for row in rows), np.array([row[1] for row in rows], np.int64),
            np.array([row[2] for row in rows], np.float64).reshape(-1, 3),
            np.maximum(sigma, _LEAST_SIGMA_DEG),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Lever:
    """Where the probe is on the head, and how it is turned."""

    offset_m: Array  # (3,) in the head's frame
    sigma_m: Array  # (3,) 1 sigma along each axis
    rotation: Rotation  # probe → head
    rotation_sigma_deg: float  # 1 sigma about the axis known worst
    residual_deg: float  # RMS per axis of the sightings, weighed
    lamps: int

    def to_json(self) -> dict[str, object]:
        """Plain values."""
        return {
            "offset_m": self.offset_m.tolist(),
            "offset_sigma_m": self.sigma_m.tolist(),
            "offset_residual_deg": self.residual_deg,
            "offset_lamps": self.lamps,
        }


def solve(head: Track, seen: Sightings, rotation: Rotation, time_offset_s: float) -> Lever | str:
    """Find the lever arm, or say why it cannot be told.

    `rotation`: probe → head, about as it is; `time_offset_s`: the head's clock shows so much more
    than the probe's.
    """
    if head.position_m is None:
        return "the poses have no positions"
    at_s = np.array([1e-9 * (t - head.start_ns) for t in seen.time_ns]) + time_offset_s
    known = head.knows(at_s - _REACH_S, 2 * _REACH_S)
    known[known] = np.isfinite(head.positions_m(at_s[known])).all(axis=1)
    often = Counter(seen.lamp[known].tolist()).most_common(_MOST_LAMPS)
    lamps = [lamp for lamp, count in often if count >= _LEAST_SIGHTINGS]
    if not lamps:
        return f"no lamp is seen {_LEAST_SIGHTINGS} times while poses with positions are known"
    used = np.flatnonzero(known & np.isin(seen.lamp, lamps))
    used = used[:: 1 + len(used) // _MOST_SIGHTINGS]
    order = np.searchsorted(np.sort(lamps), seen.lamp[used])
    problem = _Problem(
        head, at_s[used], order, rotation.apply(seen.directions[used]),
        np.radians(seen.sigma_deg[used]),
    )  # fmt: skip
    return problem.judged(problem.solved(), rotation)


@dataclass(frozen=True, eq=False)
class _State:
    """What is looked for."""

    offset_m: Array  # (3,)
    turn: Rotation  # of directions in the head's frame
    delay_s: float
    towards: Array  # (L, 3) unit vectors from the middle of the way, in the world
    per_m: Array  # (L,) inverse distances from there

    def moved(self, step: Array) -> _State:
        """Add a step (7 + 3 L,)."""
        each = step[_COMMON:].reshape(-1, 3)
        across = np.einsum("lka,lk->la", _tangents(self.towards), each[:, :2])
        return _State(
            self.offset_m + step[:3], Rotation.from_rotvec(step[3:6]) * self.turn,
            self.delay_s + float(step[6]), normalize(self.towards + across),
            self.per_m + each[:, 2],
        )  # fmt: skip

    def beliefs(self) -> tuple[Array, Array]:
        """What is believed beforehand: off by (7 + 3 L,), and weights, 1 over sigma squared."""
        count = len(self.per_m)
        off = np.zeros((count, 3))
        off[:, 2] = self.per_m - _USUAL_PER_M
        weight = np.zeros((count, 3))
        weight[:, 2] = _SIGMA_PER_M**-2
        common = np.repeat([_OFFSET_SIGMA_M, np.radians(_TURN_SIGMA_DEG)], 3)
        sigma = np.append(common, _DELAY_SIGMA_S)
        start = np.concatenate([self.offset_m, self.turn.as_rotvec(), [self.delay_s]])
        return np.append(start, off), np.append(sigma**-2.0, weight)


def _tangents(directions: Array) -> Array:
    """Two unit vectors (L, 2, 3) across each direction (L, 3), and across each other."""
    least = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = normalize(np.cross(directions, least))
    return np.stack([first, np.cross(directions, first)], axis=1)


@dataclass(frozen=True, eq=False)
class _System:
    """Residuals, linear in a small step."""

    residuals: Array  # (N, 3) radians
    slopes: Array  # (N, 3, 7 + 3 L)
    weights: Array  # (N,) 1 over sigma squared, robust
    off: Array  # (7 + 3 L,) from what is believed
    belief: Array  # (7 + 3 L,) its weights

    def sums(self, some: slice) -> tuple[Array, Array]:
        """Normal equations of some sightings: matrix and vector."""
        slopes = self.slopes[some].reshape(-1, self.slopes.shape[2])
        weights = np.repeat(self.weights[some], 3)
        scaled = slopes * weights[:, None]
        return scaled.T @ slopes, -(scaled.T @ self.residuals[some].ravel())

    def blocks(self) -> list[slice]:
        """Stretches of time for the jackknife."""
        edges = np.linspace(0, len(self.weights), _BLOCKS + 1).astype(int)
        return [slice(a, b) for a, b in pairwise(edges.tolist())]


@dataclass(frozen=True, eq=False)
class _Problem:
    """Sightings in order of time, in a head's frame that is turned a little."""

    head: Track
    at_s: Array  # (N,) head's time
    lamp: NDArray[np.int64]  # (N,) 0…L-1
    seen: Array  # (N, 3)
    sigma: Array  # (N,) radians

    def begun(self) -> _State:
        """Lamps where they seem to be from the middle, at a usual distance; the probe on p."""
        out = self.head.rotations(self.at_s).apply(self.seen)
        sums = np.zeros((self.lamp.max() + 1, 3))
        np.add.at(sums, self.lamp, out)
        per_m = np.full(len(sums), _USUAL_PER_M)
        return _State(np.zeros(3), Rotation.identity(), 0.0, normalize(sums), per_m)

    def _towards(self, state: _State, delay_s: float) -> tuple[Array, Array, Rotation]:
        """Vectors (N, 3) to lamps in the head's frame, times 1/m; places; world → head."""
        to_head = self.head.rotations(self.at_s + delay_s).inv()
        places = self.head.positions_m(self.at_s + delay_s) - self._middle_m
        per_m = state.per_m[self.lamp, None]
        away = to_head.apply(state.towards[self.lamp] - per_m * places)
        return away - per_m * state.offset_m, places, to_head

    @property
    def _middle_m(self) -> Array:
        return np.asarray(self.head.positions_m(self.at_s).mean(axis=0))

    def residuals(self, state: _State) -> Array:
        """What is expected less what is seen, (N, 3) radians across the direction."""
        expected = normalize(self._towards(state, state.delay_s)[0])
        return np.asarray(expected - state.turn.apply(self.seen))

    def weights(self, residuals: Array) -> Array:
        """1 over sigma squared (N,), less for what does not agree."""
        off = np.linalg.norm(residuals, axis=1) / self.sigma
        scale = max(_CAUCHY * float(np.median(off)), 1.0)
        return np.asarray(1 / (1 + (off / scale) ** 2) / self.sigma**2)

    def system(self, state: _State) -> _System:
        """Set it up, with weights as they are at this state."""
        away, places, to_head = self._towards(state, state.delay_s)
        length = np.linalg.norm(away, axis=1)[:, None]
        expected, seen = away / length, state.turn.apply(self.seen)
        count, width = len(away), _COMMON + 3 * len(state.per_m)
        raw = np.zeros((count, 3, width))  # of `away`
        raw[:, :, :3] = -state.per_m[self.lamp, None, None] * np.eye(3)
        early, late = (self._towards(state, state.delay_s + k * _DELAY_STEP_S)[0] for k in (-1, 1))
        raw[:, :, 6] = (late - early) / (2 * _DELAY_STEP_S)
        rows, first = np.arange(count), _COMMON + 3 * self.lamp
        tangents = _tangents(state.towards)[self.lamp]
        for k in range(2):
            raw[rows, :, first + k] = to_head.apply(tangents[:, k])
        raw[rows, :, first + 2] = -to_head.apply(places) - state.offset_m
        along = np.einsum("na,nap->np", expected, raw)
        slopes = (raw - expected[:, :, None] * along[:, None]) / length[:, :, None]
        for k, axis in enumerate(np.eye(3)):
            slopes[:, :, 3 + k] = -np.cross(axis, seen)
        residuals = expected - seen
        off, belief = state.beliefs()
        return _System(residuals, slopes, self.weights(residuals), off, belief)

    def cost(self, state: _State, weights: Array) -> float:
        """What is minimised, with these weights."""
        off, belief = state.beliefs()
        squares = np.sum(self.residuals(state) ** 2, axis=1)
        return float(weights @ squares + belief @ off**2)

    def solved(self) -> _State:
        """Step by step from the beginning."""
        state, damping = self.begun(), 1e-3
        for _ in range(_MOST_STEPS):
            system = self.system(state)
            matrix, vector = system.sums(slice(None))
            matrix += np.diag(system.belief)
            vector -= system.belief * system.off
            damped = matrix + damping * np.diag(np.diag(matrix))
            step = np.asarray(np.linalg.solve(damped, vector), np.float64)
            step[6] = np.clip(step[6], -_DELAY_SIGMA_S / 2, _DELAY_SIGMA_S / 2)
            moved = state.moved(step)
            is_inside = abs(moved.delay_s) < _REACH_S - _DELAY_STEP_S
            if is_inside and self.cost(moved, system.weights) < self.cost(state, system.weights):
                state, damping = moved, damping / 5
                if np.abs(step[:_COMMON]).max() < _SMALL_STEP:
                    break
            elif damping > 1e6:
                break
            else:
                damping *= 10
        return state

    def covariance(self, state: _State) -> Array:
        """Of the unknowns that all lamps share, (7, 7): by the residuals, and the jackknife's.

        The latter, over stretches of time, holds errors that last, as trackers have them.
        """
        system = self.system(state)
        parts = [system.sums(block) for block in system.blocks()]
        matrix = sum(part[0] for part in parts) + np.diag(system.belief)
        vector = sum(part[1] for part in parts) - system.belief * system.off
        without = np.stack([np.linalg.solve(matrix - m, vector - v) for m, v in parts])
        spread = (without - without.mean(axis=0))[:, :_COMMON]
        square = np.sum(system.residuals**2, axis=1) * system.weights
        per_axis = max(1.0, float(np.sum(square) / (2 * np.sum(system.weights * self.sigma**2))))
        formal = per_axis * np.linalg.inv(matrix)[:_COMMON, :_COMMON]
        jackknife = (_BLOCKS - 1) / _BLOCKS * spread.T @ spread
        return np.asarray(formal + _FEW_BLOCKS * jackknife)

    def judged(self, state: _State, rotation: Rotation) -> Lever | str:
        """What is found, or why it does not count."""
        off_deg = np.degrees(np.linalg.norm(self.residuals(state), axis=1))
        if np.median(off_deg) > _AGREES_DEG or np.linalg.norm(state.offset_m) > _MOST_OFFSET_M:
            return (
                f"positions and lamps contradict each other, by {np.median(off_deg):.1f}°: give "
                "metres in the axes of the rotations, and leave the lamps where they are"
            )
        covariance = self.covariance(state)
        worst_m = float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))
        if worst_m > MOST_SIGMA_M:
            return f"it is known to ± {100 * worst_m:.1f} cm only (1 sigma): {self._missing()}"
        turn = float(np.sqrt(np.linalg.eigvalsh(covariance[3:6, 3:6])[-1]))
        weights = self.weights(self.residuals(state))
        rms_deg = float(np.sqrt(np.average(off_deg**2, weights=weights) / 2))
        sigma_m = np.sqrt(np.diag(covariance)[:3])
        return Lever(
            state.offset_m, sigma_m, state.turn * rotation, float(np.degrees(turn)), rms_deg,
            len(state.per_m),
        )  # fmt: skip

    def _missing(self) -> str:
        """What of the motion is missing."""
        way_m = float(np.sqrt(np.sum(np.var(self.head.positions_m(self.at_s), axis=0))))
        if way_m < _LEAST_WAY_M:
            return (
                f"the head hardly changes its place ({100 * way_m:.0f} cm, RMS): go to and fro, "
                "half a metre to each side, while you look around"
            )
        turned = self.head.rotations(self.at_s)
        vectors = np.degrees((turned.mean().inv() * turned).as_rotvec())
        second_deg = float(np.linalg.svd(vectors, compute_uv=False)[1] / np.sqrt(len(vectors)))
        if second_deg < _LEAST_TURN_DEG:
            return (
                f"the head turns about one axis only (besides it {second_deg:.1f}°, RMS): nod, or "
                "tilt the head, while you go to and fro"
            )
        return "go to and fro, and look around, for longer, with lamps in the room and not far away"
