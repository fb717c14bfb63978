"""Procedural scenes: lamps of drawn direction, size, colour and power over a gradient."""

from __future__ import annotations

import numpy as np

from lightprobe import geometry, sh
from lightprobe.colour import luminance
from lightprobe.geometry import Array
from lightprobe.lamp import Lamp
from lightprobe.sim.scene import ProceduralScene

RADIUS_DEG = (0.25, 7.5)
#: Radiances of one scene's lamps lie within this factor, so that one exposure sees them all.
_CONTRAST = 100.0
#: Every lamp casts at least this share of the light on a surface that faces it.
_LEAST_SHARE = 0.05


def random_scene(seed: int) -> ProceduralScene:
    """Draw scene number `seed`: 1–5 lamps, 0.5°–15° across, anywhere; every number its own scene.

    The first lamp of every fourth scene is put near the zenith, the nadir or the seam, where
    panoramas are hardest. Lamps stand apart by more than their own widths.
    """
    rng = np.random.default_rng([seed, 0x5CE9E])
    while True:
        scene = _draw(seed, rng)
        if _fair(scene):
            return scene


def _draw(seed: int, rng: np.random.Generator) -> ProceduralScene:
    number = 1 + seed % 5
    radii = np.exp(rng.uniform(np.log(RADIUS_DEG[0]), np.log(RADIUS_DEG[1]), number))
    directions = _directions(seed, radii, rng)
    strength = np.exp(rng.uniform(np.log(0.3), np.log(3.0), number))
    radiance = strength / geometry.cap_solid_angle_sr(radii)
    radiance = np.maximum(radiance, radiance.max() / _CONTRAST)
    strength = radiance * geometry.cap_solid_angle_sr(radii)
    lamps = tuple(
        Lamp(direction, float(radius), power * _tint(rng))
        for direction, radius, power in zip(directions, radii, strength, strict=True)
    )
    ambient = float(np.exp(rng.uniform(np.log(0.5), np.log(3.0)))) * strength.sum() / np.pi
    return ProceduralScene(f"procedural-{seed}", _gradient(ambient, rng), lamps)


def _tint(rng: np.random.Generator) -> Array:
    """Colour of luminance 1, from candle to sky."""
    rgb = np.array([rng.uniform(0.8, 1.5), 1.0, rng.uniform(0.4, 1.3)])
    return np.asarray(rgb / luminance(rgb))


def _gradient(mean: float, rng: np.random.Generator) -> Array:
    """SH (9, 3) of a positive gradient with the given mean luminance."""
    shape = rng.normal(size=9) * [0, 1, 1, 1, 0.5, 0.5, 0.5, 0.5, 0.5]
    depth = np.abs(sh.radiance(shape, geometry.sphere_normals(2))).max()
    shape *= rng.uniform(0.2, 0.7) / depth
    shape[0] = 1 / sh.evaluate(0, [0, 0, 1.0])[0]
    return np.outer(shape, mean * _tint(rng))


def _directions(seed: int, radii: Array, rng: np.random.Generator) -> list[Array]:
    """Directions that keep apart; the first one at a hard place in most scenes."""
    chosen: list[Array] = []
    while len(chosen) < len(radii):
        candidate = geometry.normalize(rng.normal(size=3))
        if not chosen:
            candidate = _hard_place(seed, candidate, rng)
        radius = radii[len(chosen)]
        gaps = [
            float(geometry.angle_deg(candidate, other)) - 1.5 * (radius + radii[i])
            for i, other in enumerate(chosen)
        ]
        if min(gaps, default=90) > 12:
            chosen.append(candidate)
    return chosen


def _hard_place(seed: int, otherwise: Array, rng: np.random.Generator) -> Array:
    azimuth_deg, near = rng.uniform(-180, 180), rng.uniform(0, 1.5)
    places = {
        0: geometry.direction_from_angles(azimuth_deg, 90 - near),
        1: geometry.direction_from_angles(azimuth_deg, near - 90),
        2: geometry.direction_from_angles(180 + rng.uniform(-1, 1), rng.uniform(-60, 60)),
    }
    return places.get(seed // 5 % 4, otherwise)


def _fair(scene: ProceduralScene) -> bool:
    """Say whether every lamp matters where it faces."""
    truth = scene.truth(np.ones(len(scene.lamps)))
    facing = truth.irradiance([lamp.direction for lamp in scene.lamps])
    own = np.array([luminance(lamp.irradiance) for lamp in scene.lamps])
    return bool(np.all(own >= _LEAST_SHARE * luminance(facing)))
