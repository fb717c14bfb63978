# SPDX-License-Identifier: Apache-2.0
"""Radiance of a surface by lightprobe.shading: what materials.test.ts compares the viewer with.

Reads JSON on standard input: `surface` (the fields of Surface in web/surface.ts), `normals` (n, 3),
seen along ±z from the side that they face, `lights` (direction, irradiance), `coefficients` of the
SH, `map` (size, faces) or null. Writes one [r, g, b] per normal, null where the map would be read
across an edge of the cube.
"""

import json
import sys
from math import ceil, floor
from typing import Any

import numpy as np
from lightprobe import reflection_map, sh, shading
from lightprobe.geometry import Array, normalize


def mip_level(faces: Array, level: int) -> Array:
    """Faces (6, size, size, 3) averaged 2 by 2, `level` times."""
    for _ in range(level):
        half = faces.shape[1] // 2
        faces = faces.reshape(6, half, 2, half, 2, 3).mean(axis=(2, 4))
    return faces


def bilinear(faces: Array, towards: Array) -> Array:
    """Radiance along directions (n, 3); NaN where texels of another face would be needed."""
    size = faces.shape[1]
    centres = reflection_map.directions(size)
    face = reflection_map.texels(towards, size)[0]
    # A direction's place on the face, from the centres of two opposite texels, scaled to the face.
    corner, opposite = centres[face, 0, 0], centres[face, size - 1, size - 1]
    main = corner + opposite
    main = main / np.linalg.norm(main, axis=-1, keepdims=True)
    on_face = towards / np.sum(towards * main, axis=-1, keepdims=True)
    right = normalize(centres[face, 0, size - 1] - corner)
    down = normalize(centres[face, size - 1, 0] - corner)
    places = [np.sum(on_face * axis, axis=-1) for axis in (down, right)]
    y, x = ((place + 1) / 2 * size - 0.5 for place in places)
    y0, x0 = np.floor(y).astype(int), np.floor(x).astype(int)
    at_edge = (np.minimum(y0, x0) < 0) | (np.maximum(y0, x0) > size - 2)
    y0, x0 = np.clip(y0, 0, size - 2), np.clip(x0, 0, size - 2)
    v, u = (y - y0)[:, None], (x - x0)[:, None]
    upper = (1 - u) * faces[face, y0, x0] + u * faces[face, y0, x0 + 1]
    lower = (1 - u) * faces[face, y0 + 1, x0] + u * faces[face, y0 + 1, x0 + 1]
    return np.where(at_edge[:, None], np.nan, (1 - v) * upper + v * lower)


def surroundings(scene: dict[str, Any], towards: Array) -> Array:
    """Radiance that comes from directions (n, 3)."""
    if scene["map"] is None:
        return np.maximum(sh.radiance(np.reshape(scene["coefficients"], (-1, 3)), towards), 0)
    size, detail = scene["map"]["size"], scene["surface"]["detail"]
    faces = np.reshape(scene["map"]["faces"], (6, size, size, 3))
    fine, coarse = (bilinear(mip_level(faces, f(detail)), towards) for f in (floor, ceil))
    return (1 - detail % 1) * fine + detail % 1 * coarse


def highlight(surface: dict[str, Any], normal: Array, light: Array, view: Array) -> Array:
    """BRDF (n, 3) of what is not Lambert's."""
    form, powers, at_normal = surface["highlight"], surface["powers"], surface["atNormal"]
    if form == "none":
        return np.zeros_like(normal)
    if form == "blinn-phong":
        return shading.blinn_phong(normal, light, view, powers[0])[:, None] * at_normal
    brdf = {
        "ashikhmin-shirley": shading.ashikhmin_shirley,
        "premoze": shading.ashikhmin_premoze,
    }[form]
    tangent = normalize(np.cross([0.0, 1.0, 0.0], normal))  # brushed in circles about the vertical
    parts = [brdf(normal, light, view, tangent, tuple(powers), f) for f in at_normal]
    return np.stack(parts, axis=-1)


def shaded(scene: dict[str, Any]) -> Array:
    """Radiance (n, 3) towards the eye."""
    surface, normal = scene["surface"], np.array(scene["normals"])
    view = np.sign(normal[:, 2:]) * [0.0, 0.0, 1.0]
    albedo = shading.lambert(surface["albedo"])
    radiance = albedo * sh.irradiance(np.reshape(scene["coefficients"], (-1, 3)), normal)
    for lamp in scene["lights"]:
        light = np.broadcast_to(normalize(lamp["direction"]), normal.shape)
        cosine = np.maximum(np.sum(normal * light, axis=-1), 0)[:, None]
        brdf = albedo + highlight(surface, normal, light, view)
        radiance = radiance + brdf * cosine * lamp["irradiance"]
    seen = np.sum(normal * view, axis=-1)[:, None]
    share = shading.fresnel_schlick(seen, surface["atNormal"])
    if surface["reflection"]:
        reflected = surroundings(scene, shading.reflect(view, normal))
        radiance = radiance + surface["reflection"] * share * reflected
    if surface["refraction"]:
        refracted = surroundings(scene, shading.refract(view, normal, surface["indexRatio"]))
        radiance = radiance + surface["refraction"] * (1 - share) * refracted
    return np.asarray(radiance)


if __name__ == "__main__":
    found = shaded(json.load(sys.stdin))
    json.dump([None if np.isnan(rgb).any() else rgb.tolist() for rgb in found], sys.stdout)
