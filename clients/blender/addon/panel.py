"""The panel in the sidebar of the 3D view."""

from __future__ import annotations

import textwrap
from typing import Any

import bpy

from . import session

#: Characters of the small font in a pixel of width, and the fewest in a line.
_CHARACTERS_PER_PX = 1 / 7
_FEWEST = 24
_ICONS = {
    "FRESH": "CHECKMARK",
    "FAULTY": "ERROR",
    "OLD": "TIME",
    "WAITING": "SORTTIME",
    "LOST": "UNLINKED",
    "ENDED": "X",
}


class LightprobePanel(bpy.types.Panel):
    """Connect to a probe, and see how its light is"""

    bl_idname = "VIEW3D_PT_lightprobe"
    bl_label = "Lightprobe"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Lightprobe"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw buttons, state and settings."""
        settings, layout = context.scene.lightprobe, self.layout
        layout.prop(settings, "uri")
        row = layout.row(align=True)
        row.operator("lightprobe.connect")
        row.operator("lightprobe.disconnect")
        width_px = context.region.width if context.region else 300
        _draw_state(layout, int(width_px * _CHARACTERS_PER_PX))
        column = layout.column()
        column.prop(settings, "mode")
        if settings.mode == "LAMPS":
            for name in ("max_lamps", "lit_object", "point_lights"):
                column.prop(settings, name)
        for name in ("map_size", "rate_hz", "steady"):
            column.prop(settings, name)
        column.separator()
        for name in ("units", "scale", "default_colour"):
            column.prop(settings, name)
        column.operator("lightprobe.fit_scale")
        layout.separator()
        layout.operator("lightprobe.keyframe_recording")
        layout.operator("lightprobe.remove")


def _draw_state(layout: Any, characters: int) -> None:
    said = session.state()
    box = layout.box().column(align=True)
    _draw_text(box, said.headline, characters, _ICONS[said.state])
    for detail in said.details:
        _draw_text(box, detail, characters, "DOT")


def _draw_text(layout: Any, text: str, characters: int, icon: str) -> None:
    """Draw a sentence, broken into lines: labels do not wrap."""
    lines = textwrap.wrap(text, max(_FEWEST, characters)) or [""]
    layout.label(text=lines[0], icon=icon)
    for line in lines[1:]:
        layout.label(text=line, icon="BLANK1")
