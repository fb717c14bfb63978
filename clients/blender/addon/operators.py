"""Operators of the panel, and of scripts.

No `from __future__ import annotations` here: Blender reads the annotations as properties.
"""

from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper
from lightprobe.errors import LightprobeError

from . import keyframes, scene_lamps, scene_world, session
from .suns import fitting_scale


class ConnectOperator(bpy.types.Operator):
    """Light the scene with what the probe sees, until Disconnect"""

    bl_idname = "lightprobe.connect"
    bl_label = "Connect"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender's way

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the thread and the timer; a probe that is not there is waited for."""
        try:
            session.connect(context.scene)
        except LightprobeError as error:
            session.disconnect(str(error))
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class DisconnectOperator(bpy.types.Operator):
    """Leave the probe. Lamps and world stay as they were last"""

    bl_idname = "lightprobe.disconnect"
    bl_label = "Disconnect"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while connected."""
        return session.current() is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """End the session."""
        session.disconnect()
        return {"FINISHED"}


class RemoveOperator(bpy.types.Operator):
    """Disconnect, delete the lamps, and put the scene's former world back"""

    bl_idname = "lightprobe.remove"
    bl_label = "Remove lamps and world"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Undo all that the add-on has done to the scene."""
        session.disconnect("not connected")
        scene_lamps.remove_all(context.scene)
        scene_world.remove(context.scene)
        return {"FINISHED"}


class FitScaleOperator(bpy.types.Operator):
    """Set the scale so that the brightest white surface is shown at 0.8"""

    bl_idname = "lightprobe.fit_scale"
    bl_label = "Fit brightness"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while light comes."""
        running = session.current()
        return running is not None and running.link.seen.estimate is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set units and scale."""
        running = session.current()
        estimate = running.link.seen.estimate if running else None
        try:
            if estimate is None:
                raise LightprobeError("fit: no light has come yet: connect to a probe first")
            context.scene.lightprobe.scale = fitting_scale(estimate)
        except LightprobeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        context.scene.lightprobe.units = "RELATIVE"
        return {"FINISHED"}


class LightOnceOperator(bpy.types.Operator):
    """For scripts: wait for the probe's light, light the scene with it, and disconnect"""

    bl_idname = "lightprobe.light_once"
    bl_label = "Light once"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    timeout_s: bpy.props.FloatProperty(
        name="Timeout", description="Seconds to wait for light", default=10, min=0, max=3600
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Wait, and draw without a fade."""
        try:
            found = session.light_once(context.scene, self.timeout_s)
        except LightprobeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if found.state != "FRESH":
            self.report({"WARNING"}, "; ".join((found.headline, *found.details)))
        return {"FINISHED"}


class KeyframeOperator(bpy.types.Operator, ImportHelper):
    """Read a file of `lightprobe record`, and keyframe its lamps and its sky"""

    bl_idname = "lightprobe.keyframe_recording"
    bl_label = "Keyframe a recording"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    filename_ext = ".mcap"
    filter_glob: bpy.props.StringProperty(default="*.mcap", options={"HIDDEN"})
    start_frame: bpy.props.IntProperty(
        name="First frame", description="Where the recording begins", default=1, min=0
    )
    sky_folder: bpy.props.StringProperty(
        name="Folder of the sky",
        description="Gets one picture a frame (lightprobe_0001.exr, …); empty: NAME_sky beside the "
        "recording",
        subtype="DIR_PATH",
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Replace what the add-on has put into the scene by the recording."""
        session.disconnect("not connected")
        path = Path(bpy.path.abspath(self.filepath))
        beside = path.with_name(f"{path.stem}_sky")
        folder = Path(bpy.path.abspath(self.sky_folder)) if self.sky_folder else beside
        manager = context.window_manager
        manager.progress_begin(0, 1)
        try:
            done = keyframes.keyframe(
                context.scene, path, folder, self.start_frame, manager.progress_update
            )
        except LightprobeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        finally:
            manager.progress_end()
        for note in done.notes:
            self.report({"WARNING"}, note)
        self.report(
            {"INFO"}, f"{path.name}: lamps: {done.lamps}, frames {done.first_frame} to "
            f"{done.last_frame}; the sky is in {folder}"
        )  # fmt: skip
        return {"FINISHED"}


ALL = (
    ConnectOperator,
    DisconnectOperator,
    RemoveOperator,
    FitScaleOperator,
    LightOnceOperator,
    KeyframeOperator,
)
