"""What the user sets, kept in the scene as `scene.lightprobe`.

No `from __future__ import annotations` here: Blender reads the annotations as properties.
"""

import bpy

from .link import Wish

_MODES = [
    ("LAMPS", "Lamps and sky", "Lamps as sun lamps; the world is the rest of the light (AMBIENT)"),
    ("MAP", "Reflection map", "The world is the probe's picture of the room, lamps included "
     "(TOTAL). No sun lamps. The probe needs --reflection-map"),
]  # fmt: skip
_UNITS = [
    ("RELATIVE", "Relative", "The probe's own numbers times the scale"),
    ("PHOTOMETRIC", "Watts", "Lux and cd/m² of a calibrated probe, divided by 683 lm/W, times the "
     "scale"),
]  # fmt: skip
_MAP_SIZES = [
    ("0", "None", "The world is made of spherical harmonics: soft, for diffuse surfaces"),
    ("16", "16", "16 texels along an edge of the cube"),
    ("32", "32", "32 texels along an edge of the cube"),
    ("64", "64", "64 texels along an edge of the cube"),
]
_ASK = "Takes effect at the next Connect"


class LightprobeSettings(bpy.types.PropertyGroup):
    """Settings of a scene."""

    uri: bpy.props.StringProperty(
        name="Probe",
        description="Address of the probe: tcp:HOST:PORT, unix:PATH, ws://HOST:PORT/ or "
        "wss://HOST:PORT/#token=…. " + _ASK,
        default="tcp:127.0.0.1:7700",
    )
    mode: bpy.props.EnumProperty(
        name="Light", description="What lights the scene. " + _ASK, items=_MODES
    )
    max_lamps: bpy.props.IntProperty(
        name="Lamps",
        description="Most sun lamps; weaker ones are in the sky. " + _ASK,
        default=4,
        min=0,
        max=8,
    )
    map_size: bpy.props.EnumProperty(
        name="Reflection map",
        description="What the world shows, if the probe gives it out. " + _ASK,
        items=_MAP_SIZES,
        default="32",
    )
    lit_object: bpy.props.PointerProperty(
        name="Lit object",
        type=bpy.types.Object,
        description="Sun lamps light the scene as they light the place of this object, where their "
        "distances are known. Empty: as at the probe",
    )
    point_lights: bpy.props.BoolProperty(
        name="Point lights",
        description="Lamps whose distances are known stand at their places as point lights, and "
        "light every place of the scene as they light that place",
        default=False,
    )
    rate_hz: bpy.props.FloatProperty(
        name="Updates a second",
        description="Each update makes a viewport render again. " + _ASK,
        default=10,
        min=0.1,
        max=30,
    )
    steady: bpy.props.BoolProperty(
        name="Stay while the probe turns",
        description="Turn the light by the probe's orientation, if it knows that. " + _ASK,
        default=True,
    )
    units: bpy.props.EnumProperty(
        name="Units", description="What a strength of 1 means", items=_UNITS
    )
    scale: bpy.props.FloatProperty(
        name="Scale",
        description="Factor on all light of the probe, lamps and world alike",
        default=1,
        min=0,
        soft_max=1000,
        precision=6,
    )
    default_colour: bpy.props.FloatVectorProperty(
        name="Without light",
        description="Radiance of the world before the probe's first light. After the last, it is a "
        "grey as bright as that light",
        subtype="COLOR",
        size=3,
        default=(0.05, 0.05, 0.05),
        min=0,
        soft_max=1,
    )
    root: bpy.props.PointerProperty(type=bpy.types.Object)
    world: bpy.props.PointerProperty(type=bpy.types.World)
    former_world: bpy.props.PointerProperty(type=bpy.types.World)
    picture: bpy.props.PointerProperty(type=bpy.types.Image)

    def wish(self) -> Wish:
        """Give what the probe is asked for."""
        return Wish(
            mode=self.mode,
            max_lamps=self.max_lamps,
            map_size=int(self.map_size),
            rate_hz=self.rate_hz,
            steady=self.steady,
        )
