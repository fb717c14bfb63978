"""The mount's rotation from how head and probe turn together (hand-eye calibration).

While the head turns by A (in its own frame) the probe turns by B, and A X = X B with the fixed
rotation X from probe to head. Written as rotation vectors this is a = X b: the best X of many
turns is the closed form of Park and Martin ("Robot sensor calibration: solving AX = XB on the
Euclidean group", IEEE Trans. Robotics and Automation 10(5), 1994), here with robust weights and
together with the offset between the two clocks. Turns about one axis only leave X free to turn
about that axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate, find_peaks
from scipy.spatial.transform import Rotation

from lightprobe.align.track import LONGEST_GAP_S, AlignError, Track
from lightprobe.geometry import Array

#: Turns are taken over so long: long enough to be large beside their noise, and short enough for
#: little drift of the probe's orientation.
TURN_S = 0.4
_STEP_S = 0.05  # from the start of one turn to that of the next
#: Angular speeds are compared at this step, each taken over twice as long.
_SPEED_STEP_S = 0.02
#: Fewer seconds that both tracks cover say too little.
LEAST_S = 5.0
#: Poses that are late by no more than this are looked for first, as those of one clock.
SAME_CLOCK_S = 2.0
#: RMS of the turns below which something stands still; and besides the main axis.
_LEAST_TURN_DEG, _LEAST_OFF_AXIS_DEG = 1.0, 0.7
#: Of noise (residuals), by how much the turns besides the main axis must exceed it.
_OFF_AXIS_BY_NOISE = 4.0
#: A turn agrees when it is off by less than this and this share of itself; so many must agree.
_AGREES_DEG, _AGREES_SHARE, _LEAST_AGREEING = 1.0, 0.05, 0.6
#: Another offset explains the turns as well when its cost is less than so many times the best.
_AS_WELL, _DIFFERENT_DEG = 1.5, 5.0
_BLOCKS = 8  # of the jackknife
_CANDIDATES = 6
#: How far from an offset of :func:`_offsets` the right one may be.
_REACH_S = 0.1
_MOST_STEPS, _SMALL_STEP = 20, 1e-4
_CAUCHY = 2.4 / 1.54  # of the median: 95 % efficient where the noise is Gaussian, in space


@dataclass(frozen=True, eq=False)
class HandEye:
    """Rotation of a mount, found by turns."""

    rotation: Rotation  # probe → head
    sigma_deg: float  # 1 sigma about the axis known worst
    time_offset_s: float  # the head's clock shows so much more at the same moment
    time_offset_sigma_s: float
    residual_deg: float  # RMS per axis of the turns that agree
    turns: int
    agreeing: float  # share of the turns that agree
    turned_deg: tuple[float, float, float]  # RMS of the turns about main, second, third axis

    def to_json(self) -> dict[str, object]:
        """Plain values."""
        return {
            "rotation_xyzw": self.rotation.as_quat(canonical=True).tolist(),
            "sigma_deg": self.sigma_deg,
            "time_offset_s": self.time_offset_s,
            "time_offset_sigma_s": self.time_offset_sigma_s,
            "residual_deg": self.residual_deg,
            "turns": self.turns,
            "agreeing": self.agreeing,
            "turned_deg": list(self.turned_deg),
        }


def solve(head: Track, probe: Track, *, latest_s: float | None = None) -> HandEye:
    """Find the rotation from probe to head; raises :class:`AlignError` that says what is missing.

    `head` and `probe`: each in its own frame of the world and with its own clock; `latest_s`: both
    are known to have one clock, and neither to be later than so much.
    """
    for track in (head, probe):
        if track.duration_s < LEAST_S:
            raise AlignError(
                f"align: {track.name}: {track.duration_s:.1f} s of poses: at least {LEAST_S:g} s "
                "are needed: look around longer"
            )
    start_s = np.arange(0, probe.duration_s - TURN_S, _STEP_S)
    turns = probe.turns_deg(start_s, TURN_S)
    known = np.isfinite(turns).all(axis=1)
    start_s, turns = start_s[known], turns[known]
    own_s = np.arange(0, head.duration_s - TURN_S, _STEP_S)
    _require_motion(head.name, head.turns_deg(own_s, TURN_S))
    _require_motion(probe.name, turns)
    fits = _fits(head, start_s, turns, _offsets(head, probe, latest_s or SAME_CLOCK_S))
    if latest_s is None and (not fits or fits[0].agreeing < _LEAST_AGREEING):
        fits = _fits(head, start_s, turns, _offsets(head, probe, np.inf))
    if not fits:
        raise AlignError(
            f"align: {head.name} and {probe.name} never turn alike, whatever the offset between "
            f"their clocks: give both of the same time, {LEAST_S:g} s or more of it"
        )
    best = fits[0]
    if best.agreeing < _LEAST_AGREEING:
        raise AlignError(_contradiction(head, start_s, turns, best))
    found = best.result(1e-9 * (head.start_ns - probe.start_ns))
    for other in fits[1:]:
        apart_deg = np.degrees((best.rotation.inv() * other.rotation).magnitude())
        if other.cost < _AS_WELL * best.cost and apart_deg > _DIFFERENT_DEG:
            raise AlignError(
                f"align: {head.name}: the motion repeats itself: clocks that are "
                f"{best.offset_s:.2f} s or {other.offset_s:.2f} s apart explain it: turn "
                "irregularly, now fast and now slowly"
            )
    return found


def _require_motion(name: str, turns: Array) -> None:
    turns = turns[np.isfinite(turns).all(axis=1)]
    if len(turns) * _STEP_S < LEAST_S - TURN_S:
        raise AlignError(
            f"align: {name}: only {len(turns) * _STEP_S:.1f} s without gaps (of more than "
            f"{1000 * LONGEST_GAP_S:.0f} ms between poses): at least {LEAST_S:g} s are needed"
        )
    spread = _spread_deg(turns)
    if np.linalg.norm(spread) < _LEAST_TURN_DEG:
        raise AlignError(
            f"align: {name}: does not turn ({np.linalg.norm(spread):.2f}° in {TURN_S:g} s): "
            "look around while poses are taken; the probe must be on the head"
        )


def _spread_deg(turns: Array) -> Array:
    """RMS (3,) of turns about their main axis, the second, and the third."""
    return np.asarray(np.linalg.svd(turns, compute_uv=False) / np.sqrt(len(turns)))


def _offsets(head: Track, probe: Track, latest_s: float) -> list[float]:
    """Offsets with which both turn equally fast, in seconds; the best ones.

    From the probe's time since its start to the head's; only those so near the offset that there is
    if both have one clock.
    """
    speeds = []
    for track in (head, probe):
        at_s = np.arange(0, track.duration_s - 2 * _SPEED_STEP_S, _SPEED_STEP_S)
        speed = np.linalg.norm(track.turns_deg(at_s, 2 * _SPEED_STEP_S), axis=1)
        speed -= np.nanmedian(speed)
        speeds.append(np.nan_to_num(speed))
    product = correlate(speeds[0], speeds[1])
    ones = [np.ones_like(speed) for speed in speeds]
    common = np.round(correlate(ones[0], ones[1])) * _SPEED_STEP_S
    energy = correlate(speeds[0] ** 2, ones[1]) * correlate(ones[0], speeds[1] ** 2)
    score = product / np.sqrt(np.maximum(energy, 1e-6 * energy.max()))
    lag_s = (np.arange(len(score)) - len(speeds[1]) + 1) * _SPEED_STEP_S
    score[common < LEAST_S] = -1
    same_s = 1e-9 * (probe.start_ns - head.start_ns)  # the lag, if it is one clock
    score[np.abs(lag_s - same_s) > latest_s] = -1
    peaks, _ = find_peaks(np.concatenate([[-1], score, [-1]]), height=0.2)
    order = sorted(peaks - 1, key=lambda k: -score[k])[:_CANDIDATES]
    return [float(lag_s[k]) for k in order]


@dataclass(frozen=True, eq=False)
class _Fit:
    """One offset of the clocks, and what follows from it."""

    rotation: Rotation
    offset_s: float
    cost: float  # robust, per turn
    head_turns: Array  # (N, 3) degrees
    probe_turns: Array
    covariance: Array  # (4, 4) of three angles in degrees and the offset in seconds

    @property
    def residuals_deg(self) -> Array:
        return np.asarray(self.head_turns - self.rotation.apply(self.probe_turns))

    @property
    def agrees(self) -> Array:
        limit = _AGREES_DEG + _AGREES_SHARE * np.linalg.norm(self.probe_turns, axis=1)
        return np.asarray(np.linalg.norm(self.residuals_deg, axis=1) < limit)

    @property
    def agreeing(self) -> float:
        return float(np.mean(self.agrees))

    def result(self, clocks_s: float) -> HandEye:
        """Judge it; `clocks_s`: by which the head's clock was ahead when both tracks began."""
        agrees = self.agrees
        residual = float(np.sqrt(np.mean(self.residuals_deg[agrees] ** 2)))
        spread = _spread_deg(self.probe_turns[agrees])
        off_axis = float(np.hypot(spread[1], spread[2]))
        if off_axis < max(_LEAST_OFF_AXIS_DEG, _OFF_AXIS_BY_NOISE * residual):
            axis = np.linalg.svd(self.head_turns[agrees])[2][0]
            raise AlignError(
                f"align: head and probe turn about one axis only ({_named(axis)}; besides it "
                f"{off_axis:.2f}°, noise {residual:.2f}°): turn about another axis too"
            )
        sigma_deg = float(np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))
        offset_sigma_s = float(np.sqrt(self.covariance[3, 3]))
        main, second, third = (float(value) for value in spread)
        return HandEye(
            self.rotation, sigma_deg, self.offset_s + clocks_s, offset_sigma_s, residual,
            len(self.probe_turns), self.agreeing, (main, second, third),
        )  # fmt: skip


def _named(axis: Array) -> str:
    names = (
        "nodding, the head's X",
        "turning left and right, the head's Y",
        "tilting, the head's Z",
    )
    return f"near {names[int(np.argmax(np.abs(axis)))]}"


def _fits(head: Track, start_s: Array, turns: Array, offsets_s: list[float]) -> list[_Fit]:
    """Fits from each offset, the best first."""
    found = [_fit(head, start_s, turns, offset_s) for offset_s in offsets_s]
    return sorted((fit for fit in found if fit is not None), key=lambda fit: fit.cost)


def _fit(head: Track, start_s: Array, turns: Array, offset_s: float) -> _Fit | None:
    """Rotation and offset from a first offset on, by Gauss–Newton with Cauchy's weights.

    Their covariance is the jackknife's over blocks of time, because neighbouring turns overlap.
    None: it leads nowhere near that offset.
    """
    room_s = _REACH_S + _SPEED_STEP_S
    usable = head.knows(start_s + offset_s - room_s, TURN_S + 2 * room_s)
    if usable.sum() * _STEP_S < LEAST_S - TURN_S:
        return None
    start_s, turns = start_s[usable], turns[usable]
    shift_s = offset_s
    rotation = _closed_form(head.turns_deg(start_s + offset_s, TURN_S), turns)
    for _ in range(_MOST_STEPS):
        system = _System.of(head, start_s, turns, rotation, shift_s)
        step = system.step()
        rotation = Rotation.from_rotvec(step[:3], degrees=True) * rotation
        shift_s += float(step[3])
        if abs(shift_s - offset_s) > _REACH_S:
            return None
        if np.all(np.abs(step) < _SMALL_STEP):
            break
    head_turns = head.turns_deg(start_s + shift_s, TURN_S)
    # Not the cost that was minimised: its scale differs from offset to offset.
    off_deg = np.linalg.norm(head_turns - rotation.apply(turns), axis=1)
    cost = float(np.mean(np.minimum(off_deg, 5.0) ** 2))
    return _Fit(rotation, shift_s, cost, head_turns, turns, system.covariance())


@dataclass(frozen=True, eq=False)
class _System:
    """Residuals of the turns, linear in a small change: three angles (degrees), offset (s)."""

    residuals: Array  # (N, 3) degrees
    slopes: Array  # (N, 3, 4)
    weights: Array  # (N,)

    @classmethod
    def of(
        cls, head: Track, start_s: Array, turns: Array, rotation: Rotation, offset_s: float
    ) -> _System:
        """Set it up."""
        early, now, late = (
            head.turns_deg(start_s + offset_s + k * _SPEED_STEP_S, TURN_S) for k in (-1, 0, 1)
        )
        turned = rotation.apply(turns)
        slopes = np.empty((len(turns), 3, 4))
        for k, axis in enumerate(np.eye(3)):
            slopes[:, :, k] = -np.cross(np.radians(axis), turned)
        slopes[:, :, 3] = (late - early) / (2 * _SPEED_STEP_S)
        residuals = now - turned
        off = np.linalg.norm(residuals, axis=1)
        scale = max(_CAUCHY * float(np.median(off)), 0.02)
        return cls(residuals, slopes, 1 / (1 + (off / scale) ** 2))

    def step(self) -> Array:
        """Change (4,) that brings the residuals near zero."""
        matrices, vectors = self._sums()
        return _solution(matrices.sum(axis=0), vectors.sum(axis=0))

    def covariance(self) -> Array:
        """Spread (4, 4) of the solutions without one block each (jackknife)."""
        matrices, vectors = self._sums()
        matrix, vector = matrices.sum(axis=0), vectors.sum(axis=0)
        parts = np.stack(
            [_solution(matrix - m, vector - v) for m, v in zip(matrices, vectors, strict=True)]
        )
        spread = parts - parts.mean(axis=0)
        return np.asarray((_BLOCKS - 1) / _BLOCKS * spread.T @ spread)

    def _sums(self) -> tuple[Array, Array]:
        """Normal equations of each block: matrices (blocks, 4, 4) and vectors (blocks, 4)."""
        matrices = np.einsum("n,nik,nil->nkl", self.weights, self.slopes, self.slopes)
        vectors = -np.einsum("n,nik,ni->nk", self.weights, self.slopes, self.residuals)
        first = np.linspace(0, len(self.weights), _BLOCKS, endpoint=False).astype(int)
        return np.add.reduceat(matrices, first), np.add.reduceat(vectors, first)


def _solution(matrix: Array, vector: Array) -> Array:
    """Solve; what the turns say nothing of stays as it is."""
    return np.asarray(np.linalg.pinv(matrix, rcond=1e-9, hermitian=True) @ vector)


def _closed_form(head_turns: Array, probe_turns: Array) -> Rotation:
    """Rotation of Park and Martin, with weights that leave out what does not agree."""
    weights = np.ones(len(probe_turns))
    rotation = Rotation.identity()
    for _ in range(10):
        rotation, _ = Rotation.align_vectors(head_turns, probe_turns, weights)
        off = np.linalg.norm(head_turns - rotation.apply(probe_turns), axis=1)
        weights = 1 / (1 + (off / max(float(np.median(off)), 1e-3)) ** 2)
    return rotation


#: What apps confuse, and what their poses are then. (Turns of a left-handed frame fit as well.)
_CONFUSIONS: dict[str, Callable[[Rotation], Rotation]] = {
    "they tell the world in the head's frame: give the inverse rotations": lambda r: r.inv(),
    "their numbers are in the order w, x, y, z: give x, y, z, w": lambda r: Rotation.from_quat(
        r.as_quat()[:, [1, 2, 3, 0]]
    ),
}


def _contradiction(head: Track, start_s: Array, turns: Array, best: _Fit) -> str:
    text = (
        f"align: {head.name}: {100 * (1 - best.agreeing):.0f} % of the turns contradict the "
        f"probe's, by {np.median(np.linalg.norm(best.residuals_deg, axis=1)):.1f}°"
    )
    best_cost, advice = (
        best.cost,
        "the probe must not move on the head, and both must be of one time",
    )
    for name, change in _CONFUSIONS.items():
        for fit in _fits(head.changed(change), start_s, turns, [best.offset_s]):
            if fit.agreeing >= _LEAST_AGREEING and fit.cost < best_cost:
                best_cost, advice = fit.cost, name
    return f"{text}: {advice}"
