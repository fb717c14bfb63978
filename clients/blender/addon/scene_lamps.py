"""The lamps in a scene, parented to the empty "lightprobe". Main thread only."""

from __future__ import annotations

import math

import bpy
from mathutils import Vector

from .fade import LampKey, ShownLamp
from .suns import Sun

NAME = "lightprobe"
#: Custom property of a lamp's object: boot of the probe and id of the lamp, `BOOT:ID`.
KEY_PROPERTY = "lightprobe_lamp"
#: Power of a point light, in Blender's watts, that gives an irradiance of 1 W/m² in 1 m.
_POINT_WATTS = 4 * math.pi


def root(scene: bpy.types.Scene) -> bpy.types.Object:
    """Give the empty that all lamps hang on; makes it when it is not there (any more)."""
    found = scene.lightprobe.root
    if found is not None and scene.objects.get(found.name) == found:
        return found
    empty = bpy.data.objects.new(NAME, None)
    empty.empty_display_type = "ARROWS"
    scene.collection.objects.link(empty)
    scene.lightprobe.root = empty
    return empty


def lamps(empty: bpy.types.Object) -> dict[LampKey, bpy.types.Object]:
    """Give the lamps that hang on the empty, by boot and id."""
    found = {}
    for child in empty.children:
        boot, colon, number = str(child.get(KEY_PROPERTY, "")).partition(":")
        if colon and child.type == "LIGHT":
            found[int(boot), int(number)] = child
    return found


def new_lamp(scene: bpy.types.Scene, empty: bpy.types.Object, key: LampKey) -> bpy.types.Object:
    """Make the object of a lamp; dark until it is set."""
    name = f"{NAME} lamp {key[1]}"
    data = bpy.data.lights.new(name, "SUN")
    data.energy = 0
    lamp = bpy.data.objects.new(name, data)
    # Text: the boot is a number of 32 bits without sign, which custom properties cannot hold.
    lamp[KEY_PROPERTY] = f"{key[0]}:{key[1]}"
    lamp.parent = empty
    lamp.rotation_mode = "QUATERNION"
    scene.collection.objects.link(lamp)
    return lamp


def show(scene: bpy.types.Scene, shown: list[ShownLamp], scale: float) -> None:
    """Draw these lamps and no others. A lamp keeps its object as long as it is listed."""
    empty = root(scene)
    there = lamps(empty)
    for lamp in shown:
        found = there.pop(lamp.key, None) or new_lamp(scene, empty, lamp.key)
        put(found, lamp.sun, lamp.gain * scale)
    for gone in there.values():
        remove(gone)


def put(lamp: bpy.types.Object, sun: Sun, scale: float) -> None:
    """Set place, direction, strength, colour and size. A sun shines along its local −Z."""
    towards = Vector(sun.direction)
    lamp.rotation_quaternion = towards.to_track_quat("Z", "Y")
    kind = "SUN" if sun.distance_m is None else "POINT"
    if lamp.data.type != kind:
        lamp.data.type = kind
    if sun.distance_m is None:
        # Where a sun stands does not matter for its light; this shows where it comes from.
        lamp.location = towards
        lamp.data.energy = sun.strength * scale
        lamp.data.angle = sun.angle_rad
    else:
        lamp.location = sun.distance_m * towards
        lamp.data.energy = _POINT_WATTS * sun.strength * scale * sun.distance_m**2
        lamp.data.shadow_soft_size = sun.distance_m * math.sin(min(sun.angle_rad, math.pi) / 2)
    lamp.data.color = sun.colour
    lamp.data.use_shadow = sun.casts_shadow


def remove(lamp: bpy.types.Object) -> None:
    """Delete a lamp and its data."""
    data = lamp.data
    bpy.data.objects.remove(lamp)
    if data is not None and data.users == 0:
        bpy.data.lights.remove(data)


def remove_all(scene: bpy.types.Scene) -> None:
    """Delete the empty and its lamps."""
    empty = scene.lightprobe.root
    if empty is None:
        return
    for lamp in lamps(empty).values():
        remove(lamp)
    bpy.data.objects.remove(empty)
