"""A furnished room, by Mitsuba 3: what a camera sees there, and what a probe would.

+X right, +Y up, −Z ahead, metres; the foot of the object is the origin, the table's top is y = 0.
Radiance is linear sRGB.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import mitsuba as mi
import numpy as np
from lightprobe import geometry, reflection_map
from lightprobe.geometry import Array
from lightprobe.local import ArCamera

mi.set_variant("scalar_rgb")
_PLACE = mi.ScalarTransform4f
#: Half the room's width and length, and where its floor and ceiling are.
_HALF_X, _HALF_Z, _FLOOR, _CEILING = 2.0, 2.5, -0.75, 1.85
RADIUS_M = 0.07
PICTURE_PX = (200, 150)
_EYE, _LOOKS_AT, _FIELD_DEG = (0.16, 0.42, 0.72), (0.02, 0.045, 0.03), 23.0
#: Where the probe's camera is: a hand above the object's foot.
PROBE_M = (0.0, 0.15, 0.0)
_FACE_PX = 256


@dataclass(frozen=True)
class Place:
    """Where in the room the object stands: the room's middle from there, and the table's edges."""

    name: str
    middle: tuple[float, float]  # x, z
    table: tuple[float, float] = (-0.7, 0.7)  # x


PLACES = (
    Place("in the middle of the room", (0.2, -0.1)),
    Place("near the window", (-1.0, 0.4)),
    Place("beside a red wall", (1.8, -0.2), (-0.2, 1.1)),
)

#: As Mitsuba has them. Brushed: rougher across than along.
MATERIALS: dict[str, dict[str, Any]] = {
    "chalk": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.8}},
    "plastic": {
        "type": "roughplastic",
        "alpha": 0.1,
        "diffuse_reflectance": {"type": "rgb", "value": [0.05, 0.15, 0.5]},
    },
    "brushed metal": {
        "type": "roughconductor", "material": "Cu", "alpha_u": 0.08, "alpha_v": 0.25,
    },
    "chrome": {"type": "conductor", "material": "Cr"},
    "glass": {"type": "dielectric", "int_ior": 1.5},
}  # fmt: skip


def _matte(colour: float | Sequence[float]) -> dict[str, Any]:
    value = [colour] * 3 if isinstance(colour, float) else list(colour)
    flat = {"type": "diffuse", "reflectance": {"type": "rgb", "value": value}}
    return {"type": "twosided", "bsdf": flat}


def _light(colour: Sequence[float]) -> dict[str, Any]:
    return {"type": "area", "radiance": {"type": "rgb", "value": list(colour)}}


def rectangle(
    at: Sequence[float], half: Sequence[float], facing: Sequence[float], up: Sequence[float]
) -> dict[str, Any]:
    """Half sizes across and along `up`."""
    target = list(np.add(at, facing))
    to_world = _PLACE().look_at(list(at), target, list(up)).scale([*half, 1])
    return {"type": "rectangle", "to_world": to_world}


def texture(picture: Array) -> dict[str, Any]:
    """A linear picture (H, W, 3) on a surface."""
    bitmap = mi.Bitmap(np.ascontiguousarray(picture, np.float32))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "wrap_mode": "clamp"}


def _painted(seed: int, size_px: int, low: Sequence[float], high: Sequence[float]) -> Array:
    """Blurred noise between two colours, with stripes: wood, or a poster."""
    noise = np.random.default_rng(seed).random((size_px, size_px)).astype(np.float32)
    noise = cv2.GaussianBlur(noise, (0, 0), sigmaX=size_px / 12, sigmaY=size_px / 160)
    noise = np.clip((noise - noise.mean()) / (4 * noise.std()) + 0.5, 0, 1)
    stripes = 0.75 + 0.25 * (np.arange(size_px)[:, None] // (size_px // 8) % 2)
    return np.asarray(np.add(low, (noise * stripes)[..., None] * np.subtract(high, low)))


def room(place: Place) -> dict[str, Any]:
    """All but the object."""
    (x, z), y, z_up = place.middle, (0, 1, 0), (0, 0, -1)
    height, half_y = (_FLOOR + _CEILING) / 2, (_CEILING - _FLOOR) / 2
    left, right = place.table
    table_at = ((left + right) / 2, 0, -0.1)
    bars = {
        f"box {k}": {
            "type": "cube", "bsdf": _matte(colour),
            "to_world": _PLACE().translate([x + at[0], _FLOOR + size, z + at[1]]).scale(size),
        }
        for k, (at, size, colour) in enumerate((
            ((1.2, -1.8), 0.35, (0.1, 0.3, 0.12)), ((-1.2, -1.9), 0.45, (0.6, 0.45, 0.1)),
            ((0.3, 1.9), 0.5, (0.15, 0.2, 0.5)),
        ))
    }  # fmt: skip
    return {
        "floor": rectangle((x, _FLOOR, z), (_HALF_X, _HALF_Z), y, z_up) | {"bsdf": _matte(0.25)},
        "ceiling": rectangle((x, _CEILING, z), (_HALF_X, _HALF_Z), (0, -1, 0), z_up)
        | {"bsdf": _matte(0.75)},
        "ahead": rectangle((x, height, z - _HALF_Z), (_HALF_X, half_y), (0, 0, 1), y)
        | {"bsdf": _matte((0.55, 0.52, 0.45))},
        "behind": rectangle((x, height, z + _HALF_Z), (_HALF_X, half_y), (0, 0, -1), y)
        | {"bsdf": _matte((0.4, 0.45, 0.5))},
        "left": rectangle((x - _HALF_X, height, z), (_HALF_Z, half_y), (1, 0, 0), y)
        | {"bsdf": _matte((0.55, 0.05, 0.04))},
        "right": rectangle((x + _HALF_X, height, z), (_HALF_Z, half_y), (-1, 0, 0), y)
        | {"bsdf": _matte(0.6)},
        "poster": rectangle((x - 0.6, 0.7, z - _HALF_Z + 0.02), (0.6, 0.45), (0, 0, 1), y)
        | {"bsdf": {"type": "diffuse", "reflectance": texture(
            _painted(5, 128, (0.05, 0.1, 0.3), (0.9, 0.6, 0.2)))}},
        "table": rectangle(table_at, ((right - left) / 2, 0.5), y, z_up)
        | {"bsdf": {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture(
            _painted(3, 256, (0.2, 0.12, 0.07), (0.65, 0.5, 0.36)))}}},
        "panel": rectangle((x - 0.5, _CEILING - 0.02, z + 0.5), (0.35, 0.35), (0, -1, 0), z_up)
        | {"emitter": _light((22, 20, 17))},
        "window": rectangle((x + _HALF_X - 0.02, 0.7, z - 0.3), (0.7, 0.6), (-1, 0, 0), y)
        | {"emitter": _light((5, 6, 7.5))},
        "globe": {
            "type": "sphere", "center": [x - 0.9, 1.0, z - 1.0], "radius": 0.1,
            "emitter": _light((165, 135, 95)),
        },
        **bars,
    }  # fmt: skip


def thing(material: dict[str, Any]) -> dict[str, Any]:
    """The object: a ball on the table."""
    return {
        "type": "sphere", "center": [0, RADIUS_M + 1e-4, 0], "radius": RADIUS_M, "bsdf": material,
    }  # fmt: skip


def render(
    parts: dict[str, Any], sensor: dict[str, Any], samples: int, seed: int, depth: int = 10
) -> Array:
    """Radiance (H, W, 3), or (H, W, 4) with what an object covers, as the sensor's film says."""
    integrator = {"type": "path", "max_depth": depth, "hide_emitters": "alpha" in sensor}
    film = {
        "type": "hdrfilm", "component_format": "float32", "rfilter": {"type": "box"},
        "pixel_format": "rgba" if "alpha" in sensor else "rgb", **sensor["film"],
    }  # fmt: skip
    camera = {key: value for key, value in sensor.items() if key not in ("film", "alpha")}
    sampler = {"type": "independent", "sample_count": samples}
    scene = mi.load_dict({
        "type": "scene", "integrator": integrator, **parts,
        "sensor": camera | {"film": film, "sampler": sampler},
    })  # fmt: skip
    return np.array(mi.render(scene, spp=samples, seed=seed), np.float64)


def eye(*, alpha: bool = False) -> dict[str, Any]:
    """The AR camera."""
    width, height = PICTURE_PX
    return {
        "type": "perspective", "fov": _FIELD_DEG, "fov_axis": "x", "near_clip": 1e-2,
        "to_world": _PLACE().look_at(list(_EYE), list(_LOOKS_AT), [0, 1, 0]),
        "film": {"width": width, "height": height},
    } | ({"alpha": True} if alpha else {})  # fmt: skip


def ar_camera() -> ArCamera:
    """The same, for lightprobe.local."""
    width, height = PICTURE_PX
    focal = width / 2 / np.tan(np.radians(_FIELD_DEG / 2))
    forward = geometry.normalize(np.subtract(_LOOKS_AT, _EYE))
    right = geometry.normalize(np.cross(forward, [0, 1, 0]))
    matrix = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    rotation = np.stack([right, np.cross(forward, right), forward], axis=1)
    return ArCamera(matrix, rotation, np.array(_EYE))


def panorama(place: Place, samples: int) -> Array:
    """Equirectangular radiance (960, 1920, 3) at the probe, of the room without the object."""
    faces = np.empty((6, _FACE_PX, _FACE_PX, 3))
    parts = room(place)
    for face, (main, _, down) in enumerate(reflection_map.AXES):
        target = list(np.add(PROBE_M, main))
        sensor = {
            "type": "perspective", "fov": 90, "near_clip": 1e-3,
            "to_world": _PLACE().look_at(list(PROBE_M), target, list(-down)),
            "film": {"width": _FACE_PX, "height": _FACE_PX},
        }  # fmt: skip
        # Faces of a cube map are seen from outside.
        faces[face] = render(parts, sensor, samples, face)[:, ::-1]
    fine = faces[reflection_map.texels(geometry.equirect_directions(3840, 1920), _FACE_PX)]
    return np.asarray(fine.reshape(960, 2, 1920, 2, 3).mean(axis=(1, 3)))
