"""Measuring the rendered parts: sections, walls, what lies in a beam."""

import os
from pathlib import Path

import numpy as np
import trimesh

# Which of the two boxes: see HW_SERVO in hw/hw.mk.
SERVO_DEG = int(os.environ.get("HW_SERVO", "180"))
OUT = (
    Path(__file__).resolve().parents[2]
    / "build"
    / ("hw" if SERVO_DEG == 180 else f"hw-{SERVO_DEG}")
)


def part(name: str) -> trimesh.Trimesh:
    """A printable part as it lies on the bed."""
    return load(OUT / "stl" / f"{name}.stl")


def assembled(name: str) -> trimesh.Trimesh:
    """An item where it sits in the box."""
    return load(OUT / "assembled" / f"{name}.stl")


def load(path: Path) -> trimesh.Trimesh:
    assert path.is_file(), f"{path} is missing: make hw-parts"
    mesh = trimesh.load_mesh(path)
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


def section(mesh: trimesh.Trimesh, z: float) -> np.ndarray:
    """Segments of the cut at height z, shape (n, 2 ends, 2 coordinates)."""
    lines = trimesh.intersections.mesh_plane(mesh, [0, 0, 1], [0, 0, z])
    return lines[:, :, :2]


def inside(segments: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether points (m, 2) lie in the material of a section: even-odd rule along +x."""
    a, b = segments[:, 0], segments[:, 1]
    y = points[:, 1:2]
    crosses = (a[:, 1] > y) != (b[:, 1] > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    return (crosses & (x > points[:, :1])).sum(1) % 2 == 1


def polar(radius: float, degrees: np.ndarray | float) -> np.ndarray:
    """Points on a circle, shape (n, 2)."""
    a = np.radians(np.atleast_1d(degrees))
    return radius * np.stack([np.cos(a), np.sin(a)], -1)


def thickness(mesh: trimesh.Trimesh, samples: int = 1500) -> np.ndarray:
    """Wall thickness at points over the surface: straight inwards to a face that looks back.

    Edges and wedges, where no such face lies opposite, are left out.
    """
    points, faces = trimesh.sample.sample_surface(mesh, samples, seed=1)
    normals = mesh.face_normals[faces]
    triangles = mesh.triangles
    found = []
    for point, normal in zip(points, normals, strict=True):
        hit, at = first_hit(triangles, point - 1e-4 * normal, -normal)
        if np.isfinite(at) and mesh.face_normals[hit] @ normal < -0.97:
            found.append(at)
    return np.array(found)


def first_hit(triangles: np.ndarray, origin: np.ndarray, ray: np.ndarray) -> tuple[int, float]:
    """Nearest triangle that a ray meets, and how far: Moeller and Trumbore."""
    e1, e2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = np.cross(ray, e2)
    det = (e1 * p).sum(1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = origin - triangles[:, 0]
        u = (s * p).sum(1) / det
        q = np.cross(s, e1)
        v = (q @ ray) / det
        t = (e2 * q).sum(1) / det
    t = np.where((np.abs(det) > 1e-12) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)
    hit = int(t.argmin())
    return hit, float(t[hit])
