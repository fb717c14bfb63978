"""The solid: its faces, and the marker on each.

Frame of the solid: its centre is the origin, +Y points out of face 0, −Z towards that face's first
vertex. Faces 1 to 5 lie around face 0, 6 to 10 around face 11, which is opposite of face 0. Lengths
are in edges of the solid. Face i has marker i of the dictionary; its top is towards the face's
first vertex.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.geometry import Array

FACES = 12
_GOLDEN = (1 + np.sqrt(5)) / 2
#: From a face's centre to its vertices and to its edges; from the solid's centre to its faces.
VERTEX = 1 / (2 * np.sin(np.pi / 5))
EDGE = 1 / (2 * np.tan(np.pi / 5))
INRADIUS = _GOLDEN**2 / (2 * np.sqrt(3 - _GOLDEN))
#: Side of a marker. Around it, at least a seventh of an edge stays white.
MARKER = 0.72


@dataclass(frozen=True, eq=False)
class Face:
    """A face of the solid."""

    normal: Array  # (3,) unit, outwards
    vertices: Array  # (5, 3) counter-clockwise as seen from outside; the marker's top is at [0]

    @property
    def centre(self) -> Array:
        """(3,) its middle."""
        return np.asarray(self.normal * INRADIUS)

    @property
    def axes(self) -> Array:
        """(2, 3) unit: to the right and up on the face, as its marker has them."""
        up = (self.vertices[0] - self.centre) / VERTEX
        return np.stack([np.cross(up, self.normal), up])

    def at(self, places: Array) -> Array:
        """Points (N, 3) of places (N, 2) right and up from the face's centre."""
        return np.asarray(self.centre + places @ self.axes)

    @property
    def marker(self) -> Array:
        """(4, 3) its corners as OpenCV orders them: from top left, clockwise."""
        half = MARKER / 2
        return self.at(np.array([[-half, half], [half, half], [half, -half], [-half, -half]]))


def pentagon() -> Array:
    """(5, 2) vertices of a face from its centre, right and up: the first one on top."""
    turn = np.pi / 2 + 2 * np.pi * np.arange(5) / 5
    return np.asarray(VERTEX * np.stack([np.cos(turn), np.sin(turn)], axis=1))


@cache
def faces() -> tuple[Face, ...]:
    """All twelve, by number."""
    top = Face(np.array([0.0, 1, 0]), _from_above(pentagon()))
    ring = [_beside(top, k) for k in range(5)]
    bottom = Face(-top.normal, -np.roll(top.vertices[::-1], 1, axis=0))
    lower = [_beside(bottom, k) for k in range(5)]
    return (top, *ring, *lower, bottom)


def normals() -> Array:
    """(12, 3) normals of all faces."""
    return np.stack([face.normal for face in faces()])


def _from_above(places: Array) -> Array:
    """Points (N, 3) of face 0: its right is +X, its top −Z."""
    return np.stack([places[:, 0], np.full(len(places), INRADIUS), -places[:, 1]], axis=1)


def _beside(face: Face, k: int) -> Face:
    """The face at the edge from vertex k to the next one; its top is away from `face`."""
    first, second = face.vertices[k], face.vertices[(k + 1) % 5]
    middle = (first + second) / 2
    outward = middle - face.centre
    outward = outward / np.linalg.norm(outward)
    # The angle between normals of neighbours is that of an icosahedron's vertices: cos = 1 / √5.
    normal = face.normal / np.sqrt(5) + outward * 2 / np.sqrt(5)
    up = INRADIUS * normal - middle
    up = up / np.linalg.norm(up)
    right = np.cross(up, normal)
    return Face(normal, INRADIUS * normal + pentagon() @ np.stack([right, up]))


@cache
def dictionary() -> Any:
    """The markers: the first twelve of OpenCV's DICT_5X5_50. The lens's board has others."""
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_50)


def marker_cells(number: int) -> NDArray[np.bool_]:
    """(7, 7) which cells of a marker are black, rows from its top; its border is."""
    cells = cv2.aruco.generateImageMarker(dictionary(), number, 7, borderBits=1)
    return np.asarray(cells) < 128
