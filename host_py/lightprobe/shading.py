"""How surfaces reflect light: the formulas of the viewer's materials, in float64.

Directions are unit vectors (…, 3) that point away from the surface: `normal`, `light` towards the
light, `view` towards the eye, `half` between the last two. Any frame serves; all of one call are in
the same. Shapes broadcast. A BRDF has the unit 1/sr and is without the cosine: radiance towards
the eye = BRDF · E · max(0, normal · light), E: irradiance of a surface that faces the light. Below
the horizon a BRDF is 0.

Sources: [S] the research behind lightprobe, sec. 3.3 (shading of lit surfaces); [AS] Ashikhmin,
Shirley: An Anisotropic Phong BRDF Model, 2000; [AP] Ashikhmin, Premoze: Distribution-based BRDFs,
2007; [B] Blinn 1977; [HG] Giesen: Phong normalization factor derivations, 2009; [SC] Schlick 1994.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lightprobe.geometry import Array, normalize

#: 1 − (normal · half)² below which a half vector counts as the normal, whose exponent is 0/0.
_ON_AXIS = 1e-14


def _dot(a: ArrayLike, b: ArrayLike) -> Array:
    return np.asarray(np.sum(np.asarray(a, float) * np.asarray(b, float), axis=-1))


def half_vector(light: ArrayLike, view: ArrayLike) -> Array:
    """Half vectors (…, 3) [B]; light and view that are opposite have none: ValueError."""
    return normalize(np.asarray(light, float) + np.asarray(view, float))


def reflect(view: ArrayLike, normal: ArrayLike) -> Array:
    """Directions (…, 3) that a mirror shows to the eye."""
    n = np.asarray(normal, float)
    return np.asarray(2 * _dot(view, n)[..., None] * n - np.asarray(view, float))


def refract(view: ArrayLike, normal: ArrayLike, ratio: ArrayLike) -> Array:
    """Directions (…, 3) of what the eye sees through the surface (Snell).

    `ratio`: refractive index on the eye's side over that behind the surface. NaN: total reflection.
    """
    n, e = np.asarray(normal, float), np.asarray(ratio, float)[..., None]
    cosine = _dot(view, n)[..., None]
    root = 1 - e**2 * (1 - cosine**2)
    beyond = np.sqrt(np.where(root < 0, np.nan, root))
    return np.asarray((e * cosine - beyond) * n - e * np.asarray(view, float))


def fresnel_schlick(cosine: ArrayLike, at_normal: ArrayLike) -> Array:
    """Reflectance by Schlick's approximation [SC]; `at_normal`: reflectance straight on."""
    f = np.asarray(at_normal, float)
    return np.asarray(f + (1 - f) * (1 - np.clip(cosine, 0, 1)) ** 5)


def fresnel_dielectric(cosine: ArrayLike, ratio: ArrayLike) -> Array:
    """Reflectance of unpolarized light at a surface without absorption; 1: total reflection.

    `cosine`: of the angle of incidence, ≥ 0; `ratio`: as in :func:`refract`.
    """
    c, e = np.asarray(cosine, float), np.asarray(ratio, float)
    beyond = np.sqrt(np.maximum(1 - e**2 * (1 - c**2), 0))
    across = ((e * c - beyond) / (e * c + beyond)) ** 2
    along = ((c - e * beyond) / (c + e * beyond)) ** 2
    return np.asarray(np.where(e**2 * (1 - c**2) >= 1, 1.0, (across + along) / 2))


def lambert(albedo: ArrayLike) -> Array:
    """Lambert's BRDF, the same in all directions: albedo/π."""
    return np.asarray(np.asarray(albedo, float) / np.pi)


def blinn_phong(normal: ArrayLike, light: ArrayLike, view: ArrayLike, power: ArrayLike) -> Array:
    """Blinn–Phong as a BRDF that reflects, straight on, all that it gets: c (n·h)^p [B].

    c = (p + 2)(p + 4) / (8π (p + 2^(−p/2))) [HG]. The usual (p + 8)/(8π) adds up to 8 % of energy
    (power 8); [S] uses (n·h)^p alone, with a factor that the artist chooses.
    """
    p = np.asarray(power, float)
    scale = (p + 2) * (p + 4) / (8 * np.pi * (p + 2.0 ** (-p / 2)))
    cosine = np.maximum(_dot(normal, half_vector(light, view)), 0)
    return np.asarray(_above(normal, light, view) * scale * cosine**p)


def _above(normal: ArrayLike, light: ArrayLike, view: ArrayLike) -> Array:
    return np.asarray((_dot(normal, light) > 0) & (_dot(normal, view) > 0), float)


def _lobe(normal: Array, half: Array, tangent: Array, powers: tuple[float, float]) -> Array:
    """Ashikhmin and Shirley's anisotropic lobe, 1 for half vectors along the normal [AS (7)]."""
    cosine = np.clip(_dot(normal, half), 0, 1)
    along, across = _dot(half, tangent) ** 2, _dot(half, np.cross(normal, tangent)) ** 2
    sine2 = along + across
    power = (powers[0] * along + powers[1] * across) / np.maximum(sine2, _ON_AXIS)
    return np.asarray(np.where(sine2 > _ON_AXIS, cosine**power, 1.0))


def _highlight(
    normal: ArrayLike,
    light: ArrayLike,
    view: ArrayLike,
    tangent: ArrayLike,
    powers: tuple[float, float],
    at_normal: ArrayLike,
) -> tuple[Array, Array]:
    """What both anisotropic BRDFs begin with: lobe · Fresnel, 0 below the horizon; view · half."""
    half = half_vector(light, view)
    seen = _dot(view, half)
    lobe = _lobe(np.asarray(normal, float), half, np.asarray(tangent, float), powers)
    return _above(normal, light, view) * lobe * fresnel_schlick(seen, at_normal), seen


def _divide(above: Array, below: Array) -> Array:
    """0 where the numerator is 0: below the horizon the denominator may be 0, too."""
    return above / np.where(above > 0, below, 1.0)


def ashikhmin_shirley(
    normal: ArrayLike,
    light: ArrayLike,
    view: ArrayLike,
    tangent: ArrayLike,
    powers: tuple[float, float],
    at_normal: ArrayLike,
) -> Array:
    """Specular part of Ashikhmin and Shirley's anisotropic BRDF [AS (4)], as [S] uses it.

    `tangent`: unit, at a right angle to the normal; `powers`: of the lobe along it and across;
    `at_normal`: reflectance straight on, scalar or broadcast.
    """
    highlight, seen = _highlight(normal, light, view, tangent, powers, at_normal)
    scale = np.sqrt((powers[0] + 1) * (powers[1] + 1)) / (8 * np.pi)
    return _divide(scale * highlight, seen * np.maximum(_dot(normal, light), _dot(normal, view)))


def ashikhmin_premoze(
    normal: ArrayLike,
    light: ArrayLike,
    view: ArrayLike,
    tangent: ArrayLike,
    powers: tuple[float, float],
    at_normal: ArrayLike,
) -> Array:
    """Silver and copper: the same lobe in Premoze's form [AP], bright at grazing angles.

    The lobe is a density of half vectors (∫ p (n·h) dω = 1), so that the constant is 1/4.
    Parameters are those of :func:`ashikhmin_shirley`.
    """
    highlight, _ = _highlight(normal, light, view, tangent, powers, at_normal)
    density = np.sqrt((powers[0] + 2) * (powers[1] + 2)) / (2 * np.pi)
    lit, seen = _dot(normal, light), _dot(normal, view)
    return _divide(density / 4 * highlight, lit + seen - lit * seen)
