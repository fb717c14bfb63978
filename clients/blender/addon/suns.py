"""Lamps of a packet as Blender's lamps want them, and the scale of all light. No bpy here."""

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
    """A lamp as a sun of Blender, or as a point light where it has a distance; before the scale."""

    id: int  # of the packet
    direction: Array  # (3,) unit vector towards the lamp, Blender's axes, in the empty's frame
    colour: tuple[float, float, float]  # linear Rec. 709, its largest channel is 1
    strength: float  # irradiance of that channel on a surface that faces the lamp
    angle_rad: float  # of the disc, from rim to rim, as Blender's `angle`
    casts_shadow: bool = True  # False: a mirror image, which shines through floor or pane
    distance_m: float | None = None  # of a point light from the empty; None: a sun


def there(estimate: Estimate, steady: bool, position_m: Array | None) -> Estimate:
    """Give the light at a place (3,): Blender's axes, in the empty's frame; None: at the probe.

    A TOTAL stays as it is: it cannot be moved. `steady`: see :func:`suns`.
    """
    if position_m is None or estimate.sh.kind != "AMBIENT":
        return estimate
    turn = axes.turn(estimate.orientation if steady else None)
    return estimate.at(axes.to_probe(position_m) @ turn)


def suns(
    estimate: Estimate, steady: bool, position_m: Array | None = None, points: bool = False
) -> list[Sun]:
    """All that is to be added to the SH of an estimate; of TOTAL nothing.

    `steady`: turned by the estimate's orientation, where it is known. `position_m` (3,): the place
    that they are aimed at, Blender's axes, in the empty's frame; None: the probe's. `points`: lamps
    with a distance are point lights, which are right for every place, and only the others suns.
    """
    turn = axes.turn(estimate.orientation if steady else None)
    if points:
        return [_sun(light, turn, light.distance_m) for light in estimate.beside_sh]
    return [_sun(light, turn) for light in there(estimate, steady, position_m).beside_sh]


def _sun(light: Light, turn: Array, distance_m: float | None = None) -> Sun:
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
        distance_m,
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
