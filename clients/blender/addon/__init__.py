"""Blender add-on: measured light of a real room, live or from a recording.

`README.md` beside this folder says how it is used, built and tested.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent

from . import operators, panel, scene_world, session, settings

_CLASSES = (settings.LightprobeSettings, *operators.ALL, panel.LightprobePanel)


@persistent
def _before_load(*_: Any) -> None:
    """Another file is opened: its scenes are others."""
    session.disconnect("not connected: another file was opened")


@persistent
def _before_save(*_: Any) -> None:
    """Pictures that were computed are not in a .blend file unless they are packed."""
    for scene in bpy.data.scenes:
        scene_world.pack(scene)


_HANDLERS = (("load_pre", _before_load), ("save_pre", _before_save))


def register() -> None:
    """Called by Blender when the add-on is switched on."""
    for one in _CLASSES:
        bpy.utils.register_class(one)
    bpy.types.Scene.lightprobe = bpy.props.PointerProperty(type=settings.LightprobeSettings)
    for name, handler in _HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    """Called by Blender when the add-on is switched off; what is in the scenes stays."""
    session.disconnect("not connected")
    for name, handler in _HANDLERS:
        getattr(bpy.app.handlers, name).remove(handler)
    del bpy.types.Scene.lightprobe
    for one in reversed(_CLASSES):
        bpy.utils.unregister_class(one)
