"""The mount's rotation from lamps that both probe and head know the directions of.

Which lamp is which is not known. Every pair of lamps in one list is laid on every pair in the
other that is as far apart; the rotation under which most lamps agree is then refined by weighted
least squares (Wahba's problem, solved by Kabsch: Acta Crystallographica A 32, 1976, 922).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from lightprobe.align.track import AlignError
from lightprobe.geometry import Array, angle_deg, normalize

#: Lamps agree that are no further apart than this and three sigma.
AGREE_DEG = 3.0
#: Two directions nearer to one line than this do not tell the rotation about it.
_LEAST_APART_DEG = 10.0
#: A lamp is not known better than so: the two cameras are not in the same place.
_LEAST_SIGMA_DEG = 0.3
_MOST_LAMPS = 16
_REFINEMENTS = 10
#: Rotations further apart than this are different answers.
_DIFFERENT_DEG = 5.0
#: In squared sigmas, as :class:`_Candidate` has it: this much more is another pattern.
_WORSE_COST = 9.0
#: Lamps that are told apart by their light differ by this factor from the others.
_LIGHT_FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class Lamps:
    """Directions towards lamps in one frame."""

    name: str  # for messages
    directions: Array  # (N, 3) unit vectors
    irradiance: Array  # (N,) relative; NaN: not known
    sigma_deg: Array  # (N,) of each direction

    @classmethod
    def of(
        cls, name: str, directions: Array, irradiance: Array, sigma_deg: Array | None = None
    ) -> Lamps:
        """Check and make; the strongest 16 are used. Raises :class:`AlignError`."""
        if len(directions) < 2:
            raise AlignError(
                f"align: {name}: {len(directions)} lamps: at least two are needed: "
                "switch more of them on"
            )
        if not np.isfinite(directions).all() or not np.linalg.norm(directions, axis=1).all():
            raise AlignError(f"align: {name}: a direction is not finite, or zero: leave it out")
        sigma = np.full(len(directions), _LEAST_SIGMA_DEG) if sigma_deg is None else sigma_deg
        order = np.argsort(-np.nan_to_num(irradiance), kind="stable")[:_MOST_LAMPS]
        return cls(
            name, normalize(directions)[order], irradiance[order],
            np.maximum(np.nan_to_num(sigma[order]), _LEAST_SIGMA_DEG),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Matched:
    """Rotation of a mount, found by lamps."""

    rotation: Rotation  # probe → head
    sigma_deg: float  # 1 sigma about the axis known worst
    residual_deg: float  # RMS angle between matched lamps
    pairs: tuple[tuple[int, int], ...]  # numbers in the lists of probe and head

    def to_json(self) -> dict[str, object]:
        """Plain values."""
        return {
            "rotation_xyzw": self.rotation.as_quat(canonical=True).tolist(),
            "sigma_deg": self.sigma_deg,
            "residual_deg": self.residual_deg,
            "pairs": [list(pair) for pair in self.pairs],
        }


def match(head: Lamps, probe: Lamps) -> Matched:
    """Find the rotation; raises :class:`AlignError` where lamps do not tell one."""
    candidates = [_refined(head, probe, rotation) for rotation in _trials(head, probe)]
    found = sorted(
        (c for c in candidates if c is not None), key=lambda c: (-len(c.pairs), c.light_off, c.cost)
    )
    if not found:
        raise AlignError(
            f"align: {head.name} and {probe.name}: no two lamps are as far apart in both (at least "
            f"{_LEAST_APART_DEG:g}°, within {AGREE_DEG:g}°): both must see the same lamps, from "
            "nearly the same place"
        )
    best = found[0]
    for other in found[1:]:
        apart_deg = np.degrees((best.rotation.inv() * other.rotation).magnitude())
        if apart_deg > _DIFFERENT_DEG and not _clearly_better(best, other):
            raise AlignError(
                f"align: {head.name} and {probe.name}: two rotations, {apart_deg:.0f}° apart, "
                f"match {len(best.pairs)} lamps equally well: switch one more lamp on, where it "
                "makes the pattern irregular"
            )
    return best.result(head, probe)


@dataclass(frozen=True, eq=False)
class _Candidate:
    rotation: Rotation
    pairs: tuple[tuple[int, int], ...]
    cost: float  # mean of the squared angles, in squared sigmas
    light_off: bool  # the lamps' light contradicts the match

    def result(self, head: Lamps, probe: Lamps) -> Matched:
        p, h = (list(side) for side in zip(*self.pairs, strict=True))
        turned = self.rotation.apply(probe.directions[p])
        off_deg = angle_deg(turned, head.directions[h])
        variance = head.sigma_deg[h] ** 2 + probe.sigma_deg[p] ** 2
        # What the lamps say of a small turn: nothing about their own directions.
        information = np.einsum("n,nij->ij", 1 / variance, _across(turned))
        inflate = max(1.0, float(np.sqrt(self.cost)))
        sigma_deg = inflate / float(np.sqrt(np.linalg.eigvalsh(information)[0]))
        return Matched(self.rotation, sigma_deg, float(np.sqrt(np.mean(off_deg**2))), self.pairs)


def _across(directions: Array) -> Array:
    """Projections (N, 3, 3) onto the planes across directions (N, 3)."""
    return np.asarray(np.eye(3) - directions[:, :, None] * directions[:, None, :])


def _clearly_better(best: _Candidate, other: _Candidate) -> bool:
    if len(other.pairs) < len(best.pairs) or (other.light_off and not best.light_off):
        return True
    return other.cost > best.cost + _WORSE_COST


def _trials(head: Lamps, probe: Lamps) -> Iterator[Rotation]:
    """Rotations that lay two lamps of the probe on two of the head."""
    between_head = angle_deg(head.directions[:, None], head.directions[None])
    between_probe = angle_deg(probe.directions[:, None], probe.directions[None])
    for i, j in combinations(range(len(probe.directions)), 2):
        if not _LEAST_APART_DEG < between_probe[i, j] < 180 - _LEAST_APART_DEG:
            continue
        for k, m in permutations(range(len(head.directions)), 2):
            if abs(between_head[k, m] - between_probe[i, j]) < AGREE_DEG:
                yield Rotation.align_vectors(head.directions[[k, m]], probe.directions[[i, j]])[0]


def _refined(head: Lamps, probe: Lamps, rotation: Rotation) -> _Candidate | None:
    pairs: NDArray[np.int64] = np.empty((0, 2), np.int64)
    for _ in range(_REFINEMENTS):
        before = pairs
        pairs = _pairs(head, probe, rotation)
        if len(pairs) < 2 or _nearly_one_line(probe.directions[pairs[:, 0]]):
            return None
        p, h = pairs.T
        weights = 1 / (head.sigma_deg[h] ** 2 + probe.sigma_deg[p] ** 2)
        rotation, _ = Rotation.align_vectors(head.directions[h], probe.directions[p], weights)
        if np.array_equal(before, pairs):
            break
    off_deg = angle_deg(rotation.apply(probe.directions[p]), head.directions[h])
    matched = tuple((int(i), int(k)) for i, k in pairs)
    light_off = _light_off(head.irradiance[h], probe.irradiance[p])
    return _Candidate(rotation, matched, float(np.mean(off_deg**2 * weights)), light_off)


def _pairs(head: Lamps, probe: Lamps, rotation: Rotation) -> NDArray[np.int64]:
    """Lamps (N, 2) of probe and head that agree, one to one."""
    off = angle_deg(rotation.apply(probe.directions)[:, None], head.directions[None])
    limit = AGREE_DEG + 3 * np.hypot(probe.sigma_deg[:, None], head.sigma_deg[None])
    p, h = linear_sum_assignment(np.minimum(off / limit, 1))
    agree = off[p, h] < limit[p, h]
    return np.stack([p[agree], h[agree]], axis=-1)


def _nearly_one_line(directions: Array) -> bool:
    across = np.linalg.svd(directions, compute_uv=False)[1]
    return bool(across < np.sin(np.radians(_LEAST_APART_DEG)) / 2)


def _light_off(head: Array, probe: Array) -> bool:
    """Tell whether the lamps' light differs from one list to the other, but for a common scale."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.log(head / probe)
    known = ratio[np.isfinite(ratio)]
    return bool(len(known) > 1 and np.ptp(known) > np.log(_LIGHT_FACTOR))
