"""Where lamps are, from the directions in which two or more places see them.

A lamp is a direction from the first place and an inverse distance: both stay Gaussian for near and
far lamps alike, where a distance does not. Each direction has an error of its own, and its place
one in position and one in turn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lightprobe.geometry import Array, cross, normalize

#: What is known before any direction: hardly a lamp is nearer than 10 cm, and none is behind us.
_PRIOR_PER_M = 10.0
_STEPS = 20
_SIGMAS = 3.0  # a distance is known when its inverse is so many sigmas from 0


@dataclass(frozen=True, eq=False)
class Sighting:
    """A lamp as one place sees it, in a frame that all places share."""

    place_m: Array  # (3,)
    direction: Array  # (3,) unit vector
    direction_sigma_deg: float  # of the direction, with that of the place's turn
    place_sigma_m: float = 0.0  # along each axis


@dataclass(frozen=True, eq=False)
class LampPlace:
    """Where a lamp is, as seen from the first place."""

    direction: Array  # (3,) of all sightings together
    inverse_distance_per_m: float
    inverse_distance_sigma_per_m: float
    chi2: float  # what the sightings disagree by, in squared sigmas
    degrees_of_freedom: int

    @property
    def distance_m(self) -> float | None:
        """Distance; None: the lamp is too far away, or the places too close together."""
        inverse = self.inverse_distance_per_m
        if inverse <= _SIGMAS * self.inverse_distance_sigma_per_m:
            return None
        return 1 / inverse

    @property
    def distance_sigma(self) -> float | None:
        """1 sigma of the distance, relative."""
        if self.distance_m is None:
            return None
        return self.inverse_distance_sigma_per_m / self.inverse_distance_per_m

    @property
    def nearest_m(self) -> float:
        """Distance that it has at least, at 3 sigma."""
        most = max(self.inverse_distance_per_m, 0) + _SIGMAS * self.inverse_distance_sigma_per_m
        return 1 / most


def triangulate(sightings: Sequence[Sighting]) -> LampPlace:
    """Fit direction and inverse distance from the first sighting's place (Levenberg–Marquardt).

    Residuals are chords between a lamp's direction as seen and as expected, over their sigma, in
    which the error of the place counts by the distance. Two sightings at least; else ValueError.
    """
    if len(sightings) < 2:
        raise ValueError("triangulate: a lamp's place needs two sightings")
    first = sightings[0]
    direction, inverse = first.direction, _nearest_to_all(sightings)
    cost, gradient, information = _normal_equations(sightings, direction, inverse)
    damping = 0.0
    for _ in range(_STEPS):
        along, over = _tangents(direction)
        basis = _basis(along, over)
        normal = basis.T @ information @ basis
        step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), basis.T @ gradient)
        there = normalize(direction + step[0] * along + step[1] * over)
        further = min(max(inverse + float(step[2]), -_PRIOR_PER_M), _PRIOR_PER_M)
        tried = _normal_equations(sightings, there, further)
        if tried[0] > cost + 1e-9:
            damping = max(10 * damping, 0.1)
            continue
        direction, inverse, damping = there, further, damping / 10
        cost, gradient, information = tried
        if np.abs(step).max() < 1e-7:
            break
    basis = _basis(*_tangents(direction))
    covariance = np.linalg.inv(basis.T @ information @ basis)
    sigma = math.sqrt(covariance[2, 2])
    # The lines of sight do not go backwards.
    behind = (min(inverse, 0.0) / sigma) ** 2
    chi2 = cost - (inverse / _PRIOR_PER_M) ** 2 + behind
    return LampPlace(direction, inverse, sigma, chi2, 2 * len(sightings) - 3)


def _nearest_to_all(sightings: Sequence[Sighting]) -> float:
    """Inverse distance, from the first place, of the point nearest to all lines of sight."""
    first = sightings[0]
    across = [np.eye(3) - np.outer(s.direction, s.direction) for s in sightings]
    normal = np.sum(across, axis=0)
    if np.linalg.cond(normal) > 1e9:  # the lines are parallel
        return 0.0
    sides = [p @ (s.place_m - first.place_m) for p, s in zip(across, sightings, strict=True)]
    along_m = float(np.linalg.solve(normal, np.sum(sides, axis=0)) @ first.direction)
    return 1 / along_m if along_m > 1 / _PRIOR_PER_M else 0.0


def _normal_equations(
    sightings: Sequence[Sighting], direction: Array, inverse: float
) -> tuple[float, Array, Array]:
    """Give cost, its gradient (4,) and information (4, 4): by direction, by inverse distance."""
    cost = (inverse / _PRIOR_PER_M) ** 2
    gradient = np.array([0.0, 0.0, 0.0, inverse / _PRIOR_PER_M**2])
    information = np.diag([0.0, 0.0, 0.0, 1 / _PRIOR_PER_M**2])
    first = sightings[0]
    for sighting in sightings:
        offset_m = sighting.place_m - first.place_m
        # All is seen from the first place, which is at 0 whatever its error: the others have both.
        is_other = sighting is not first
        place_sigma_m = is_other * math.hypot(sighting.place_sigma_m, first.place_sigma_m)
        # The vector to the lamp over its distance from the first place.
        towards = direction - inverse * offset_m
        length = max(float(np.linalg.norm(towards)), 1e-6)
        expected = towards / length
        residual = expected - sighting.direction
        turned = (np.eye(3) - np.outer(expected, expected)) / length
        slope = np.column_stack([turned, turned @ -offset_m])
        sigma = math.hypot(
            math.radians(sighting.direction_sigma_deg),
            place_sigma_m * abs(inverse) / length,  # the distance from this place
        )
        weight = 1 / max(sigma, 1e-9) ** 2
        cost += weight * float(residual @ residual)
        gradient += weight * slope.T @ residual
        information += weight * slope.T @ slope
    return cost, gradient, information


def _tangents(direction: Array) -> tuple[Array, Array]:
    """Two unit vectors across a direction, and across each other."""
    helper = np.array([1.0, 0, 0]) if abs(direction[0]) < 0.7 else np.array([0, 1.0, 0])
    along = normalize(cross(direction, helper))
    return along, cross(direction, along)


def _basis(along: Array, over: Array) -> Array:
    """Columns (4, 3) that the parameters change direction and inverse distance by."""
    basis = np.zeros((4, 3))
    basis[:3, 0], basis[:3, 1], basis[3, 2] = along, over, 1.0
    return basis
