"""What the white paper of each face shows."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.geometry import Array
from lightprobe.imaging.ball import Pinhole
from lightprobe.probe.dodecahedron import solid
from lightprobe.probe.dodecahedron.pose import Pose

#: Beside the marker and the edges so many pixels are left out, and as a share of an edge at least.
_EDGE_PX, _EDGE = 2.0, 0.03
_FEWEST_PX = 30
_MOST_CLIPPED = 0.02
#: The paper of a face may differ from a plane by this share, RMS; else something is on it.
_MOST_UNEVEN = 0.06
#: Faces seen at a smaller cosine are left out.
_LEAST_COSINE = 0.15
_OUTLIER_SIGMAS = 4.0


@dataclass(frozen=True, eq=False)
class Reading:
    """The paper of one face; directions and places in the frame of the estimate."""

    face: int
    normal: Array  # (3,) unit
    place: Array  # (3,) of its middle from the solid's centre, in edges
    corners: Array  # (5, 3) points half-way from there to its vertices, from the solid's centre
    camera: Array  # (3,) from the solid's centre, in edges
    radiance: Array  # (3,)
    sigma: float  # relative: 1 sigma of how uneven the paper is, of its mean
    slope: float  # relative: how much the radiance changes from the middle to a vertex


@dataclass(frozen=True, eq=False)
class Readings:
    """All faces of one picture that can be used, and why others cannot."""

    faces: tuple[Reading, ...]
    notes: tuple[str, ...] = ()
    uneven: int = 0  # faces that are left out because they are lit unevenly


def read(
    radiance: Array, clipped: NDArray[np.bool_], pinhole: Pinhole, pose: Pose, rotation: Array
) -> Readings:
    """Measure the white paper around the markers of a picture.

    `radiance`: (H, W, 3), linear. `clipped`: (H, W) where it is overexposed. `rotation`: (3, 3)
    camera frame → frame of the estimate. Only faces whose marker is read are measured: what covers
    a marker would be in the light, too. Clipped and uneven faces are left out, with a note.
    """
    found, notes, uneven_faces = [], [], 0
    for number in pose.faces:
        face = solid.faces()[number]
        middle = pose.rotation @ face.centre + pose.centre
        towards = -middle / np.linalg.norm(middle)
        normal = pose.rotation @ face.normal
        if normal @ towards < _LEAST_COSINE:
            continue
        rows, columns = _paper(face, pinhole, pose, clipped.shape)
        if len(rows) < _FEWEST_PX:
            notes.append(f"face {number} is too small in the picture: go nearer")
            continue
        over = float(clipped[rows, columns].mean())
        if over > _MOST_CLIPPED:
            notes.append(
                f"{100 * over:.0f} % of face {number} is overexposed: it is left out: expose less"
            )
            continue
        values = radiance[rows, columns]
        level, uneven, slope = _even(values, np.stack([columns, rows], axis=1))
        if uneven > _MOST_UNEVEN:
            uneven_faces += 1
            notes.append(
                f"face {number} is lit unevenly, by {100 * uneven:.0f} %: a shadow, a finger or a "
                "stain is on it: it is left out"
            )
            continue
        found.append(Reading(
            number, rotation @ normal, rotation @ (pose.rotation @ face.centre),
            ((face.vertices + face.centre) / 2) @ (rotation @ pose.rotation).T,
            -rotation @ pose.centre, level, uneven, slope,
        ))  # fmt: skip
    return Readings(tuple(found), tuple(notes), uneven_faces)


def _paper(
    face: solid.Face, pinhole: Pinhole, pose: Pose, shape: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the pixels of a face's white paper."""
    inner = face.centre + (face.vertices - face.centre) * (1 - _EDGE / solid.EDGE)
    outer = face.centre + (face.marker - face.centre) * (1 + 2 * _EDGE / solid.MARKER)
    places = pose.places(pinhole, inner)
    low = np.maximum(np.floor(places.min(axis=0)).astype(int) - 4, 0)
    high = np.minimum(np.ceil(places.max(axis=0)).astype(int) + 4, np.array(shape[1::-1]))
    if np.any(high - low < 3):
        empty = np.zeros(0, np.int64)
        return empty, empty
    mask = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
    _fill(mask, places - low, 1)
    mask[[0, -1]] = 0
    mask[:, [0, -1]] = 0
    side = 2 * int(np.ceil(_EDGE_PX)) - 1
    kernel = np.ones((side, side), np.uint8)
    mask = np.asarray(cv2.erode(mask, kernel), np.uint8)
    marker = np.zeros_like(mask)
    _fill(marker, pose.places(pinhole, outer) - low, 1)
    rows, columns = np.nonzero((mask > 0) & (cv2.dilate(marker, kernel) == 0))
    return rows + low[1], columns + low[0]


def _fill(mask: NDArray[np.uint8], places: Array, value: int) -> None:
    """Fill a polygon (N, 2) whose places have the first pixel's centre at (0.5, 0.5)."""
    bits = 4
    cv2.fillConvexPoly(
        mask, np.round((places - 0.5) * 2**bits).astype(np.int32), value, cv2.LINE_8, bits
    )


def _even(values: Array, at: NDArray[np.int64]) -> tuple[Array, float, float]:
    """Level (3,) in the middle of a face, how uneven it is, and how much it slopes: shares.

    A plane through the values, without outliers. Uneven: what differs from it, averaged over five
    parts of the face, so that the noise of pixels does not count.
    """
    grey = values.mean(axis=1)
    middle = (at.max(axis=0) + at.min(axis=0)) / 2
    size = max(float(np.ptp(at, axis=0).max()) / 2, 1.0)
    design = np.column_stack([np.ones(len(at)), (at - middle) / size])
    used = np.ones(len(at), bool)
    for _ in range(3):
        plane = np.linalg.lstsq(design[used], grey[used], rcond=None)[0]
        off = grey - design @ plane
        spread = 1.4826 * float(np.median(np.abs(off))) + 1e-12
        used = np.abs(off) < _OUTLIER_SIGMAS * spread
    level = np.median(values[used], axis=0)
    scale = max(float(level.mean()), 1e-30)
    turn = np.arctan2(*((at - middle) / size).T)
    parts = np.floor((turn + np.pi) / (2 * np.pi) * 10).astype(int) % 10
    means = [float(np.median(off[parts == k])) for k in range(10) if np.any(parts == k)]
    uneven = max(float(np.sqrt(np.mean(np.square(means)))), float(1 - used.mean()) * spread) / scale
    return level, uneven, float(np.linalg.norm(plane[1:])) / scale
