"""An AR picture: the object drawn into the picture of the empty place, in some light.

The app knows the table's plane and the object, nothing else of the room. The table is darkened by
what the object takes: picture × E(with object) / E(without) (Debevec, "Rendering Synthetic Objects
into Real Scenes", 1998, with a ratio in place of his difference).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import mitsuba as mi
import numpy as np
import room
from lightprobe import geometry, local
from lightprobe.estimate import Estimate
from lightprobe.geometry import Array
from lightprobe.imaging.environment import environment_map, lamps_alone
from lightprobe.lamp import Lamp, disc_pixels
from lightprobe.reflection_map import ReflectionMap, directions

_WIDTH_PX = 1024
#: The object as the table sees it: Mitsuba would need long to find light through glass.
_CASTER = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.3}}
#: The square of the table whose picture objects reflect.
_SIDE_M, _GROUND_PX = 0.5, 128
#: As environment_map() draws it: no smaller than a pixel.
_SUN_RADIUS_DEG = 0.36


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What lights the object: an equirectangular map, and what its AR camera saw of the table."""

    radiance: Array  # (H, 2 H, 3), the centre ahead (−Z)
    ground: local.Ground | None = None


def by_harmonics(estimate: Estimate) -> Surroundings:
    """Lamps, area lights if it lists some, and spherical harmonics of a packet."""
    return Surroundings(environment_map(estimate, _WIDTH_PX)[0])


def by_reflection_map(estimate: Estimate, around: ReflectionMap) -> Surroundings:
    """Lamps of a packet, and its reflection map of AMBIENT, interpolated as a GPU would."""
    sharp = around.environment_map(_WIDTH_PX)
    texel_px = _WIDTH_PX // (4 * around.size)
    wide = np.pad(sharp, ((0, 0), (texel_px, texel_px), (0, 0)), mode="wrap")
    smooth = cv2.blur(wide, (texel_px, texel_px), borderType=cv2.BORDER_REPLICATE)
    return Surroundings(smooth[:, texel_px:-texel_px] + lamps_alone(estimate, _WIDTH_PX))


def with_ground(surroundings: Surroundings, picture: Array, total: ReflectionMap) -> Surroundings:
    """The same with the table as the AR camera sees it, brought to the probe's units by its map.

    What the camera did not see, and the border, fade to the surroundings, as from the object.
    """
    seen = local.sample(picture, room.ar_camera(), [0, 0, 0], _SIDE_M, size=_GROUND_PX)
    seen = local.by_reflection_map(seen, total, room.PROBE_M)
    place = ((np.arange(_GROUND_PX) + 0.5) / _GROUND_PX - 0.5) * _SIDE_M
    x, z = np.meshgrid(place, place)
    centre = np.array([0, room.RADIUS_M, 0])
    towards = geometry.normalize(np.stack([x, np.zeros_like(x), z], axis=-1) - centre)
    light = local.radiance(seen, _as_map(surroundings, total), centre, towards)
    return replace(surroundings, ground=replace(seen, radiance=light))


def _as_map(surroundings: Surroundings, like: ReflectionMap) -> ReflectionMap:
    """Surroundings on the faces of a cube."""
    height, width = surroundings.radiance.shape[:2]
    x, y = geometry.equirect_pixel(directions(like.size), width, height)
    row, column = np.int64(y).clip(0, height - 1), np.int64(x) % width
    return replace(like, radiance=np.float32(surroundings.radiance[row, column]))


def as_phones_tell(panorama: Array) -> Surroundings:
    """One lamp and the same light from everywhere, both exact: main light and ambient intensity.

    The lamp is where the light of the first band comes from, as strong as the band says; it takes
    at most what there is. It is as small as the sun.
    """
    solid_angles = geometry.equirect_solid_angles(panorama.shape[1], panorama.shape[0])
    weight = np.broadcast_to(solid_angles[:, None, None], panorama.shape)
    directions = geometry.equirect_directions(panorama.shape[1], panorama.shape[0])
    vector = np.einsum("yxi,yxc->ic", directions, panorama * weight)
    towards = geometry.normalize(vector.sum(axis=1))
    irradiance = np.maximum(towards @ vector, 0)
    rest = np.maximum((panorama * weight).sum(axis=(0, 1)) - irradiance, 0) / (4 * np.pi)
    radiance = np.broadcast_to(rest, (_WIDTH_PX // 2, _WIDTH_PX, 3)).copy()
    lamp = Lamp(towards, _SUN_RADIUS_DEG, irradiance)
    index, values = disc_pixels(lamp, _WIDTH_PX, _WIDTH_PX // 2)
    radiance.reshape(-1, 3)[index] += values
    return Surroundings(radiance)


def _envmap(surroundings: Surroundings) -> dict[str, Any]:
    """Mitsuba's begins straight ahead (−Z) and goes to the right."""
    turned = np.roll(surroundings.radiance, -surroundings.radiance.shape[1] // 2, axis=1)
    bitmap = mi.Bitmap(np.ascontiguousarray(turned, np.float32))
    return {"type": "envmap", "bitmap": bitmap}


def table_ratio(surroundings: Surroundings, samples: int) -> Array:
    """E(with object) / E(without) (H, W, 3) on the table, as the AR camera sees it."""
    grey = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}
    plane = room.rectangle((0, 0, 0), (3, 3), (0, 1, 0), (0, 0, -1)) | {"bsdf": grey}
    parts = {"light": _envmap(surroundings), "plane": plane}
    without = room.render(parts, room.eye(), samples, 1, depth=3)
    parts["caster"] = room.thing(_CASTER)
    shadowed = room.render(parts, room.eye(), samples, 2, depth=3)
    level = without.mean(axis=(0, 1))  # far light is the same all over the plane
    return np.asarray(shadowed / np.maximum(level, 1e-9))


def draw_object(surroundings: Surroundings, material: dict[str, Any], samples: int) -> Array:
    """Radiance (H, W, 4) of the object alone, times the share of each pixel that it covers."""
    parts = {"light": _envmap(surroundings), "object": room.thing(material)}
    if surroundings.ground is not None:
        half = surroundings.ground.side_m / 2
        square = room.rectangle((0, 0, 0), (half, half), (0, 1, 0), (0, 0, -1))
        light = {"type": "area", "radiance": room.texture(surroundings.ground.radiance)}
        black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
        parts["ground"] = square | {"bsdf": black, "emitter": light}
    return room.render(parts, room.eye(alpha=True), samples, 3)


def into_picture(picture: Array, ratio: Array | float, drawn: Array) -> Array:
    """The AR picture (H, W, 3), by what table_ratio() and draw_object() give."""
    return np.asarray(picture * ratio * (1 - drawn[..., 3:]) + drawn[..., :3])
