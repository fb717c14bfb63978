"""Where the object stands whose light is wanted. Main thread only."""

from __future__ import annotations

import bpy
import numpy as np
from lightprobe.estimate import Estimate
from lightprobe.geometry import Array


def position(scene: bpy.types.Scene, empty: bpy.types.Object | None) -> Array | None:
    """Give the place of the named object (3,): metres from the empty, Blender's axes, its frame.

    `empty`: None stands for one at the origin. The result is None if no object is named, or if it
    is not in this scene any more. One unit of Blender is a metre.
    """
    named = scene.lightprobe.lit_object
    if named is None or scene.objects.get(named.name) != named:
        return None
    place = named.matrix_world.translation
    if empty is not None:
        place = empty.matrix_world.inverted_safe() @ place
    found = np.array(place, dtype=np.float64)
    return found if np.isfinite(found).all() else None


def note(scene: bpy.types.Scene, estimate: Estimate) -> tuple[str, ...]:
    """Say that the lamps cannot be aimed at the object, where that is so."""
    settings = scene.lightprobe
    if settings.lit_object is None and not settings.point_lights:
        return ()
    if any(light.distance_m is not None for light in estimate.lights):
        return ()
    what = "all light is" if estimate.room is None else "lamps are"
    return (f"Place: no lamp has a distance, so {what} as at the probe.",)
