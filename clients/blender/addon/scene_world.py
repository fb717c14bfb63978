"""The world of a scene: a picture of the sky, mixed with the colour that is shown without light.

Main thread only. The nodes: direction → Mapping (the empty's turn, backwards) → picture → Mix with
the default colour → Background, whose strength is the unit scale.
"""

from __future__ import annotations

import bpy
from mathutils import Matrix, Quaternion
from numpy.typing import ArrayLike

from . import axes
from .sky import Sky

NAME = "lightprobe"
_MAPPING, _PICTURE, _MIX, _BACKGROUND = (
    "lightprobe turn",
    "lightprobe picture",
    "lightprobe fade",
    "lightprobe strength",
)

#: Width of the map by which Cycles samples the world: twice that of the largest picture.
_IMPORTANCE_PX = 1024


def world(scene: bpy.types.Scene) -> bpy.types.World:
    """Give the add-on's world, put into the scene; the former one is kept for `remove`."""
    settings = scene.lightprobe
    found = settings.world
    if found is None or _MIX not in found.node_tree.nodes:
        found = bpy.data.worlds.new(NAME)
        _build(found)
        settings.world = found
    if scene.world != found:
        settings.former_world = scene.world
        scene.world = found
    return found


def _build(found: bpy.types.World) -> None:
    found.use_nodes = True
    if hasattr(found, "cycles"):  # absent where the user has switched Cycles off
        # Left to itself, Cycles makes a map of 4096 × 2048 before each picture.
        found.cycles.sampling_method = "MANUAL"
        found.cycles.sample_map_resolution = _IMPORTANCE_PX
    tree = found.node_tree
    tree.nodes.clear()

    def node(kind: str, name: str, column: int) -> bpy.types.Node:
        made = tree.nodes.new(kind)
        made.name = made.label = name
        made.location = (220 * column, 0)
        return made

    coordinate = node("ShaderNodeTexCoord", "lightprobe direction", 0)
    mapping = node("ShaderNodeMapping", _MAPPING, 1)
    picture = node("ShaderNodeTexEnvironment", _PICTURE, 2)
    mix = node("ShaderNodeMix", _MIX, 3)
    mix.data_type = "RGBA"
    background = node("ShaderNodeBackground", _BACKGROUND, 4)
    output = node("ShaderNodeOutputWorld", "lightprobe world", 5)
    sockets = {socket.identifier: socket for socket in mix.inputs}
    mixed = next(socket for socket in mix.outputs if socket.identifier == "Result_Color")
    link = tree.links.new
    link(coordinate.outputs["Generated"], mapping.inputs["Vector"])
    link(mapping.outputs["Vector"], picture.inputs["Vector"])
    link(picture.outputs["Color"], sockets["B_Color"])
    link(mixed, background.inputs["Color"])
    link(background.outputs["Background"], output.inputs["Surface"])


def gain_socket(found: bpy.types.World) -> bpy.types.NodeSocket:
    """Share of the picture, 0…1, against the default colour."""
    return found.node_tree.nodes[_MIX].inputs["Factor"]


def strength_socket(found: bpy.types.World) -> bpy.types.NodeSocket:
    """Factor from the packet's radiance to Blender's."""
    return found.node_tree.nodes[_BACKGROUND].inputs["Strength"]


def show(
    scene: bpy.types.Scene,
    gain: float,
    scale: float,
    orientation: ArrayLike | None = None,
    without: float | None = None,
) -> None:
    """Set how much of the picture is seen, and how it is turned; see :func:`show_picture`.

    `without`: radiance, in the packet's units, of what is seen beside it; None: the scene's colour.
    """
    found = world(scene)
    set_turn(scene, orientation)
    _set(gain_socket(found), gain)
    _set(strength_socket(found), scale)
    set_default(scene, scale, without)


def set_default(scene: bpy.types.Scene, scale: float, without: float | None = None) -> None:
    """Set what is shown without light: a grey in the packet's units, or the scene's colour.

    The scene's colour is in Blender's units, whatever the scale.
    """
    mix = world(scene).node_tree.nodes[_MIX]
    socket = next(one for one in mix.inputs if one.identifier == "A_Color")
    colour = [channel / scale if scale > 0 else 0.0 for channel in scene.lightprobe.default_colour]
    if without is not None:
        colour = [without] * 3
    if tuple(socket.default_value[:3]) != tuple(colour):
        socket.default_value = (*colour, 1.0)


def set_turn(scene: bpy.types.Scene, orientation: ArrayLike | None) -> None:
    """Turn the picture as the probe was turned (`orientation`), and as the empty is."""
    empty = scene.lightprobe.root
    turned = empty.matrix_world.to_quaternion() if empty else Quaternion()
    turned = turned @ Matrix(axes.blender_turn(orientation)).to_quaternion()
    socket = turn_socket(world(scene))
    # Near the one before, so that keyframes do not swing around by 360°.
    euler = turned.inverted().to_euler("XYZ", socket.default_value)
    if tuple(socket.default_value) != tuple(euler):
        socket.default_value = euler


def turn_socket(found: bpy.types.World) -> bpy.types.NodeSocket:
    """Euler angles, XYZ, that turn directions of the scene into those of the picture."""
    return found.node_tree.nodes[_MAPPING].inputs["Rotation"]


def _set(socket: bpy.types.NodeSocket, value: float) -> None:
    if socket.default_value != value:  # every change makes a viewport render again
        socket.default_value = value


def show_picture(scene: bpy.types.Scene, sky: Sky) -> None:
    """Put a new picture into the world."""
    found = world(scene)
    node = found.node_tree.nodes[_PICTURE]
    image = node.image
    if image is None or image.source != "GENERATED" or tuple(image.size) != sky.size_px:
        image = node.image = _new_image(scene, sky.size_px)
    image.pixels.foreach_set(sky.rgba())
    image.update()
    found.update_tag()


def _new_image(scene: bpy.types.Scene, size_px: tuple[int, int]) -> bpy.types.Image:
    """Make a float picture; the one before it is deleted."""
    before = scene.lightprobe.picture
    if before is not None:
        bpy.data.images.remove(before)
    image = new_picture(f"{NAME} sky", size_px)
    scene.lightprobe.picture = image
    return image


def new_picture(name: str, size_px: tuple[int, int]) -> bpy.types.Image:
    """Make a picture of scene-linear floats of 32 bits."""
    width, height = size_px
    image = bpy.data.images.new(name, width, height, alpha=False, float_buffer=True)
    as_light(image)
    return image


def as_light(image: bpy.types.Image) -> None:
    """Have an image read as linear Rec. 709, in full precision: half floats end at 65504."""
    image.colorspace_settings.name = "Linear Rec.709"
    image.use_half_precision = False


def show_sequence(scene: bpy.types.Scene, first_file: str, start: int, count: int) -> None:
    """Show `count` numbered files, the first at frame `start`, one a frame."""
    node = world(scene).node_tree.nodes[_PICTURE]
    image = bpy.data.images.load(first_file)
    image.source = "SEQUENCE"
    image.name = f"{NAME} sky"
    as_light(image)
    node.image = scene.lightprobe.picture = image
    node.image_user.frame_start = start
    node.image_user.frame_duration = count
    node.image_user.frame_offset = 0
    node.image_user.use_auto_refresh = True


def is_keyframed(scene: bpy.types.Scene) -> bool:
    """Tell whether a recording has been keyframed in this scene."""
    found = scene.lightprobe.world
    return found is not None and found.node_tree.animation_data is not None


def pack(scene: bpy.types.Scene) -> None:
    """Put the picture into the .blend file that is being saved."""
    image = scene.lightprobe.picture
    if image is not None and image.is_dirty:
        image.pack()


def remove(scene: bpy.types.Scene) -> None:
    """Put the former world back, and delete the add-on's."""
    settings = scene.lightprobe
    if settings.world is None:
        return
    if scene.world == settings.world:
        scene.world = settings.former_world
    bpy.data.worlds.remove(settings.world)
    if settings.picture is not None:
        bpy.data.images.remove(settings.picture)
