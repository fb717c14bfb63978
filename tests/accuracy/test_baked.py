"""Meshes that shade themselves, lit by the daemon's packets, against rays one by one."""

import baked
from lightprobe.bake import Bake
from lightprobe.sim import scenes


def test_shadows_of_a_mesh_on_itself():
    """Of the largest irradiance; without shadows it is off by five times as much."""
    mesh = baked.meshes()["chair"]
    bake = Bake.of_mesh(mesh.vertices, mesh.normals, mesh.triangles)
    (scene,) = scenes.load(["room"])
    found = baked.errors(
        mesh, bake, scene, {how: baked.packet(scene, how) for how in ("float", "4")}
    )
    assert found["float"][0] < 0.012
    assert found["4"][0] < 0.03
    assert found["float, no shadows"][0] > 5 * found["float"][0]
