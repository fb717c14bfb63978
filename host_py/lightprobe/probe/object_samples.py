"""What a picture shows of an object whose shape is known, and of the paper on which it stands."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from lightprobe.bake import mesh, visibility
from lightprobe.calibrate.lens_board import Board
from lightprobe.errors import UsageError
from lightprobe.geometry import Array, cross
from lightprobe.imaging.ball import Pinhole
from lightprobe.probe import board as boards
from lightprobe.probe import paper, shadow_maps
from lightprobe.probe.kinds import ProbeError

_SHAPE = re.compile(
    r"object:(?P<file>.+?)(?:@(?P<column>\d+(?:\.\d+)?),(?P<row>\d+(?:\.\d+)?)"
    r"(?:,(?P<turn>-?\d+(?:\.\d+)?))?)?(?P<more>(?:,(?:albedo|unit)=[\w.]+)*)"
)
_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
_SMALLEST_MM, _LARGEST_MM = 5.0, 2000.0
_MOST_TRIANGLES = 200_000
#: Where the object stands may be off by so much, 1 sigma, in millimetres.
PLACE_SIGMA_MM = 0.5
#: Samples of the object that are tried, and at most kept; cells of the board that are looked at,
#: and parts of a square whose white cells are one sample.
_TRIED, _MOST, _CELLS, _PER_SQUARE = 8000, 1200, 200_000, 6
_LEAST_SAMPLES = 60
#: Places that are looked up in a row.
_ROW = 1024
#: Around borders and outlines so many pixels are left out.
_EDGE_PX = 2.0
#: A surface that is seen more aslant than this cosine is left out.
_LEAST_FACING = 0.15
#: A corner whose normal is further from the triangle's than this is a crease.
_CREASE = np.cos(np.radians(40))
#: Two samples so near each other are at an edge if their normals' cosine is below, or the step in
#: depth above, relative to the distance.
_BESIDE_PX, _EDGE, _STEP = 4.0, 0.8, 0.02
#: Shares of samples: of clipped ones, and of backs of triangles.
_MOST_CLIPPED, _MOST_BACKS, _TOLD_BACKS = 0.02, 0.3, 0.02


@dataclass(frozen=True)
class Shape:
    """An object that stands on the board, as the command line names it."""

    file: Path
    place: tuple[float, float] | None = None  # of the mesh's origin: columns, rows; None: middle
    turn_deg: float = 0.0  # to the left, seen from above
    albedo: float | None = None  # None: found from the picture
    unit_mm: float = 1000.0


def parse(text: str) -> Shape:
    """Read `object:FILE[@COLUMN,ROW[,TURN]][,albedo=A][,unit=mm]`; raises UsageError."""
    found = _SHAPE.fullmatch(text.strip())
    words = dict(word.split("=") for word in found["more"].split(",")[1:]) if found else {}
    try:
        albedo = float(words["albedo"]) if "albedo" in words else None
    except ValueError:
        albedo = float("nan")
    unit = words.get("unit", "m")
    if not found or unit not in _MM or not (albedo is None or 0.02 <= albedo <= 1):
        raise UsageError(
            f"--probe {text}: expected object:FILE, object:FILE@COLUMN,ROW of the board's squares "
            "or object:FILE@COLUMN,ROW,DEGREES to the left, perhaps with ,albedo=0.02…1 and "
            ",unit=mm, cm or m behind it, like object:vase.glb@5,4,albedo=0.8"
        )
    place = (float(found["column"]), float(found["row"])) if found["column"] else None
    turn_deg = float(found["turn"] or 0)
    if not abs(turn_deg) <= 360:
        raise UsageError(f"--probe {text}: a turn is −360 to 360 degrees")
    return Shape(Path(found["file"]), place, turn_deg, albedo, _MM[unit])


@dataclass(frozen=True, eq=False)
class Solid:
    """A mesh that stands on the board: the board's frame, its upper left corner 0; in squares."""

    vertices: Array  # (n, 3)
    normals: Array  # (n, 3)
    triangles: NDArray[np.int64]  # (m, 3)
    square_mm: float
    notes: tuple[str, ...] = ()


def stand(shape: Shape, board: Board, square_mm: float) -> Solid:
    """Read the mesh and stand it on the board by its lowest point; raises UsageError."""
    if not shape.file.exists() and ("@" in shape.file.name or "," in shape.file.name):
        raise UsageError(
            f"--probe object: {shape.file}: no such file: what follows its name is @COLUMN,ROW or "
            "@COLUMN,ROW,DEGREES, then ,albedo=A and ,unit=mm, cm or m"
        )
    try:
        read = mesh.read(shape.file)
    except UsageError as error:
        raise UsageError(str(error).replace("bake:", "--probe object:", 1)) from error
    where = f"--probe object: {shape.file}"
    if len(read.triangles) > _MOST_TRIANGLES:
        raise UsageError(
            f"{where}: {len(read.triangles)} triangles: simplify it to {_MOST_TRIANGLES} at most"
        )
    size_mm = float(np.ptp(read.vertices, axis=0).max()) * shape.unit_mm
    if not _SMALLEST_MM <= size_mm <= _LARGEST_MM:
        raise UsageError(
            f"{where}: is {size_mm:g} mm large; an object is {_SMALLEST_MM:g} mm to "
            f"{_LARGEST_MM / 1000:g} m: say the mesh's unit, like ,unit=mm"
        )
    place = shape.place or (board.columns // 2, board.rows // 2)
    if not (0 <= place[0] <= board.columns and 0 <= place[1] <= board.rows):
        raise UsageError(
            f"{where}: stands at {place[0]:g},{place[1]:g}, beside the board of "
            f"{board.columns}x{board.rows} squares"
        )
    turn = Rotation.from_euler("y", shape.turn_deg, degrees=True).as_matrix()
    vertices = read.vertices @ turn.T * (shape.unit_mm / square_mm)
    vertices += [place[0], -vertices[:, 1].min(), place[1]]
    notes = (
        f"the mesh is open along {read.open_edges} edges: what is inside is taken as dark",
    ) if read.open_edges else ()  # fmt: skip
    return Solid(vertices, read.normals @ turn.T, read.triangles, square_mm, notes)


@dataclass(frozen=True, eq=False)
class Samples:
    """Places that the camera sees, in squares in the board's frame; first those of the object."""

    places: Array  # (N, 3)
    normals: Array  # (N, 3) unit
    radiance: Array  # (N, 3)
    of_board: NDArray[np.bool_]  # (N,)
    surface: Array  # (M, 3) points strewn over the whole object
    facing: Array  # (M, 3) their normals, unit
    backs: float = 0.0  # share of the mesh that the camera sees that are backs of triangles
    notes: tuple[str, ...] = field(default=())


@dataclass(frozen=True, eq=False)
class View:
    """A picture, its camera, and how the board lies before it."""

    radiance: Array  # (H, W, 3)
    clipped: NDArray[np.bool_]  # (H, W)
    pinhole: Pinhole
    pose: boards.Pose

    def in_camera(self, places: Array) -> Array:
        """Places (N, 3) in squares on the board, in the camera's frame."""
        return np.asarray(self.pose.corner + places @ self.pose.rotation)


def look(view: View, board: Board, solid: Solid) -> Samples:
    """Read the picture where it shows the object and the paper; raises ProbeError."""
    in_camera = view.in_camera(solid.vertices)
    if in_camera[:, 2].max() > -1e-3:
        raise ProbeError(
            "the object would reach behind the camera: are its unit, its place (@COLUMN,ROW) and "
            "--square-mm right?"
        )
    per_px = paper.squares_per_px(view.pinhole, view.pose, board)
    mask = _outline(view, in_camera, solid)
    margin_px = _EDGE_PX + 2 * PLACE_SIGMA_MM / solid.square_mm / per_px
    side = 2 * int(np.ceil(margin_px)) + 1
    kernel = np.ones((side, side), np.uint8)
    inside, around = cv2.erode(mask, kernel), cv2.dilate(mask, kernel)
    which, share = shadow_maps.strewn(solid.vertices, solid.triangles, shadow_maps.POINTS)
    surface, _, facing = placed(solid, which, share)
    at, facing_to, shown, backs = _of_object(view, solid, np.asarray(inside, np.uint8))
    sheet = _of_board(view, board, np.asarray(around, np.uint8), per_px)
    places, normals, radiance = (
        np.concatenate([a, b]) for a, b in zip((at, facing_to, shown), sheet, strict=True)
    )
    of_board = np.arange(len(places)) >= len(at)
    notes = (
        f"{100 * backs:.0f} % of the mesh that the camera sees are backs of triangles: left out, "
        "and the sigma grows by it",
    ) if backs > _TOLD_BACKS else ()  # fmt: skip
    return Samples(
        places, normals, radiance, of_board, surface, facing, backs, (*solid.notes, *notes)
    )


def placed(
    solid: Solid, which: NDArray[np.int64], share: Array
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Places, normals of the triangles, and normals of the surface (N, 3) of points on it."""
    corners = solid.vertices[solid.triangles[which]]
    places = np.einsum("nk,nki->ni", share, corners)
    flat = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-30)
    at_corners = solid.normals[solid.triangles[which]]
    smooth = np.einsum("nk,nki->ni", share, at_corners)
    smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-30)
    crease = np.einsum("nki,ni->nk", at_corners, flat).min(axis=1) < _CREASE
    return places, flat, np.where(crease[:, None], flat, smooth)


def _outline(view: View, in_camera: Array, solid: Solid) -> NDArray[np.uint8]:
    """The object's silhouette: (H, W), 1 or 0."""
    mask = np.zeros(view.clipped.shape, np.uint8)
    limit = 4 * max(mask.shape)
    at = np.clip(view.pinhole.places(in_camera) - 0.5, -limit, limit)
    for corners in np.round(at[solid.triangles] * 16).astype(np.int32):
        cv2.fillConvexPoly(mask, corners, 1, shift=4)
    rows, columns = np.nonzero(mask)
    height, width = view.clipped.shape
    edge = (rows == 0) | (columns == 0) | (rows == height - 1) | (columns == width - 1)
    if len(rows) == 0 or edge.sum() > 0.2 * np.sqrt(len(rows)):
        raise ProbeError(
            "the object would not be whole in the picture: aim so that all of it is seen, and "
            "check its place (@COLUMN,ROW), its unit and --square-mm"
        )
    return mask


def _of_object(
    view: View, solid: Solid, inside: NDArray[np.uint8]
) -> tuple[Array, Array, Array, float]:
    """Places, normals and radiance of the object where the camera sees it, and share of backs."""
    which, share = shadow_maps.strewn(solid.vertices, solid.triangles, _TRIED)
    places, flat, normals = placed(solid, which, share)
    in_camera = view.in_camera(places)
    at_px = view.pinhole.places(in_camera)
    used = _at(inside.astype(np.float32), at_px) == 1
    used &= _first(view.in_camera(solid.vertices), solid.triangles, in_camera)
    to_camera = -in_camera @ view.pose.rotation.T
    to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
    facing = np.sum(flat * to_camera, axis=1)
    if used.sum() < _LEAST_SAMPLES:
        raise ProbeError(
            "too little of the object is seen in the picture: go nearer, let nothing stand before "
            "it, and check its place (@COLUMN,ROW), its unit and --square-mm"
        )
    backs = float((facing[used] < 0).mean())
    if backs > _MOST_BACKS:
        raise ProbeError(
            f"{100 * backs:.0f} % of the mesh that the camera sees are backs of triangles: turn "
            "the faces round and close the holes, in a modelling program"
        )
    used &= (facing > _LEAST_FACING) & (np.sum(normals * to_camera, axis=1) > _LEAST_FACING)
    kept = np.flatnonzero(used)
    kept = kept[_away_from_edges(at_px[kept], normals[kept], in_camera[kept, 2])]
    if len(kept) < _LEAST_SAMPLES:
        raise ProbeError("the object is too small in the picture: go nearer")
    kept = kept[np.linspace(0, len(kept) - 1, min(len(kept), _MOST)).astype(int)]
    radiance, bad = _values(view, at_px[kept])
    _check_exposure(bad, "object")
    good = kept[~bad]
    return places[good], normals[good], radiance[~bad], backs


def _away_from_edges(at_px: Array, normals: Array, depth: Array) -> NDArray[np.bool_]:
    """Which samples have no edge beside them: another way to face, or a step in depth.

    `at_px` (N, 2) places in the picture, `normals` (N, 3), `depth` (N,) along the camera's axis.
    """
    pairs = cKDTree(at_px).query_pairs(_BESIDE_PX, output_type="ndarray")
    one, other = pairs.T
    apart = np.sum(normals[one] * normals[other], axis=1) < _EDGE
    apart |= np.abs(depth[one] - depth[other]) > _STEP * np.abs(depth[one])
    good = np.ones(len(at_px), bool)
    good[pairs[apart].ravel()] = False
    return good


def _first(
    vertices: Array, triangles: NDArray[np.int64], places: Array
) -> NDArray[np.bool_]:  # fmt: skip
    """Which places (N, 3) the camera sees: no triangle is before them. All in the camera's frame.

    Rays through the lens become parallel under (x, y, z) → (x, y, 1)/−z, and planes stay planes.
    """

    def mapped(points: Array) -> Array:
        return np.asarray(np.concatenate([points[:, :2], np.ones((len(points), 1))], axis=1)
                          / -points[:, 2:])  # fmt: skip

    of_mesh, asked = mapped(vertices), mapped(places)
    scale = np.ptp(of_mesh[:, :2]) / max(float(np.ptp(of_mesh[:, 2])), 1e-12)
    of_mesh[:, 2] *= scale
    asked[:, 2] *= scale
    toward = np.array([[0.0, 0.0, 1.0]])
    return np.asarray(visibility.visible(of_mesh, triangles, toward, points=asked)[0])


def _of_board(
    view: View, board: Board, around: NDArray[np.uint8], per_px: float
) -> tuple[Array, Array, Array]:
    """Places, normals and radiance of white paper: means over parts of the board's squares."""
    cell = max(per_px, float(np.sqrt(board.columns * board.rows / _CELLS)))
    across, down = (int(count / cell) for count in (board.columns, board.rows))
    x, z = np.meshgrid((np.arange(across) + 0.5) * cell, (np.arange(down) + 0.5) * cell)
    white, _ = paper.printed(board, cell, across, down, _EDGE_PX * per_px)
    places = np.stack([x, np.zeros_like(x), z], axis=-1)[white]
    at_px = view.pinhole.places(view.in_camera(places))
    free = _at(1 - around.astype(np.float32), at_px) == 1
    radiance, bad = _values(view, at_px, side=1)
    if free.sum() < _LEAST_SAMPLES:
        raise ProbeError(
            "too little white paper of the board is seen around the object: go nearer, or take a "
            "larger board"
        )
    _check_exposure(bad[free], "white paper")
    used = free & ~bad
    part = np.floor(places * _PER_SQUARE).astype(int)
    number = part[:, 2] * board.columns * _PER_SQUARE + part[:, 0]
    _, index = np.unique(number[used], return_inverse=True)
    count = np.bincount(index)

    def means(values: Array) -> Array:
        sums = [np.bincount(index, values[:, k]) / count for k in range(3)]
        return np.stack(sums, axis=1)

    whole = count > 0.15 * count.max()
    found, seen = means(places[used])[whole], means(radiance[used])[whole]
    return found, np.tile([0.0, 1.0, 0.0], (len(found), 1)), seen


def _values(view: View, at_px: Array, side: int = 3) -> tuple[Array, NDArray[np.bool_]]:
    """Radiance (N, 3) at places (N, 2), a mean over side × side pixels; and whether it clips."""
    picture = view.radiance.astype(np.float32)
    bad = view.clipped.astype(np.float32)
    if side > 1:
        picture, bad = (np.asarray(cv2.blur(one, (side, side)), np.float32)
                        for one in (picture, bad))  # fmt: skip
    return _at(picture, at_px), _at(bad, at_px) > 0.01


def _at(picture: NDArray[np.float32], at_px: Array) -> Array:
    """Values (N, …) of a picture at places (N, 2); 0 outside of it."""
    rows = -(-len(at_px) // _ROW)  # OpenCV takes no more than 32767 in one
    grid = np.full((rows * _ROW, 2), -1.0, np.float32)
    grid[: len(at_px)] = at_px - 0.5
    found = paper.looked_up(picture, grid.reshape(rows, _ROW, 2), 0.0)
    return found.reshape(rows * _ROW, *picture.shape[2:])[: len(at_px)]


def _check_exposure(bad: NDArray[np.bool_], what: str) -> None:
    if bad.mean() > _MOST_CLIPPED:
        raise ProbeError(
            f"{100 * bad.mean():.0f} % of the {what} is overexposed: expose less, or add a shorter "
            "exposure"
        )
