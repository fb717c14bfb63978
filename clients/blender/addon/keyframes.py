"""Writes a recording into the scene: keyframes of lamps, and a sequence of pictures of the sky."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bpy
from lightprobe.errors import LightprobeError
from lightprobe.estimate import Estimate
from mathutils import Quaternion, Vector

from . import place, scene_lamps, scene_world, sky, timeline
from .fade import LampKey, ShownLamp
from .suns import unit_scale
from .timeline import FrameLight

#: Gets the share, 0…1, that is done.
OnProgress = Callable[[float], None]
#: Of the pictures of the sky: nobody else's files have this name.
_PREFIX = "lightprobe_"


@dataclass(frozen=True)
class Written:
    """What :func:`keyframe` has put into the scene."""

    first_frame: int
    last_frame: int
    lamps: int
    notes: tuple[str, ...]  # what of the recording could not be used


def keyframe(
    scene: bpy.types.Scene,
    path: Path,
    folder: Path,
    start: int,
    on_progress: OnProgress = lambda share: None,
) -> Written:
    """Keyframe the recording `path` from frame `start` on; the sky's pictures go to `folder`.

    What the add-on has put into the scene before is replaced. Raises
    :class:`lightprobe.LightprobeError`; then the scene is as it was.
    """
    packets, notes = timeline.read(path)
    settings = scene.lightprobe
    fps = scene.render.fps / scene.render.fps_base
    standing_m = place.position(scene, None)  # the empty is made anew below, at the origin
    lights = list(timeline.frames(packets, start, fps, settings.steady, standing_m))
    scales = [unit_scale(one.estimate, settings.units, settings.scale) for one in lights]
    first_file = write_skies(lights, folder, on_progress)
    scene_lamps.remove_all(scene)
    scene_world.remove(scene)
    scene_lamps.root(scene)
    scene_world.show_sequence(scene, str(first_file), start, len(lights))
    objects = _key_lamps(scene, lights, scales)
    _key_world(scene, lights, scales)
    for one in objects:
        _straighten(one)
        _straighten(one.data)
    _straighten(scene_world.world(scene).node_tree)
    return Written(start, lights[-1].frame, len(objects), tuple(notes))


def _straighten(animated: bpy.types.ID) -> None:
    """Join keyframes by straight lines: Bézier curves would swing beyond them."""
    for curve in _curves(animated.animation_data.action):
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"


def _curves(action: bpy.types.Action) -> Iterator[bpy.types.FCurve]:
    """Give the curves of an action: of Blender 4, and of the layers of Blender 5."""
    if hasattr(action, "fcurves"):
        yield from action.fcurves
        return
    for layer in action.layers:
        for strip in layer.strips:
            for bag in strip.channelbags:
                yield from bag.fcurves


def _key_lamps(
    scene: bpy.types.Scene, lights: list[FrameLight], scales: list[float]
) -> list[bpy.types.Object]:
    """Keyframe every lamp on the frames that show it, and dark before and after."""
    empty = scene_lamps.root(scene)
    objects: dict[LampKey, bpy.types.Object] = {}
    shown_before: set[LampKey] = set()
    for index, (light, scale) in enumerate(zip(lights, scales, strict=True)):
        for lamp in light.lamps:
            if lamp.key not in objects:
                objects[lamp.key] = scene_lamps.new_lamp(scene, empty, lamp.key)
            if lamp.key not in shown_before and index:
                _key_dark(objects[lamp.key], light.frame - 1)
            _key_lamp(objects[lamp.key], lamp, light.frame, scale)
        shown = {lamp.key for lamp in light.lamps}
        for gone in shown_before - shown:
            _key_dark(objects[gone], light.frame)
        shown_before = shown
    return list(objects.values())


def _key_dark(lamp: bpy.types.Object, frame: int) -> None:
    lamp.data.energy = 0
    lamp.data.keyframe_insert("energy", frame=frame)


def _key_lamp(lamp: bpy.types.Object, shown: ShownLamp, frame: int, scale: float) -> None:
    before = lamp.rotation_quaternion.copy()
    is_new = lamp.animation_data is None
    scene_lamps.put(lamp, shown.sun, shown.gain * scale)
    if not is_new:
        lamp.rotation_quaternion = _continued(before, Vector(shown.sun.direction))
    for name in ("location", "rotation_quaternion"):
        lamp.keyframe_insert(name, frame=frame)
    for name in ("energy", "color", "angle"):
        lamp.data.keyframe_insert(name, frame=frame)


def _continued(before: Quaternion, towards: Vector) -> Quaternion:
    """Turn a lamp the shortest way, so that it does not roll or swing between two keyframes."""
    was_towards = before @ Vector((0, 0, 1))
    turned = was_towards.rotation_difference(towards) @ before
    if turned.dot(before) < 0:
        turned.negate()
    return turned


def _key_world(scene: bpy.types.Scene, lights: list[FrameLight], scales: list[float]) -> None:
    found = scene_world.world(scene)
    keyed = (
        scene_world.gain_socket(found),
        scene_world.strength_socket(found),
        scene_world.turn_socket(found),
    )
    for light, scale in zip(lights, scales, strict=True):
        orientation = light.estimate.orientation if scene.lightprobe.steady else None
        scene_world.show(scene, light.world_gain, scale, orientation)
        for socket in keyed:
            socket.keyframe_insert("default_value", frame=light.frame)


def write_skies(lights: list[FrameLight], folder: Path, on_progress: OnProgress) -> Path:
    """Write one OpenEXR picture of 32-bit floats for each frame; gives the first file.

    Files lightprobe_0001.exr, …; those of a former recording are deleted, and nothing else. A
    picture that does not change is copied. Raises :class:`lightprobe.LightprobeError` when the
    folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for old in folder.glob(f"{_PREFIX}[0-9][0-9][0-9][0-9]*.exr"):
            old.unlink()
        with _exr_scene() as writer:
            before: Estimate | None = None
            for index, light in enumerate(lights, start=1):
                file = folder / f"{_PREFIX}{index:04d}.exr"
                if light.estimate is before:
                    shutil.copyfile(folder / f"{_PREFIX}{index - 1:04d}.exr", file)
                else:
                    _write_sky(light.estimate, file, writer)
                before = light.estimate
                on_progress(index / len(lights))
    except (OSError, RuntimeError) as error:  # RuntimeError: Blender cannot write
        raise LightprobeError(
            f"{folder}: write pictures of the sky: {error}: choose another folder"
        ) from None
    return folder / f"{_PREFIX}0001.exr"


def _write_sky(estimate: Estimate, file: Path, writer: bpy.types.Scene) -> None:
    picture = sky.from_harmonics(estimate.sh)
    image = scene_world.new_picture("lightprobe to write", picture.size_px)
    try:
        image.pixels.foreach_set(picture.rgba())
        image.update()
        image.save_render(str(file), scene=writer)
    finally:
        bpy.data.images.remove(image)


@contextmanager
def _exr_scene() -> Iterator[bpy.types.Scene]:
    """Give a scene that holds how pictures are written: `Image.save` would compress with losses."""
    scene = bpy.data.scenes.new("lightprobe to write")
    settings = scene.render.image_settings
    settings.file_format = "OPEN_EXR"
    settings.color_mode = "RGB"
    settings.color_depth = "32"
    settings.exr_codec = "ZIP"
    try:
        yield scene
    finally:
        bpy.data.scenes.remove(scene)
