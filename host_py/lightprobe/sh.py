"""Real spherical harmonics (SH) of incident radiance, in float64.

Basis (docs/users/conventions.md): real, orthonormal, no Condon–Shortley sign, index i = l(l+1) + m,
polar axis +Z of the probe frame: Y0 = .282095; Y1..3 = .488603·(y, z, x); …
Coefficients have shape ((order+1)², channels) or ((order+1)²,).
"""

from __future__ import annotations

import math
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from lightprobe.geometry import Array, equirect_direction, equirect_solid_angles, rotation_matrix

#: Highest order this module computes.
MAX_ORDER = 8
#: Directions that are computed at a time: what is at work stays in the cache.
_BLOCK = 4096


def count(order: int) -> int:
    """Give the number of coefficients up to and with `order`."""
    return (order + 1) ** 2


def order_of(coefficients: ArrayLike) -> int:
    """Order of a coefficient array, from its length; ValueError when that is no (order+1)²."""
    length = np.shape(coefficients)[0]
    order = math.isqrt(length) - 1
    if length == 0 or count(order) != length:
        raise ValueError(f"sh: {length} coefficients: expected 1, 4, 9, 16, … ((order+1)²)")
    return order


def bands(order: int) -> Array:
    """Degree l of each coefficient: 0, 1, 1, 1, 2, …"""
    return np.repeat(np.arange(order + 1), 2 * np.arange(order + 1) + 1).astype(np.float64)


def evaluate(order: int, directions: ArrayLike) -> Array:
    """Y_i of directions (…, 3): shape (…, (order+1)²).

    Recurrences of the associated Legendre functions without their sin^m factor, which
    (x + iy)^m brings in (Sloan, "Efficient Spherical Harmonic Evaluation", JCGT 2013).
    """
    if not 0 <= order <= MAX_ORDER:
        raise ValueError(f"sh: order {order}: expected 0…{MAX_ORDER}")
    d = np.asarray(directions, dtype=np.float64)
    flat = d.reshape(-1, d.shape[-1])
    out = np.empty((len(flat), count(order)))
    for first in range(0, len(flat), _BLOCK):
        block = slice(first, first + _BLOCK)
        out[block] = _basis(order, flat[block]).T
    return out.reshape((*d.shape[:-1], count(order)))


def _basis(order: int, directions: Array) -> Array:
    """Y_i of directions (N, 3): shape ((order+1)², N)."""
    x, y, z = np.ascontiguousarray(directions.T)
    out = np.empty((count(order), len(x)))
    cosine, sine = np.ones_like(x), np.zeros_like(x)  # Re and Im of (x + iy)^m
    diagonal = 1.0  # Q_m^m = (2m − 1)!!
    for m in range(order + 1):
        before, here = np.zeros_like(z), np.full_like(z, diagonal)
        for degree in range(m, order + 1):
            scale = _norm(degree, m)
            centre = degree * (degree + 1)
            out[centre + m] = scale * here * cosine
            if m:
                out[centre - m] = scale * here * sine
            following = ((2 * degree + 1) * z * here - (degree + m) * before) / (degree - m + 1)
            before, here = here, following
        cosine, sine = x * cosine - y * sine, x * sine + y * cosine
        diagonal *= 2 * m + 1
    return out


@cache
def _norm(degree: int, m: int) -> float:
    """Orthonormal scale of Y_lm; √2 of the real form included for m > 0."""
    ratio = math.factorial(degree - m) / math.factorial(degree + m)
    return math.sqrt((2 * degree + 1) / (4 * math.pi) * ratio * (2 if m else 1))


def cosine_lobe(degree: int) -> float:
    """A_l of Ramamoorthi and Hanrahan (2001): π, 2π/3, π/4, 0, −π/24, 0, …"""
    if degree == 1:
        return 2 * math.pi / 3
    if degree % 2:
        return 0.0
    half = degree // 2
    sign = -1 if half % 2 == 0 else 1
    return (
        2 * math.pi * sign * math.comb(degree, half) / ((degree + 2) * (degree - 1) * 2.0**degree)
    )


def irradiance(coefficients: ArrayLike, normals: ArrayLike) -> Array:
    """E(n) = Σ A_l L_i Y_i(n) at normals (…, 3): shape (…, channels) or (…,)."""
    c = np.asarray(coefficients, dtype=np.float64)
    order = order_of(c)
    lobes = np.array([cosine_lobe(int(degree)) for degree in bands(order)])
    return np.asarray((evaluate(order, normals) * lobes) @ c)


def radiance(coefficients: ArrayLike, directions: ArrayLike) -> Array:
    """Band-limited radiance Σ L_i Y_i(d) at directions (…, 3); may ring below zero."""
    c, d = np.asarray(coefficients, dtype=np.float64), np.asarray(directions, dtype=np.float64)
    order, flat = order_of(c), d.reshape(-1, d.shape[-1])
    found = np.empty((len(flat), *c.shape[1:]))
    for first in range(0, len(flat), _BLOCK):
        block = slice(first, first + _BLOCK)
        found[block] = _basis(order, flat[block]).T @ c
    return found.reshape((*d.shape[:-1], *c.shape[1:]))


def project(image: ArrayLike, order: int) -> Array:
    """Coefficients ((order+1)², channels) of an equirectangular radiance map (H, W, channels).

    Every pixel counts with its exact solid angle and the basis at its centre; sums in float64.
    """
    pixels = np.asarray(image)
    if pixels.ndim != 3:
        raise ValueError(f"sh: project: shape {pixels.shape}: expected (height, width, channels)")
    height, width, channels = pixels.shape
    solid_angle = equirect_solid_angles(width, height)
    total = np.zeros((count(order), channels))
    rows = max(1, 2**21 // (width * count(order)))  # about 16 MB of basis at a time
    columns = np.arange(width)[None, :]
    for top in range(0, height, rows):
        band = slice(top, min(top + rows, height))
        row = np.arange(band.start, band.stop)[:, None]
        basis = evaluate(order, equirect_direction(columns, row, width, height))
        weighted = basis * solid_angle[band, None, None]
        total += weighted.reshape(-1, count(order)).T @ pixels[band].reshape(-1, channels).astype(
            np.float64
        )
    return total


def lamp(direction: ArrayLike, order: int, radius_deg: float = 0.0) -> Array:
    """Coefficients ((order+1)²,) of a disc lamp with ∫ L dω = 1; radius 0 is a point.

    A disc damps band l by the mean of P_l over its cap; Gauss's rule gives it exactly (degree
    ≤ 15) and, unlike the difference of two Legendre polynomials, for tiny discs too.
    """
    nodes, weights = np.polynomial.legendre.leggauss(MAX_ORDER)
    half_cap = math.sin(math.radians(radius_deg) / 2) ** 2  # (1 − cos r) / 2
    cosines = 1 - half_cap * (1 - nodes)
    shares = np.polynomial.legendre.legvander(cosines, order).T @ weights / 2
    return np.asarray(evaluate(order, direction) * shares[bands(order).astype(int)])


def rotate(coefficients: ArrayLike, quaternion_wxyz: ArrayLike) -> Array:
    """Coefficients of the scene turned by a quaternion: f'(d) = f(R⁻¹ d).

    By quadrature that is exact for products of two functions of this order (Gauss–Legendre in z,
    even steps in longitude), so the only error is rounding.
    """
    c = np.asarray(coefficients, dtype=np.float64)
    order = order_of(c)
    z, weight = np.polynomial.legendre.leggauss(order + 1)
    longitude = 2 * np.pi * np.arange(2 * order + 1) / (2 * order + 1)
    ring = np.sqrt(1 - z * z)[:, None]
    nodes = np.stack(
        [
            ring * np.cos(longitude),
            ring * np.sin(longitude),
            np.broadcast_to(z[:, None], (len(z), len(longitude))),
        ],
        axis=-1,
    ).reshape(-1, 3)
    weights = np.repeat(weight * 2 * np.pi / len(longitude), len(longitude))
    turned_back = nodes @ rotation_matrix(quaternion_wxyz)  # R⁻¹ d, row vectors
    return np.asarray(
        (evaluate(order, nodes) * weights[:, None]).T @ (evaluate(order, turned_back) @ c)
    )


def window(
    coefficients: ArrayLike, kind: Literal["hann", "lanczos"] = "hann", width: float | None = None
) -> Array:
    """Damp high bands against ringing; `width` is the first band that vanishes (order + 1).

    hann: ½(1 + cos(πl/w)); lanczos: sinc(l/w) (Sloan, "Stupid Spherical Harmonics Tricks", 2008).
    """
    c = np.asarray(coefficients, dtype=np.float64)
    order = order_of(c)
    reach = bands(order) / (order + 1 if width is None else width)
    if kind == "hann":
        gain = 0.5 * (1 + np.cos(np.pi * np.minimum(reach, 1)))
    elif kind == "lanczos":
        gain = np.where(reach < 1, np.sinc(reach), 0.0)
    else:
        raise ValueError(f"sh: window {kind!r}: expected hann or lanczos")
    return np.asarray((c.T * gain).T)
