"""Meshes from files and into files, by trimesh."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from lightprobe.bake.bake import Bake
from lightprobe.errors import UsageError
from lightprobe.geometry import Array

READ = (".obj", ".glb", ".gltf", ".ply", ".stl")
WRITTEN = (".ply", ".glb")
_MOST_BYTES = 500_000_000


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles and their vertices, in metres."""

    vertices: Array  # (n, 3)
    normals: Array  # (n, 3)
    triangles: NDArray[np.int64]  # (m, 3)
    open_edges: int  # of one triangle only


def read(file: Path, flip: bool = False) -> Mesh:
    """Read a mesh, of a scene all of its meshes in their places; raises UsageError.

    `flip`: the triangles' corners run the other way round than they should.
    """
    if file.suffix.lower() not in READ:
        raise UsageError(f"bake: {file}: cannot be read as a mesh: expected {', '.join(READ)}")
    try:
        size = file.stat().st_size
    except OSError as error:
        raise UsageError(f"bake: {file}: cannot be read as a mesh: {error.strerror}") from None
    if size > _MOST_BYTES:
        raise UsageError(
            f"bake: {file}: {size / 1e6:.0f} MB: simplify it to {_MOST_BYTES / 1e6:.0f} MB at most"
        )
    try:
        loaded = trimesh.load(file, force="mesh", process=False)
    except Exception as error:  # trimesh and its readers raise whatever they like
        raise UsageError(
            f"bake: {file}: cannot be read as a mesh: {error or type(error).__name__}: expected "
            f"{', '.join(READ)}"
        ) from error
    if not isinstance(loaded, trimesh.Trimesh) or len(loaded.faces) == 0:
        raise UsageError(f"bake: {file}: holds no triangles: export it as a mesh of triangles")
    if flip:
        loaded.invert()
    vertices = np.array(loaded.vertices, np.float64)
    if not np.isfinite(vertices).all():
        raise UsageError(f"bake: {file}: has vertices that are no numbers: export it again")
    if float(np.ptp(vertices, axis=0).max()) == 0:
        raise UsageError(f"bake: {file}: all its vertices are at one place: export it again")
    return Mesh(
        vertices, np.array(loaded.vertex_normals, np.float64), np.array(loaded.faces, np.int64),
        _open_edges(loaded),
    )  # fmt: skip


def _open_edges(mesh: trimesh.Trimesh) -> int:
    """Edges of one triangle only, where vertices at one place count as one."""
    _, same = np.unique(np.round(mesh.vertices, 9), axis=0, return_inverse=True)
    edges = np.sort(same.reshape(-1)[mesh.edges], axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return int((counts == 1).sum())


def encode(kind: str, bake: Bake, irradiance: Array, albedo: float) -> tuple[bytes, float]:
    """Give a lit mesh as bytes, and the radiance that its colours show as 1.

    Colours of vertices are linear, radiance albedo/π · E over the largest of all. A .ply file has
    the irradiance, too, as `irradiance_r`, `irradiance_g`, `irradiance_b`.
    """
    radiance = albedo / np.pi * irradiance
    white = float(radiance.max(initial=0.0)) or 1.0
    colours = np.round(255 * np.clip(radiance / white, 0, 1)).astype(np.uint8)
    mesh = trimesh.Trimesh(
        bake.vertices, bake.triangles, vertex_normals=bake.normals, process=False,
        vertex_colors=np.c_[colours, np.full(len(colours), 255, np.uint8)],
    )  # fmt: skip
    if kind == ".ply":
        for k, name in enumerate("rgb"):
            mesh.vertex_attributes[f"irradiance_{name}"] = irradiance[:, k].astype(np.float32)
    data = mesh.export(file_type=kind[1:])
    assert isinstance(data, bytes)  # of all kinds in WRITTEN
    return data, white
