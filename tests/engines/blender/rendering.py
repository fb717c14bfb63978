"""Scenes with known answers, and how Cycles renders them into linear floats."""

import contextlib
import os
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector

WHITE = 0.8  # albedo of every surface


def lambert(name="white"):
    """A diffuse material of albedo WHITE."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    surface = nodes.new("ShaderNodeBsdfDiffuse")
    surface.inputs["Color"].default_value = (WHITE, WHITE, WHITE, 1)
    output = nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(surface.outputs["BSDF"], output.inputs["Surface"])
    return material


def plane(size=2.0, z=0.0):
    """A horizontal white plane that faces up."""
    bpy.ops.mesh.primitive_plane_add(size=size, location=(0, 0, z))
    made = bpy.context.object
    made.data.materials.append(lambert())
    return made


def sphere(radius=1.0, location=(0, 0, 0)):
    """A smooth white sphere."""
    bpy.ops.mesh.primitive_uv_sphere_add(
        segments=192, ring_count=96, radius=radius, location=location
    )
    made = bpy.context.object
    bpy.ops.object.shade_smooth()
    made.data.materials.append(lambert())
    return made


def camera(towards_eye, width=2.0):
    """Orthographic camera that looks at the origin from a direction; sees `width` across.

    From straight above, Blender's +X is right in the picture and +Y is up.
    """
    z = Vector(towards_eye).normalized()
    x = Vector((0, 1, 0)).cross(z).normalized()
    turned = Matrix((x, z.cross(x), z)).transposed()
    data = bpy.data.cameras.new("eye")
    data.type = "ORTHO"
    data.ortho_scale = width
    eye = bpy.data.objects.new("eye", data)
    eye.location = 10 * z
    eye.rotation_mode = "QUATERNION"
    eye.rotation_quaternion = turned.to_quaternion()
    bpy.context.scene.collection.objects.link(eye)
    bpy.context.scene.camera = eye
    bpy.context.view_layer.update()
    return eye


@contextlib.contextmanager
def quiet():
    """Cycles reports every step on the process' standard output."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def render(size_px=8, samples=64):
    """Linear radiance (size, size, 3) of the scene, row 0 at the bottom, by Cycles on the CPU."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = size_px
    scene.render.resolution_percentage = 100
    scene.cycles.device = "CPU"
    scene.cycles.samples = samples
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.sample_clamp_indirect = 0
    scene.cycles.pixel_filter_type = "BOX"
    scene.view_settings.view_transform = "Raw"
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth = "OPEN_EXR", "32"
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "out.exr")
        with quiet():
            bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        pixels = np.empty(4 * size_px * size_px, np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
    return pixels.reshape(size_px, size_px, 4)[..., :3].astype(np.float64)


def sphere_normals(eye, size_px, width, radius=1.0):
    """Normals (size, size, 3) of the sphere in each pixel of `render`; NaN beside it."""
    at = ((np.arange(size_px) + 0.5) / size_px - 0.5) * width / radius
    x, y = np.meshgrid(at, at)
    inside = x * x + y * y < 0.8**2
    z = np.sqrt(np.where(inside, 1 - x * x - y * y, np.nan))
    local = np.stack([x, y, z], axis=-1)
    local[~inside] = np.nan
    return local @ np.array(eye.matrix_world.to_3x3()).T
