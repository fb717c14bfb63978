"""Which directions the vertices of a mesh see: parallel rays from all vertices, exactly.

Along one direction all rays are parallel. Projected along it, a ray is a point and a triangle a
triangle: a ray meets the triangles that its point lies in. A raster over the projection tells
which triangles come near which points. The opposite direction needs the same triangles, so both
are answered at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightprobe.geometry import Array, fibonacci_sphere, normalize

#: Pairs of a vertex and a triangle that are tested at a time: bounds the memory.
_PAIRS = 1 << 21
#: A triangle that is nearer than this share of the mesh's size is the vertex's own.
_OWN = 1e-5
#: Share of the largest projected area below which a triangle is seen edge-on.
_EDGE_ON = 1e-12

Bits = NDArray[np.bool_]
Index = NDArray[np.int64]


def directions(count: int) -> Array:
    """Give `count` directions (count, 3), evenly over the sphere.

    `count` is even. The second half is opposite to the first.
    """
    half = fibonacci_sphere(count)[: count // 2]
    return np.concatenate([half, -half])


def visible(
    vertices: Array,
    triangles: Index,
    along: Array,
    progress: Callable[[int, int], None] | None = None,
    points: Array | None = None,
) -> Bits:
    """Tell which vertices, or other points, no triangle hides: shape (2 · N, points).

    `along`: directions (N, 3). The first N rows are for light that comes from there, the others for
    light from the opposite directions. Triangles hide from both of their sides. `points`: places
    (n, 3) on the mesh or beside it; default: the vertices.
    """
    places = vertices if points is None else points
    found = np.ones((2 * len(along), len(places)), dtype=np.bool_)
    own = _OWN * float(np.ptp(vertices, axis=0).max())
    for k, direction in enumerate(along):
        ahead, behind = _hidden(vertices, triangles, direction, own, places)
        found[k, ahead] = False
        found[len(along) + k, behind] = False
        if progress:
            progress(k + 1, len(along))
    return found


def _hidden(
    vertices: Array, triangles: Index, direction: Array, own: float, places: Array
) -> tuple[Index, Index]:
    """Places that have a triangle before them, and those that have one behind them."""
    side = normalize(np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))]))
    axes = np.stack([side, np.cross(direction, side), direction], axis=1)
    points = np.asfortranarray(places @ axes)
    corners = (vertices @ axes)[triangles]
    planes = _Planes(corners)
    ahead, behind = [], []
    for triangle, vertex in _Raster(points[:, :2]).pairs(corners[..., :2]):
        above, vertex = planes.above(triangle, vertex, points)
        ahead.append(vertex[above > own])
        behind.append(vertex[above < -own])
    return np.concatenate(ahead), np.concatenate(behind)


class _Planes:
    """Triangles as three linear functions of a point of the projection.

    The first two are barycentric coordinates, the third is the height.
    """

    def __init__(self, corners: Array) -> None:
        origin = corners[:, 0]
        a, b = corners[:, 1] - origin, corners[:, 2] - origin
        area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        whole = np.abs(area) > _EDGE_ON * np.abs(area).max()
        scale = 1 / np.where(whole, area, np.nan)  # what is seen edge-on holds no point
        self._s = self._through(origin, b[:, 1] * scale, -b[:, 0] * scale)
        self._t = self._through(origin, -a[:, 1] * scale, a[:, 0] * scale)
        s, t = self._s, self._t
        self._height = origin[:, 2] * np.array([[1], [0], [0]]) + s * a[:, 2] + t * b[:, 2]

    @staticmethod
    def _through(origin: Array, x: Array, y: Array) -> Array:
        return np.stack([-origin[:, 0] * x - origin[:, 1] * y, x, y])

    def above(self, triangle: Index, vertex: Index, points: Array) -> tuple[Array, Index]:
        """Heights above the vertices of those pairs in which the triangle holds the vertex."""
        s = _at(self._s, triangle, vertex, points)
        triangle, vertex, s = _where(s >= 0, triangle, vertex, s)
        t = _at(self._t, triangle, vertex, points)
        triangle, vertex = _where((t >= 0) & (s + t <= 1), triangle, vertex)
        return _at(self._height, triangle, vertex, points) - points[vertex, 2], vertex


def _at(linear: Array, triangle: Index, vertex: Index, points: Array) -> Array:
    x, y = points[vertex, 0], points[vertex, 1]
    return np.asarray(linear[0, triangle] + linear[1, triangle] * x + linear[2, triangle] * y)


def _where(kept: Bits, *arrays: Any) -> Any:
    return tuple(array[kept] for array in arrays)


class _Raster:
    """Points in a plane, sorted into square cells: one point a cell on average."""

    def __init__(self, points: Array) -> None:
        self._low = points.min(axis=0)
        self._cells = max(1, int(np.sqrt(len(points))))
        self._scale = self._cells / max(float(np.ptp(points, axis=0).max()), 1e-300)
        at = self._cell(points)
        cell = at[:, 0] * self._cells + at[:, 1]
        self._order = np.argsort(cell, kind="stable")
        counts = np.bincount(cell, minlength=self._cells**2)
        self._first = np.concatenate([[0], np.cumsum(counts)])

    def _cell(self, points: Array) -> Index:
        cells = ((points - self._low) * self._scale).astype(np.int64)
        return np.asarray(np.clip(cells, 0, self._cells - 1))

    def pairs(self, corners: Array) -> Iterator[tuple[Index, Index]]:
        """Yield arrays of triangles and of points in the cells that their outlines span."""
        low, high = self._cell(corners.min(axis=1)), self._cell(corners.max(axis=1))
        rows = high[:, 0] - low[:, 0] + 1
        triangle = np.repeat(np.arange(len(corners)), rows)
        row = low[triangle, 0] + _counted(rows)
        first = self._first[row * self._cells + low[triangle, 1]]
        number = self._first[row * self._cells + high[triangle, 1] + 1] - first
        part = np.cumsum(number) // _PAIRS
        for k in range(int(part[-1]) + 1 if len(part) else 0):
            here = part == k
            count = number[here]
            at = np.repeat(first[here], count) + _counted(count)
            yield np.repeat(triangle[here], count), self._order[at]


def _counted(numbers: Index) -> Index:
    """0 … n−1 for each n, one after the other."""
    ends = np.cumsum(numbers)
    return np.arange(int(ends[-1]) if len(ends) else 0) - np.repeat(ends - numbers, numbers)
