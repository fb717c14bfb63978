"""Light on meshes that shade themselves, by a packet: error of the vertices' irradiance.

`python tests/accuracy/baked.py` prints a table, `--page` puts it into docs/users/bake.md, with a
picture. The
truth shares no code with the bake: every ray from every vertex is tested against every triangle
(Möller, Trumbore 1997), for light that is summed from the true panorama.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from lightprobe import geometry
from lightprobe.bake import Bake
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate
from lightprobe.evaluate import evaluation, offline
from lightprobe.geometry import Array
from lightprobe.sim import scenes
from lightprobe.sim.scene import Scene
from page import ROOT, put
from recording import markdown

PAGE = ROOT / "docs/users/bake.md"
PICTURE = ROOT / "docs/users/bake.png"
SCENES = ("room", "procedural:3", "blender")
INPUTS = ("float", "4", "3")
_MAP_PX, _BLOCK_PX = (1024, 512), 16
_SETTINGS = offline.Settings(preset="balanced", sh_order=2, lights=8, area_lights=True)
_OWN = 2e-3


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh, as a file gives it."""

    vertices: Array
    normals: Array
    triangles: np.ndarray

    @classmethod
    def of(cls, mesh: trimesh.Trimesh) -> Mesh:
        return cls(np.array(mesh.vertices), np.array(mesh.vertex_normals), np.array(mesh.faces))


def meshes() -> dict[str, Mesh]:
    """Give meshes that shade themselves much: none is convex."""
    ball = trimesh.creation.icosphere(2)
    x, y, z = np.array(ball.vertices).T
    radius = 1 + 0.35 * np.sin(3 * x + 1) * np.cos(4 * y) + 0.25 * np.sin(5 * z)
    blob = trimesh.Trimesh(ball.vertices * radius[:, None], ball.faces, process=False)
    ring = trimesh.creation.torus(1.0, 0.45, major_sections=20, minor_sections=10)
    boxes = [((1.0, 0.08, 1.0), (0, 0.5, 0)), ((1.0, 0.9, 0.08), (0, 1.0, -0.46))]
    boxes += [((0.1, 0.5, 0.1), (0.43 * a, 0.23, 0.43 * b)) for a in (-1, 1) for b in (-1, 1)]
    parts = []
    for size, at in boxes:
        box = trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))
        box.unmerge_vertices()  # each triangle has the normal of its own
        parts.append(box.subdivide())
    found = {"blob": blob, "ring": ring, "chair": trimesh.util.concatenate(parts)}
    return {name: Mesh.of(mesh) for name, mesh in found.items()}


def visible(mesh: Mesh, directions: Array) -> np.ndarray:
    """Tell which directions (N, 3) the vertices see before them: (n, N)."""
    corner = mesh.vertices[mesh.triangles[:, 0]]
    a, b = (
        mesh.vertices[mesh.triangles[:, 1]] - corner,
        mesh.vertices[mesh.triangles[:, 2]] - corner,
    )
    seen = mesh.normals @ directions.T > 0
    for k, direction in enumerate(directions):
        across = np.cross(direction, b)
        det = (a * across).sum(axis=1)
        scale = 1 / np.where(np.abs(det) > 1e-12, det, np.nan)
        rows = np.flatnonzero(seen[:, k])
        away = (mesh.vertices + _OWN * mesh.normals)[rows, None] - corner
        s = (away * across).sum(axis=-1) * scale
        turned = np.cross(away, a)
        t = (turned @ direction) * scale
        ahead = (turned * b).sum(axis=-1) * scale
        hit = (s >= 0) & (t >= 0) & (s + t <= 1) & (ahead > 1e-9)
        seen[rows[hit.any(axis=1)], k] = False
    return seen


def sources(scene: Scene) -> tuple[Array, Array]:
    """True light as points: directions (N, 3), each block's mean, and luminance × solid angle."""
    width, height = _MAP_PX
    picture = scene.render(width, height).compose(np.ones(len(scene.lamps)))
    flux = luminance(picture.astype(float)) * geometry.equirect_solid_angles(width, height)[:, None]
    towards = geometry.equirect_directions(width, height) * flux[..., None]
    blocks = (height // _BLOCK_PX, _BLOCK_PX, width // _BLOCK_PX, _BLOCK_PX)
    flux = flux.reshape(blocks).sum(axis=(1, 3)).reshape(-1)
    mean = towards.reshape(*blocks, 3).sum(axis=(1, 3)).reshape(-1, 3)
    return geometry.normalize(mean[flux > 0]), flux[flux > 0]


def packet(scene: Scene, how: str) -> Estimate:
    """What the daemon says of a scene."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        exposures_us = evaluation.Studio().shoot(scene, evaluation.Input.parse(how), folder)
        files = sorted(folder.iterdir())
        return offline.estimate_pictures(files, exposures_us, _SETTINGS).estimate


def truth_of(mesh: Mesh, scene: Scene) -> Array:
    """Irradiance (n,), luminance."""
    directions, flux = sources(scene)
    cosine = np.maximum(mesh.normals @ directions.T, 0)
    return (cosine * visible(mesh, directions)) @ flux


def errors(mesh: Mesh, bake: Bake, scene: Scene, packets: dict[str, Estimate]) -> dict[str, Array]:
    """Mean and root mean square error of all vertices, of the largest truth, by input."""
    truth = truth_of(mesh, scene)
    found = {how: luminance(bake.irradiance(one)) for how, one in packets.items()}
    found["float, no shadows"] = luminance(packets["float"].irradiance(mesh.normals))
    off = {how: (one - truth) / truth.max() for how, one in found.items()}
    return {how: np.array([np.abs(d).mean(), np.sqrt((d**2).mean())]) for how, d in off.items()}


def table(names: tuple[str, ...] = SCENES, inputs: tuple[str, ...] = INPUTS) -> str:
    """Markdown: a row for each mesh and input."""
    chosen = scenes.load(names)
    packets = [{how: packet(scene, how) for how in inputs} for scene in chosen]
    rows = []
    for name, mesh in meshes().items():
        bake = Bake.of_mesh(mesh.vertices, mesh.normals, mesh.triangles)
        every = [errors(mesh, bake, *pair) for pair in zip(chosen, packets, strict=True)]
        for how in every[0]:
            mae, rmse = np.array([one[how] for one in every]).T
            rows.append([name, how, *(f"{np.median(e):.4f} ({e.max():.4f})" for e in (mae, rmse))])
    return markdown(["mesh", "pictures", "MAE", "RMSE"], rows) + "\n"


def draw(path: Path) -> None:
    """Draw the chair in the room: truth, what the packet gives, and without shadows."""
    import matplotlib.pyplot as plt
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    mesh = meshes()["chair"]
    bake = Bake.of_mesh(mesh.vertices, mesh.normals, mesh.triangles)
    (scene,) = scenes.load(["room"])
    light, truth = packet(scene, "4"), truth_of(mesh, scene)
    drawn = {
        "the true light": truth,
        "a packet, shadows baked": luminance(bake.irradiance(light)),
        "the same packet, no shadows": luminance(light.irradiance(mesh.normals)),
    }
    figure = plt.figure(figsize=(12, 4.4), layout="constrained", facecolor="0.12")
    eye = np.array([np.cos(np.radians(-60)), np.sin(np.radians(-60)), np.tan(np.radians(25))])
    corners = mesh.vertices[mesh.triangles][..., [0, 2, 1]] * [1, -1, 1]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ eye > 0
    for k, (title, values) in enumerate(drawn.items()):
        axes = figure.add_subplot(1, 3, k + 1, projection="3d", facecolor="0.12")
        axes.set_title(title, color="white")
        grey = (values[mesh.triangles[faces]].mean(axis=1) / truth.max()).clip(0, 1) ** (1 / 2.2)
        colours = np.repeat(grey[:, None], 3, axis=1)
        axes.add_collection3d(
            Poly3DCollection(corners[faces], facecolors=colours, edgecolors=colours)
        )
        axes.set(xlim=(-0.6, 0.6), ylim=(-0.6, 0.6), zlim=(0, 1.5), box_aspect=(1.2, 1.2, 1.5))
        axes.view_init(25, -60)
        axes.set_axis_off()
    figure.savefig(path, dpi=80)
    plt.close(figure)


def times() -> str:
    """Say what it takes for 10 242 vertices, on this machine."""
    ball = trimesh.creation.icosphere(5)
    rough = ball.vertices * (1 + 0.3 * np.sin(9 * ball.vertices))
    mesh = Mesh.of(trimesh.Trimesh(rough, ball.faces, process=False))
    began = time.process_time()
    bake = Bake.of_mesh(mesh.vertices, mesh.normals, mesh.triangles)
    prepared_s = time.process_time() - began
    light = packet(scenes.load(["procedural:8"])[-1], "float")
    bake.irradiance(light)
    took = []
    for _ in range(20):
        began = time.perf_counter()
        bake.irradiance(light)
        took.append(1e3 * (time.perf_counter() - began))
    return (
        f"{len(mesh.vertices)} vertices, {len(bake.directions)} directions, {len(light.lights)} "
        f"lamps: prepared in {prepared_s:.0f} s, {np.median(took):.1f} ms per packet\n"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--page", action="store_true", help="write it into docs/users/probes.md")
    parser.add_argument("--time", action="store_true", help="say what it takes, instead")
    arguments = parser.parse_args()
    if arguments.time:
        print(times(), end="")
        return
    text = table()
    if arguments.page:
        put(PAGE, {"baked": text})
        draw(PICTURE)
    print(text, end="")


if __name__ == "__main__":
    sys.exit(main())
