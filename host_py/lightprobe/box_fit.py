"""The room as a box, by the ambient light of probes that stand at several places of it.

The SH that one probe sees, moved through the box (:mod:`lightprobe.room`), are what another one
sees, and the other way round: by that the walls are fitted (Levenberg-Marquardt).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lightprobe import sh as harmonics
from lightprobe.estimate import Room
from lightprobe.geometry import Array
from lightprobe.room import moved, room_at

#: What is known of a wall before any light: its distance (m), and 1 sigma of the logarithm.
_USUAL_WALL_M, _WALL_SIGMA = 2.0, 0.7
#: What a box leaves of the SH, relative to their mean radiance (band 0), 1 sigma.
_MISFIT = 0.01
#: Weight of each band: the higher, the more furniture is in it.
_BANDS = (1.0, 1.0, 0.8, 0.6, 0.45)
#: Of how light changes from one probe to the other, this share is left at other places, 1 sigma:
#: of rooms rendered by Mitsuba, two of nine with a desk in them.
_LEFT = 0.35
_STARTS, _STEPS, _MOST_STEP, _SLOPE = 6, 10, 0.5, 1e-4
_YAW = 6
_NEAREST_WALL_M = 0.1


@dataclass(frozen=True, eq=False)
class Seen:
    """What a probe sees: ambient SH of order 4, and where it is; in the frame of the room."""

    coefficients: Array  # (25, 3)
    place_m: Array  # (3,)
    scale_sigma: float = 0.0  # 1 sigma, relative, of its scale against that of the first probe


def _room(values: Array, error_per_m: float = 0.0) -> Room:
    yaw = float(values[_YAW])
    turn = np.array([0.0, math.sin(yaw / 2), 0.0, math.cos(yaw / 2)])
    return Room(np.exp(values[:6]), np.zeros(6), turn, error_per_m)


class BoxFit:
    """Goes on looking for the box, a little each time; one for a set of probes that stand still."""

    def __init__(self) -> None:
        """Begin knowing nothing."""
        self._best: Array | None = None
        self._start = 0

    def look(self, views: Sequence[Seen]) -> Room | None:
        """Give the room around the first probe, in the frame of the room (level, +Y up).

        None: there is no second probe, or no box says better than unchanged light what it sees.
        Takes some 0.1 s, the first time one second.
        """
        if len(views) < 2 or not all(one.coefficients[0].mean() > 0 for one in views):
            return None
        problem = _Problem(views)
        if self._best is not None and len(self._best) != _YAW + len(views):
            # a probe has come or gone: the walls are as they were
            self._best = np.concatenate([self._best[: _YAW + 1], np.zeros(len(views) - 1)])
        for _ in range(1 if self._best is not None else _STARTS):
            start = problem.start(math.pi / 2 / _STARTS * (self._start - _STARTS // 2))
            self._start = (self._start + 1) % _STARTS
            tried = problem.fit(start)
            if self._best is None or problem.cost(tried) < problem.cost(self._best):
                self._best = tried
        assert self._best is not None
        self._best = problem.fit(self._best)
        return problem.room(self._best)


class _Problem:
    """Parameters: logarithms of the walls' distances, the yaw, logarithms of the scales."""

    def __init__(self, views: Sequence[Seen]) -> None:
        self._first, *self._others = views
        self._mean = float(self._first.coefficients[0].mean())
        weights = np.array(_BANDS)[harmonics.bands(4).astype(int)]
        self._weights = weights[:, None] / (self._mean * _MISFIT)

    def start(self, yaw_rad: float) -> Array:
        """Give a usual room."""
        walls = np.full(6, math.log(_USUAL_WALL_M))
        return np.concatenate([walls, [yaw_rad], np.zeros(len(self._others))])

    def _residual(self, values: Array) -> Array:
        room, left = _room(values), [(values[:6] - math.log(_USUAL_WALL_M)) / _WALL_SIGMA]
        for number, other in enumerate(self._others):
            scale = values[_YAW + 1 + number]
            there = math.exp(scale) * other.coefficients
            way_m = other.place_m - self._first.place_m
            back = room_at(room, way_m)
            left += [
                ((moved(self._first.coefficients, room, way_m) - there) * self._weights).ravel(),
                ((moved(there, back, -way_m) - self._first.coefficients) * self._weights).ravel(),
                np.array([scale / max(other.scale_sigma, 1e-3)]),
            ]
        return np.concatenate(left)

    def _slope(self, values: Array, residual: Array) -> Array:
        """Give the change of the residual by each parameter, as columns."""
        steps = _SLOPE * np.eye(len(values))
        return np.stack([(self._residual(values + by) - residual) / _SLOPE for by in steps], axis=1)

    def cost(self, values: Array) -> float:
        """What is left, in squared sigmas."""
        return float((self._residual(values) ** 2).sum())

    def fit(self, values: Array) -> Array:
        """Go to the nearest minimum, or some way to it."""
        residual, damping = self._residual(values), 1e-2
        for _ in range(_STEPS):
            slope = self._slope(values, residual)
            normal = slope.T @ slope
            damped = normal + damping * np.diag(np.diag(normal) + 1e-9)
            by = np.clip(np.linalg.solve(damped, -slope.T @ residual), -_MOST_STEP, _MOST_STEP)
            tried = self._residual(values + by)
            if tried @ tried < residual @ residual:
                gained = 1 - (tried @ tried) / (residual @ residual)
                values, residual, damping = values + by, tried, damping * 0.3
                if gained < 1e-3:
                    break
            else:
                damping *= 10
        values[:6] = np.maximum(values[:6], math.log(_NEAREST_WALL_M))
        return values

    def room(self, values: Array) -> Room | None:
        """Give the box with what it is worth; None: light is better left unchanged."""
        room = _room(values)
        change = misfit = way2 = 0.0
        for number, other in enumerate(self._others):
            there = math.exp(values[_YAW + 1 + number]) * other.coefficients
            way_m = other.place_m - self._first.place_m
            change += self._square(self._first.coefficients - there)
            misfit += self._square(moved(self._first.coefficients, room, way_m) - there)
            way2 += float(way_m @ way_m)
        if misfit >= change:
            return None
        error = math.sqrt((misfit + _LEFT**2 * change) / way2) / self._irradiance()
        return Room(room.walls_m, self._sigmas_m(values), room.orientation, error)

    def _irradiance(self) -> float:
        """Mean over all normals."""
        return self._mean * harmonics.cosine_lobe(0) / math.sqrt(4 * math.pi)

    @staticmethod
    def _square(coefficients: Array) -> float:
        """Mean square of the irradiance of an SH, over all normals and channels."""
        lobes = np.array([harmonics.cosine_lobe(int(band)) for band in harmonics.bands(4)])
        return float(((lobes[:, None] * coefficients) ** 2).mean(axis=1).sum() / (4 * math.pi))

    def _sigmas_m(self, values: Array) -> Array:
        residual = self._residual(values)
        slope = self._slope(values, residual)
        scatter = max(1.0, float(residual @ residual) / max(len(residual) - len(values), 1))
        variance = np.diag(np.linalg.pinv(slope.T @ slope)) * scatter
        return np.asarray(np.exp(values[:6]) * np.sqrt(variance[:6]))
