"""Reflection maps of a recording, as each client of a replay asks for them.

A recording holds maps of AMBIENT, without the lamps that its estimates list. Lamps that a client
does not list, or all of them for TOTAL, are put into the texels where they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from lightprobe_proto import lightprobe_pb2 as pb

from lightprobe.geometry import Array
from lightprobe.reflection_map import (
    decode_rgb9e5,
    directions,
    encode_rgb9e5,
    solid_angles,
    texels,
)


def answer(recorded: Any, wish: Any, added: Sequence[Any]) -> Any:
    """Give a pb.ReflectionMap for a pb.Subscription: no more texels than it wants.

    `added`: pb.Light of the recording's estimate whose light the client is to find in the map.
    """
    size = int(recorded.size)
    faces = decode_rgb9e5(recorded.texels, recorded.scale).astype(np.float64)
    faces = faces.reshape(6, size, size, 3)
    while size > max(wish.reflection_map.size, 16):
        faces, size = _halved(faces), size // 2
    for light in added:
        _put(faces, light)
    message = pb.ReflectionMap()
    message.CopyFrom(recorded)
    message.size = size
    message.texels, message.scale = encode_rgb9e5(faces.reshape(-1, 3))
    message.kind = wish.reflection_map.kind or pb.SphericalHarmonics.TOTAL
    message.subscription = wish.number
    return message


def _halved(faces: Array) -> Array:
    """Half as many texels along each edge, with the same light."""
    size = faces.shape[1] // 2
    flux = faces * solid_angles(2 * size)[..., None]
    sums = flux.reshape(6, size, 2, size, 2, 3).sum(axis=(2, 4))
    return np.asarray(sums / solid_angles(size)[..., None])


def _put(faces: Array, light: Any) -> None:
    """Add a lamp's light to the texels within its radius, or to the one where it is."""
    size = faces.shape[1]
    towards = np.array(light.direction, float)
    cosines = directions(size) @ towards
    inside = cosines >= np.cos(np.radians(light.angular_radius_deg))
    if not inside.any():
        inside[tuple(index for index in texels(towards, size))] = True
    share = inside * solid_angles(size)
    faces += (inside / (share * cosines).sum())[..., None] * np.array(light.irradiance)
