"""What an app draws by a packet, against what the true light draws: one error for each way to draw.

* diffuse: a white sphere; root mean square of its irradiance's error, of the true mean.
* shadows: a table under a ball as large as its distance; the light on it, of what is there without
  the ball; root mean square.
* glossy, mirrors: what a surface of 15° or 1.5° of blur shows, in all directions, on a screen
  (L / (L + mean)); root mean square.

An app has no more than the packet: lamps with their size, SH, and a reflection map if it asked for
one. Each error is of the light alone: the app draws without an error of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from lightprobe import geometry, sh
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, Light
from lightprobe.evaluate.metrics import relighting_relative
from lightprobe.geometry import Array
from lightprobe.reflection_map import ReflectionMap, directions, solid_angles
from lightprobe.trade import GLOSSY_DEG, MIRROR_DEG
from numpy.typing import NDArray

NORMALS = geometry.sphere_normals(2)
#: Map over which true light is summed; of lights and SH, too.
WIDTH_PX = 512
#: Directions in which surfaces are looked at; points on the table.
_VIEWS, _POINTS = geometry.fibonacci_sphere(400), 10
_BALL_M, _HEIGHT_M, _REACH_M = 1.0, 1.2, 3.0
#: Directions over a lamp's disc.
_RAYS = 19


@dataclass(frozen=True, eq=False)
class Sources:
    """Light as points: directions (N, 3), and what each brings as luminance times solid angle."""

    directions: Array
    flux: Array  # (N,)


@cache
def _sphere() -> tuple[Array, Array]:
    """Give directions (N, 3) and solid angles (N,) of a map's pixels."""
    towards = geometry.equirect_directions(WIDTH_PX, WIDTH_PX // 2).reshape(-1, 3)
    return towards, np.repeat(geometry.equirect_solid_angles(WIDTH_PX, WIDTH_PX // 2), WIDTH_PX)


def of_picture(radiance: NDArray[np.float32]) -> Sources:
    """Give a map (WIDTH_PX / 2, WIDTH_PX, 3) as sources."""
    towards, solid_angle = _sphere()
    return Sources(towards, luminance(radiance.reshape(-1, 3).astype(float)) * solid_angle)


def of_map(reflection: ReflectionMap) -> Sources:
    """Give a reflection map as sources."""
    flux = luminance(reflection.radiance.astype(float)) * solid_angles(reflection.size)
    return Sources(directions(reflection.size).reshape(-1, 3), flux.reshape(-1))


def of_packet(estimate: Estimate) -> Sources:
    """Give a packet's lights and SH as sources; SH below 0 are 0."""
    towards, solid_angle = _sphere()
    basis = _basis(estimate.sh.order)
    around = np.maximum(basis @ luminance(np.asarray(estimate.sh.coefficients, float)), 0)
    parts = [Sources(towards, around * solid_angle)]
    parts += [_of_light(light) for light in estimate.beside_sh]
    return Sources(
        np.concatenate([part.directions for part in parts]),
        np.concatenate([part.flux for part in parts]),
    )


@cache
def _basis(order: int) -> Array:
    return sh.evaluate(order, _sphere()[0])


def _of_light(light: Light) -> Sources:
    """Give a light as rays over its disc, or its ellipse."""
    along = geometry.normalize(np.asarray(light.direction, float))
    across = light.axis
    if across is None:
        across = np.cross(along, [1.0, 0.0, 0.0] if abs(along[0]) < 0.7 else [0.0, 1.0, 0.0])
    first = geometry.normalize(np.asarray(across, float))
    second = np.cross(along, first)
    halves = light.half_angle_deg or (
        light.angular_radius_deg,
        light.angular_radius_deg,
    )
    k = np.arange(_RAYS) + 0.5
    radius, phi = np.sqrt(k / _RAYS), math.pi * (1 + math.sqrt(5)) * k
    out = [np.tan(np.radians(min(half, 89.0))) * radius for half in halves]
    rays = (
        along + (out[0] * np.cos(phi))[:, None] * first + (out[1] * np.sin(phi))[:, None] * second
    )
    share = float(luminance(light.irradiance)) / _RAYS
    return Sources(geometry.normalize(rays), np.full(_RAYS, share))


def diffuse(true_irradiance: Array, estimate: Estimate) -> float:
    """Give the error on a white sphere; `true_irradiance` (N, 3) on NORMALS."""
    return relighting_relative(true_irradiance, estimate.irradiance(NORMALS))


def table(light: Sources) -> tuple[Array, float]:
    """Give the light at points of the table under the ball, and without the ball."""
    up = light.directions[:, 1] > 0
    towards, flux = light.directions[up], light.flux[up] * light.directions[up][:, 1]
    grid = np.linspace(-_REACH_M, _REACH_M, _POINTS)
    found = []
    for x in grid:
        for z in grid:
            centre = np.array([-x, _HEIGHT_M, -z])  # from the point
            way = towards @ centre
            hits = (way > 0) & (centre @ centre - way**2 < _BALL_M**2)
            found.append(float(flux[~hits].sum()))
    return np.array(found), float(flux.sum())


def shown(light: Sources, blur_deg: float) -> Array:
    """Give radiance (N,) as a surface shows it: within a lobe around each of _VIEWS."""
    kappa = np.radians(blur_deg) ** -2.0
    norm = kappa / (2 * math.pi * (1 - math.exp(-2 * kappa)))
    radiance = np.empty(len(_VIEWS))
    for k, view in enumerate(_VIEWS):
        cosine = light.directions @ view
        near = cosine > 1 - 12 / kappa
        lobe = norm * np.exp(kappa * (cosine[near] - 1))
        radiance[k] = float(light.flux[near] @ lobe)
    return radiance


@dataclass(frozen=True, eq=False)
class Truth:
    """What the true light draws."""

    irradiance: Array  # (N, 3) on NORMALS
    table: Array
    open_table: float
    shown: dict[float, Array]  # by blur
    mean: float  # radiance

    @classmethod
    def of(cls, irradiance: Array, radiance: NDArray[np.float32]) -> Truth:
        """Take it of exact irradiance, and a map (WIDTH_PX / 2, WIDTH_PX, 3)."""
        light = of_picture(radiance)
        shadow, open_table = table(light)
        blurred = {blur: shown(light, blur) for blur in (GLOSSY_DEG, MIRROR_DEG)}
        return cls(
            irradiance,
            shadow,
            open_table,
            blurred,
            float(light.flux.sum() / 4 / math.pi),
        )

    def _on_screen(self, radiance: Array) -> Array:
        return np.asarray(radiance / (radiance + self.mean))

    def errors(self, estimate: Estimate, reflection: ReflectionMap | None) -> dict[str, float]:
        """Give the errors of a packet, and of what is mirrored by a map of TOTAL if there is."""
        light = of_packet(estimate)
        shadow = table(light)[0] / self.open_table - self.table / self.open_table
        mirrored = light if reflection is None else of_map(reflection)
        glossy, mirrors = (
            self._on_screen(shown(mirrored, blur)) - self._on_screen(self.shown[blur])
            for blur in (GLOSSY_DEG, MIRROR_DEG)
        )
        return {
            "diffuse": diffuse(self.irradiance, estimate),
            **{
                name: float(np.sqrt(np.mean(off**2)))
                for name, off in (
                    ("shadows", shadow),
                    ("glossy", glossy),
                    ("mirrors", mirrors),
                )
            },
        }
