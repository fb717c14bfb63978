"""The net to print: two sheets with six faces each, to cut, fold and glue.

Lengths in millimetres, from the lower left corner of the sheet. Sheet 1 has face 0 in its middle,
sheet 2 face 11; both have their first vertex on top. An edge with a tab is glued to the edge that
has the same number.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.geometry import Array
from lightprobe.probe.dodecahedron import solid

SHEET_MM = 210.0, 297.0  # A4
#: What printers leave white at the rim.
_RIM_MM = 6.0
#: Tabs: their width in edges, and the slope of their ends.
_TAB, _TAB_SLOPE_DEG = 0.2, 32.0
BAR_MM = 100.0
#: From a sheet's middle to the outermost vertex of its faces, in edges, with the line around them.
_REACH = solid.EDGE * 2 + solid.VERTEX + 0.02
SMALLEST_MM = 12.0
LARGEST_MM = float(np.floor((SHEET_MM[0] / 2 - _RIM_MM) / _REACH))
#: Of each sheet: the face in its middle, and those around it.
_SHEETS = ((0, (1, 2, 3, 4, 5)), (11, (6, 7, 8, 9, 10)))
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Flat:
    """A face on a sheet, in edges from the sheet's middle."""

    number: int
    vertices: Array  # (5, 2) as in solid.Face

    @property
    def centre(self) -> Array:
        """(2,) its middle."""
        return np.asarray(self.vertices.mean(axis=0))

    @property
    def axes(self) -> Array:
        """(2, 2) unit: right and up on the face."""
        up = (self.vertices[0] - self.centre) / solid.VERTEX
        return np.array([[up[1], -up[0]], up])


@dataclass(frozen=True, eq=False)
class Tab:
    """A tab at an edge, in edges from the sheet's middle, and the number of the edge."""

    outline: Array  # (4, 2): along the edge, then back
    number: int


def sheet(index: int) -> list[Flat]:
    """Faces of sheet 0 or 1, the one in the middle first: unfolded about the shared edges."""
    middle, around = _SHEETS[index]
    base = solid.faces()[middle]
    found = [Flat(middle, (base.vertices - base.centre) @ base.axes.T)]
    for number in around:
        face = solid.faces()[number]
        shared = [v for v in face.vertices if _is_among(v, base.vertices)]
        hinge = (shared[0] + shared[1]) / 2
        opened = _turned(face.vertices - hinge, face.normal, base.normal) + hinge
        found.append(Flat(number, (opened - base.centre) @ base.axes.T))
    return found


def tabs(index: int) -> list[Tab]:
    """Tabs of a sheet: of two edges that meet, the face with the lower number has it."""
    middle, _ = _SHEETS[index]
    found = []
    for flat in sheet(index):
        for k, number, other in edges_of(flat.number):
            if middle in (flat.number, other) or flat.number > other:
                continue
            first, second = flat.vertices[k], flat.vertices[(k + 1) % 5]
            outward = (first + second) / 2 - flat.centre
            outward = outward / np.linalg.norm(outward) * _TAB
            inward = (second - first) * _TAB / np.tan(np.radians(_TAB_SLOPE_DEG))
            outline = [first, second, second + outward - inward, first + outward + inward]
            found.append(Tab(np.array(outline), number))
    return found


def edges_of(face: int) -> Iterator[tuple[int, int, int]]:
    """Of each edge of a face: its first vertex, the edge's number 1…30, and the face beyond."""
    pairs = _pairs()
    vertices = solid.faces()[face].vertices
    for k in range(5):
        middle = (vertices[k] + vertices[(k + 1) % 5]) / 2
        for number, (one, two, at) in enumerate(pairs, 1):
            if face in (one, two) and np.linalg.norm(at - middle) < _SAME:
                yield k, number, two if face == one else one


def _pairs() -> list[tuple[int, int, Array]]:
    """Faces that meet, and the middle of their edge (3,)."""
    known = solid.faces()
    middles = [(f.vertices + np.roll(f.vertices, -1, axis=0)) / 2 for f in known]
    return [
        (i, j, at)
        for i in range(solid.FACES)
        for j in range(i + 1, solid.FACES)
        for at in middles[i]
        if _is_among(at, middles[j])
    ]


def _is_among(point: Array, points: Array) -> bool:
    return bool(np.min(np.linalg.norm(points - point, axis=1)) < _SAME)


def _turned(points: Array, normal: Array, towards: Array) -> Array:
    """Turn points (N, 3) about the axis normal × towards, so that `normal` becomes `towards`."""
    axis = np.cross(normal, towards)
    sine, cosine = float(np.linalg.norm(axis)), float(normal @ towards)
    axis = axis / sine
    along = (points @ axis)[:, None] * axis
    return np.asarray(along + (points - along) * cosine + np.cross(axis, points) * sine)


def write(file: Path, edge_mm: float) -> None:
    """Write the net as PDF, to scale, two pages of A4; raises OSError.

    `edge_mm`: edge of the solid, SMALLEST_MM to LARGEST_MM.
    """
    from matplotlib.backends.backend_pdf import PdfPages

    undated = {"CreationDate": None, "ModDate": None, "Title": f"Dodecahedron, {edge_mm:g} mm"}
    with PdfPages(str(file), metadata=undated) as pages:
        for index in range(2):
            pages.savefig(figure(index, edge_mm))


def figure(index: int, edge_mm: float) -> Any:
    """A sheet as matplotlib's figure, of the size of A4."""
    from matplotlib.figure import Figure
    from matplotlib.patches import PathPatch, Polygon
    from matplotlib.path import Path as Outline

    drawn = Figure(figsize=(SHEET_MM[0] / 25.4, SHEET_MM[1] / 25.4))
    axes = drawn.add_axes((0, 0, 1, 1))
    axes.set_xlim(0, SHEET_MM[0])
    axes.set_ylim(0, SHEET_MM[1])
    axes.axis("off")
    middle = np.array(SHEET_MM) / 2

    def text(at: Array, words: str, size: float) -> None:
        axes.text(at[0], at[1], words, size=size, ha="center", va="center", color="0.5")

    for tab in tabs(index):
        outline = tab.outline * edge_mm + middle
        axes.add_patch(Polygon(outline, fill=False, edgecolor="0.6", lw=0.4))
        text(outline.mean(axis=0), str(tab.number), edge_mm / 6)
    for flat in sheet(index):
        vertices = flat.vertices * edge_mm + middle
        axes.add_patch(Polygon(vertices, fill=False, edgecolor="0.6", lw=0.4))
        cells = marker_outline(flat) * edge_mm + middle
        corners = np.concatenate([cells, cells[:, :1]], axis=1).reshape(-1, 2)
        codes = np.tile([Outline.MOVETO] + [Outline.LINETO] * 3 + [Outline.CLOSEPOLY], len(cells))
        axes.add_patch(PathPatch(Outline(corners, codes), facecolor="black", lw=0))
        _number_edges(index, flat, edge_mm, lambda at, words, size: text(at + middle, words, size))
    left = np.array([(SHEET_MM[0] - BAR_MM) / 2, 14.0])
    axes.plot([left[0], left[0] + BAR_MM], [left[1]] * 2, color="black", lw=0.6)
    for x in (left[0], left[0] + BAR_MM):
        axes.plot([x, x], [left[1] - 2, left[1] + 2], color="black", lw=0.6)
    text(
        left + np.array([BAR_MM / 2, 3]),
        f"{BAR_MM:g} mm: measure it; print at 100 %, on matt white paper",
        8,
    )
    text(np.array([SHEET_MM[0] / 2, SHEET_MM[1] - 18]),
         f"lightprobe, dodecahedron:{edge_mm:g}mm, sheet {index + 1} of 2. Cut along the outline, "
         "fold back,\nglue each tab behind the edge of its number. Print outside.", 8)  # fmt: skip
    return drawn


def _number_edges(index: int, flat: Flat, edge_mm: float, text: Any) -> None:
    """Small numbers beside the edges that tabs are glued to: outside of the face."""
    middle, _ = _SHEETS[index]
    for k, number, other in edges_of(flat.number):
        if middle in (flat.number, other) or flat.number < other:
            continue
        at = (flat.vertices[k] + flat.vertices[(k + 1) % 5]) / 2
        outward = at - flat.centre
        text((at + outward / np.linalg.norm(outward) * 0.08) * edge_mm, str(number), edge_mm / 6)


def marker_outline(flat: Flat) -> Array:
    """(N, 4, 2) corners of the black cells of a face's marker, in edges from the sheet's middle."""
    rows, columns = np.nonzero(solid.marker_cells(flat.number))
    side = solid.MARKER / 7
    left, top = columns * side - solid.MARKER / 2, solid.MARKER / 2 - rows * side
    x = np.stack([left, left + side, left + side, left], axis=1)
    y = np.stack([top, top, top - side, top - side], axis=1)
    return np.asarray(flat.centre + np.stack([x, y], axis=-1) @ flat.axes)
