"""Radiance from spherical harmonics (SH) that is nowhere negative and has the same irradiance.

SH of a low order swing below zero behind strong light. A picture cannot hold negative light, and a
picture whose negative values are set to zero lights a surface too brightly. So this module finds
the coefficients c for which max(0, Σ c_i Y_i) has the SH of the packet. Among all radiance that is
not negative and has these SH it is the one with the smallest mean square.
"""

from __future__ import annotations

import functools

import numpy as np

from lightprobe import sh
from lightprobe.geometry import Array, sphere_normals

#: Nodes of the quadrature, exact for polynomials up to degree 39; clipped ones are not polynomials.
_RINGS = 20
_STEPS = 30
#: The fit ends when no coefficient is off by more than this share of the mean radiance.
_CLOSE = 1e-5
#: Where the fit is off by more than this, no radiance has these SH.
_NONE = 1e-3
#: What each coefficient costs then. The less, the closer the fit, and the brighter single places.
_COST = 1e-3
#: How far the Newton step may be shortened.
_SHORTEST = 2.0**-20


@functools.cache
def _nodes(order: int) -> tuple[Array, Array]:
    """Basis (N, (order+1)²) and solid angle (N,) in sr at the nodes of a product quadrature."""
    z, weight = np.polynomial.legendre.leggauss(_RINGS)
    longitude = 2 * np.pi * np.arange(2 * _RINGS) / (2 * _RINGS)
    ring = np.sqrt(1 - z * z)[:, None]
    points = np.stack(
        [
            ring * np.cos(longitude),
            ring * np.sin(longitude),
            np.broadcast_to(z[:, None], (_RINGS, 2 * _RINGS)),
        ],
        axis=-1,
    )
    solid_angles_sr = np.repeat(weight * np.pi / _RINGS, 2 * _RINGS)
    return sh.evaluate(order, points.reshape(-1, 3)), solid_angles_sr


def fit(coefficients: Array) -> Array:
    """Coefficients c ((order+1)², 3) such that max(0, Σ c_i Y_i) has the given SH.

    `coefficients`: ((order+1)², 3) of radiance, probe frame. Where no radiance has these SH (they
    come from noise, or were moved to a place), the result is close to them, with a small mean
    square; :func:`irradiance_error` says how close. Each channel is the minimum of a convex
    function, found by Newton's method.
    """
    given = np.asarray(coefficients, dtype=np.float64)
    return np.stack([_fit_channel(channel) for channel in given.T], axis=-1)


def _fit_channel(wanted: Array) -> Array:
    """Fit one channel; with a cost where no radiance has these SH, and the fit has no end."""
    if not wanted[0] > 0:  # no light at all, on average
        return np.zeros_like(wanted)
    target = wanted / wanted[0]
    c, error = _minimum(target, 0.0)
    if error > _NONE:
        c, _ = _minimum(target, _COST)
    return np.asarray(c * wanted[0])


def _minimum(target: Array, cost: float) -> tuple[Array, float]:
    """Minimum over c of ½ ∫ max(0, c·Y)² dω − c·target + ½ cost c·c, and its largest gradient.

    Without a cost the gradient is the error of the SH.
    """
    basis, solid_angles_sr = _nodes(sh.order_of(target))
    c, gradient = target.copy(), target
    for _ in range(_STEPS):
        radiance = np.maximum(basis @ c, 0)
        gradient = basis.T @ (solid_angles_sr * radiance) - target + cost * c
        if np.abs(gradient).max() < _CLOSE:
            break
        lit = radiance > 0
        curvature = (basis[lit] * solid_angles_sr[lit, None]).T @ basis[lit]
        curvature += max(1e-9, cost) * np.eye(len(c))
        step = np.asarray(np.linalg.solve(curvature, gradient), np.float64)
        c = _downhill(c, step, target, cost)
    return c, float(np.abs(gradient).max())


def _downhill(c: Array, step: Array, target: Array, cost: float) -> Array:
    """Go along −step, half as far until the function falls."""
    basis, solid_angles_sr = _nodes(sh.order_of(target))

    def value(at: Array) -> float:
        squares = float(solid_angles_sr @ np.maximum(basis @ at, 0) ** 2)
        return float(squares / 2 - at @ target + cost / 2 * at @ at)

    start, share = value(c), 1.0
    while share > _SHORTEST and not value(c - share * step) <= start:
        share /= 2
    return np.asarray(c - share * step) if share > _SHORTEST else c


def irradiance_error(coefficients: Array, fitted: Array) -> float:
    """Largest error of irradiance over all normals, as a share of the largest irradiance.

    `coefficients`: ((order+1)², 3) of the packet; `fitted`: what :func:`fit` gave.
    """
    basis, solid_angles_sr = _nodes(sh.order_of(coefficients))
    made = (basis * solid_angles_sr[:, None]).T @ np.maximum(basis @ fitted, 0)
    normals = sphere_normals(2)
    wanted = sh.irradiance(coefficients, normals)
    off = np.abs(sh.irradiance(made, normals) - wanted).max()
    return float(off / max(wanted.max(), np.finfo(np.float64).tiny))
