"""Lamps of a packet as Blender's sun lamps want them, and the scale of all light. No bpy here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from lightprobe.colour import LUMINANCE
from lightprobe.errors import LightprobeError
from lightprobe.estimate import Estimate, Light, LightFlag
from lightprobe.geometry import Array, sphere_normals

from . import axes

#: RELATIVE: the packet's numbers times the scale. PHOTOMETRIC: watts of a calibrated probe.
Units = Literal["RELATIVE", "PHOTOMETRIC"]
#: Luminous efficacy in lm/W that Blender's own glTF exporter divides by (CIE: of 555 nm).
LUMENS_PER_WATT = 683.0
#: Radiance of the brightest white surface after `fitting_scale`; above 1 it would be clipped.
_FITTED = 0.8


@dataclass(frozen=True, eq=False)
class Sun:
    """A lamp as a sun of Blender, before the scale."""

    id: int  # of the packet
    direction: Array  # (3,) unit vector towards the lamp, Blender's axes, in the empty's frame
    colour: tuple[float, float, float]  # linear Rec. 709, its largest channel is 1
    strength: float  # irradiance of that channel on a surface that faces the lamp
    angle_rad: float  # of the disc, from rim to rim, as Blender's `angle`
    casts_shadow: bool = True  # False: a mirror image, which shines through floor or pane


def suns(estimate: Estimate, steady: bool) -> list[Sun]:
    """All that is to be added to the SH of an estimate; of TOTAL nothing.

    `steady`: turned by the estimate's orientation, where it is known.
    """
    turn = axes.turn(estimate.orientation if steady else None)
    return [_sun(light, turn) for light in estimate.beside_sh]


def _sun(light: Light, turn: Array) -> Sun:
    strength = float(np.max(light.irradiance))
    colour = light.irradiance / strength if strength > 0 else np.ones(3)
    red, green, blue = (float(channel) for channel in colour)
    return Sun(
        light.id,
        axes.to_blender(turn @ light.direction),
        (red, green, blue),
        max(strength, 0.0),
        float(np.radians(2 * light.angular_radius_deg)),
        not light.flags & LightFlag.REFLECTION,
    )


def unit_scale(estimate: Estimate, units: Units, factor: float) -> float:
    """Factor from the packet's units to Blender's: W/m² for lamps, W/(m² sr) for the world.

    Raises :class:`LightprobeError` where the units need a calibrated probe and this one is not.
    """
    if units == "RELATIVE":
        return factor
    if estimate.cd_m2_per_unit is None:
        raise LightprobeError(
            "units: the probe is not calibrated, so its light has no unit: choose 'Relative', or "
            "calibrate it (lightprobe calibrate scale)"
        )
    return factor * estimate.cd_m2_per_unit / LUMENS_PER_WATT


def fitting_scale(estimate: Estimate) -> float:
    """Give the relative scale that shows the brightest white surface at 0.8.

    Raises :class:`LightprobeError` when there is no light.
    """
    most = float((estimate.irradiance(sphere_normals(2)) @ LUMINANCE).max())
    if not most > 0:
        raise LightprobeError("fit: the probe sees no light: switch a lamp on")
    return float(_FITTED * np.pi / most)
