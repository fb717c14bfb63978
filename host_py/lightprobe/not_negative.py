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
    come from noise), the result is the closest that was found; :func:`irradiance_error` says how
    close. Each channel is the minimum of a convex function, found by Newton's method.
    """
    given = np.asarray(coefficients, dtype=np.float64)
    return np.stack([_fit_channel(channel) for channel in given.T], axis=-1)


def _fit_channel(wanted: Array) -> Array:
    """Minimum over c of ½ ∫ max(0, c·Y)² dω − c·wanted, whose gradient is the error of the SH."""
    if not wanted[0] > 0:  # no light at all, on average
        return np.zeros_like(wanted)
    basis, solid_angles_sr = _nodes(sh.order_of(wanted))
    target = wanted / wanted[0]
    c = target.copy()
    for _ in range(_STEPS):
        radiance = np.maximum(basis @ c, 0)
        error = basis.T @ (solid_angles_sr * radiance) - target
        if np.abs(error).max() < _CLOSE:
            break
        lit = radiance > 0
        curvature = (basis[lit] * solid_angles_sr[lit, None]).T @ basis[lit]
        curvature += 1e-9 * np.eye(len(c))
        step = np.linalg.solve(curvature, error)
        c = _downhill(c, step, target, basis, solid_angles_sr)
    return np.asarray(c * wanted[0])


def _downhill(c: Array, step: Array, target: Array, basis: Array, weights: Array) -> Array:
    """Go along −step, half as far until the function falls."""

    def value(at: Array) -> float:
        return float(weights @ np.maximum(basis @ at, 0) ** 2 / 2 - at @ target)

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
