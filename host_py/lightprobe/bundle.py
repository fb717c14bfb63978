"""Lamps and probes together: one fit of where lamps are, and of how each probe is turned.

What is measured by hand is known roughly: a tripod's yaw within degrees, its level within half of
one, its place within a centimetre. Lamps that several probes see tell it better. All of it is
fitted at once, so that the sigma of a lamp's distance holds what the others leave open.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightprobe.geometry import Array, cross, normalize

#: What is known of a lamp before any direction: hardly one is nearer than 10 cm.
_INVERSE_SIGMA_PER_M = 10.0
_STEPS = 12
_LEAST_TURN_RAD = 1e-6  # sigma of a turn that is said to be exact
_STEP = 1e-6  # of each parameter, for derivatives


@dataclass(frozen=True, eq=False)
class Sightings:
    """Which probe sees which lamp where: n of them."""

    probe: NDArray[np.int64]  # (n,) index of the probe
    lamp: NDArray[np.int64]  # (n,) index of the lamp; the first probe sees each of them
    directions: Array  # (n, 3) unit vectors in the room, by the probe's stated turn
    sigma_rad: Array  # (n,) of each direction alone


@dataclass(frozen=True, eq=False)
class Fit:
    """What is known after the fit."""

    turns_rad: Array  # (probes, 3) rotation vectors in the room, to be added to the stated turns
    turn_sigma_rad: Array  # (probes, 3) about each axis
    inverse_per_m: Array  # (lamps,) inverse distance from the first probe
    inverse_sigma_per_m: Array  # (lamps,)
    chi2: float  # what is left, priors included
    degrees_of_freedom: int

    @property
    def agrees(self) -> bool:
        """False: what is left is too much, by 3 sigma.

        Then a lamp is not the same one, or the fit has not found the right places.
        """
        return self.chi2 <= self.degrees_of_freedom + 3 * math.sqrt(2 * self.degrees_of_freedom) + 9


def fit(
    places_m: Array, place_sigma_m: Array, turn_sigma_rad: Array, sightings: Sightings,
    yaws_rad: Array | None = None,
) -> Fit:  # fmt: skip
    """Fit turns, places and lamps (Gauss–Newton with halved steps).

    `places_m` (probes, 3) and `place_sigma_m` (probes,), along each axis; `turn_sigma_rad`
    (probes, 3): about x, y (yaw) and z of the room. `yaws_rad` (probes,): where the search begins,
    from the stated turns. All that is found is seen from the first probe's place, which is where
    it is said to be.
    """
    turn_sigma_rad = np.maximum(turn_sigma_rad, _LEAST_TURN_RAD)
    begin = np.zeros((len(places_m), 3))
    if yaws_rad is not None:
        begin[:, 1] = yaws_rad
    problem = _Problem(places_m, place_sigma_m, turn_sigma_rad, sightings, begin)
    values = np.zeros(problem.size)
    values[: begin.size] = (begin / turn_sigma_rad).ravel()
    residual = problem.residual(values)
    for _ in range(_STEPS):
        slope = problem.slope(values, residual)
        step = -np.linalg.lstsq(slope, residual, rcond=None)[0]
        for _ in range(8):
            tried = problem.residual(values + step)
            if tried @ tried <= residual @ residual + 1e-9:
                break
            step = step / 2
        else:
            break  # no step is better than none
        values, residual = values + step, tried
        if np.abs(step).max() < 1e-7:
            break
    slope = problem.slope(values, residual)
    sigma = _sigmas(slope)
    turns, _, _, inverse = problem.parts(values)
    turn_sigma, _, _, inverse_sigma = problem.parts(sigma)
    return Fit(
        turns * turn_sigma_rad, turn_sigma * turn_sigma_rad, problem.start + inverse, inverse_sigma,
        float(residual @ residual), 2 * len(sightings.lamp) - 3 * problem.lamps,
    )  # fmt: skip


def _sigmas(slope: Array) -> Array:
    """Of each parameter, by the singular values: of what nothing tells it is large, never small."""
    _, values, turned = np.linalg.svd(slope, full_matrices=False)
    least = np.finfo(np.float64).eps * values[0]
    return np.asarray(np.linalg.norm(turned / np.maximum(values, least)[:, None], axis=0))


class _Problem:
    """Residuals as a function of what is fitted.

    Parameters: turns of all probes and places of all but the first, in sigmas; directions of all
    lamps, and their inverse distances from `start`.
    """

    def __init__(
        self, places_m: Array, place_sigma_m: Array, turn_sigma_rad: Array, sightings: Sightings,
        begin_rad: Array,
    ) -> None:  # fmt: skip
        self._offsets_m = places_m - places_m[0]
        # The first one's error is in the others, which are seen from it.
        self._place_sigma_m = np.hypot(place_sigma_m[1:], place_sigma_m[0])
        self._turn_sigma = turn_sigma_rad
        self._s = sightings
        self.lamps = int(sightings.lamp.max()) + 1
        self._probes = len(places_m)
        self.size = 6 * self._probes - 3 + 3 * self.lamps
        first = np.array([
            np.flatnonzero((sightings.probe == 0) & (sightings.lamp == k))[0]
            for k in range(self.lamps)
        ])  # fmt: skip
        self._begun = _turned(begin_rad[sightings.probe], sightings.directions)
        self._towards = self._begun[first]
        helper = np.where(np.abs(self._towards[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
        self._along = normalize(cross(self._towards, helper))
        self._over = cross(self._towards, self._along)
        self.start = self._inverse_at_start()

    def parts(self, values: Array) -> tuple[Array, Array, Array, Array]:
        """Turns (probes, 3), places (probes − 1, 3), directions (lamps, 2), inverse (lamps,)."""
        n = self._probes
        turns, places, lamps = np.split(values, [3 * n, 6 * n - 3])
        by_lamp = lamps.reshape(-1, 3)
        return turns.reshape(n, 3), places.reshape(n - 1, 3), by_lamp[:, :2], by_lamp[:, 2]

    def residual(self, values: Array) -> Array:
        """Chords between directions as seen and as expected, and the priors, over their sigmas."""
        turns, places, across, inverse = self.parts(values)
        s = self._s
        towards = normalize(
            self._towards + across[:, :1] * self._along + across[:, 1:] * self._over
        )
        offsets_m = self._offsets_m.copy()
        offsets_m[1:] += places * self._place_sigma_m[:, None]
        inverse_per_m = self.start + inverse
        expected = towards[s.lamp] - inverse_per_m[s.lamp, None] * offsets_m[s.probe]
        here = ~expected.any(axis=1)  # a lamp at the probe itself: any direction is as good
        expected[here] = towards[s.lamp][here]
        expected = normalize(expected)
        seen = _turned(turns[s.probe] * self._turn_sigma[s.probe], s.directions)
        chords = (expected - seen) / s.sigma_rad[:, None]
        priors = (turns, places, inverse_per_m / _INVERSE_SIGMA_PER_M)
        return np.concatenate([chords.ravel(), *(one.ravel() for one in priors)])

    def slope(self, values: Array, residual: Array) -> Array:
        """Derivatives of the residual by each parameter."""
        columns = []
        for k in range(self.size):
            moved = values.copy()
            moved[k] += _STEP
            columns.append((self.residual(moved) - residual) / _STEP)
        return np.stack(columns, axis=1)

    def _inverse_at_start(self) -> Array:
        """Inverse distances of the points that are nearest to all lines of sight."""
        found = np.zeros(self.lamps)
        for k in range(self.lamps):
            of_it = self._s.lamp == k
            seen, offsets_m = self._begun[of_it], self._offsets_m[self._s.probe[of_it]]
            across = np.eye(3) - seen[:, :, None] * seen[:, None, :]
            normal = across.sum(axis=0)
            if np.linalg.cond(normal) < 1e9:  # else the lines are parallel
                place_m = np.linalg.solve(normal, (across @ offsets_m[:, :, None]).sum(axis=0))
                along_m = float(place_m[:, 0] @ self._towards[k])
                found[k] = 1 / along_m if along_m > 1 / _INVERSE_SIGMA_PER_M else 0.0
        return found


def _turned(rotation_rad: Array, vectors: Array) -> Array:
    """Vectors (n, 3), each turned by its rotation vector (n, 3)."""
    angle = np.linalg.norm(rotation_rad, axis=1, keepdims=True)
    axis = rotation_rad / np.maximum(angle, 1e-30)
    along = np.sum(axis * vectors, axis=1, keepdims=True) * axis
    sideways = cross(axis, vectors)
    turned: Array = along + np.cos(angle) * (vectors - along) + np.sin(angle) * sideways
    return turned
