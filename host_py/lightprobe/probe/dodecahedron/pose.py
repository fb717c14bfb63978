"""Where the solid is in a picture, by all of its markers that are read."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.geometry import Array
from lightprobe.imaging.ball import Pinhole
from lightprobe.probe import pnp
from lightprobe.probe.dodecahedron import solid
from lightprobe.probe.kinds import ProbeError

#: 1 sigma of a corner in the picture, and how far corners may be from a solid, RMS: in pixels and
#: in sides of the marker, since paper that is folded by hand is not exact.
_CORNER_SIGMA_PX, _MOST_PX, _MOST_SHARE = 0.15, 1.0, 0.05
#: 1 sigma of how far a face of folded paper is turned.
FOLD_SIGMA_DEG = 0.7
#: Markers whose side is shorter are not read well.
_SMALLEST_PX = 12.0


@dataclass(frozen=True, eq=False)
class Pose:
    """Where the solid is, and which of its faces are read."""

    rotation: Array  # (3, 3) frame of the solid → camera frame
    centre: Array  # (3,) camera frame, in edges of the solid
    faces: tuple[int, ...]  # whose markers are read
    sigma_deg: float  # 1 sigma of the rotation about its worst axis
    off_px: float  # RMS, of the corners

    def places(self, pinhole: Pinhole, points: Array) -> Array:
        """Places (N, 2) in the picture of points (N, 3) in the frame of the solid."""
        return pinhole.places(points @ self.rotation.T + self.centre)


def markers(grey: NDArray[np.uint8]) -> tuple[list[int], Array]:
    """Numbers of the markers in a grey picture (H, W), and their corners (N, 4, 2) in pixels.

    The first pixel's centre is at (0.5, 0.5). Markers of other numbers are left out.
    """
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    settings.adaptiveThreshWinSizeMax = 43
    corners, numbers, _ = cv2.aruco.ArucoDetector(solid.dictionary(), settings).detectMarkers(grey)
    if numbers is None:
        return [], np.zeros((0, 4, 2))
    found = [
        (int(number), np.asarray(four, np.float64).reshape(4, 2) + 0.5)
        for number, four in zip(np.ravel(numbers), corners, strict=True)
        if number < solid.FACES
    ]
    return [one[0] for one in found], np.array([one[1] for one in found]).reshape(-1, 4, 2)


def find(grey: NDArray[np.uint8], pinhole: Pinhole) -> Pose:
    """Find the solid in a grey picture (H, W); raises ProbeError with what to do.

    The pose is that of least squares of all corners (Levenberg and Marquardt). One marker alone
    tells its tilt in two ways, so two at least are needed.
    """
    numbers, corners = markers(grey)
    if not numbers:
        mirrored, _ = markers(np.ascontiguousarray(grey[:, ::-1]))
        if mirrored:
            raise ProbeError(
                "the dodecahedron is mirrored: print it as it is, and use pictures that the camera "
                "did not mirror (selfie cameras often do)"
            )
        raise ProbeError(
            "no dodecahedron is found: no marker of it is read: let it be sharp, well lit and not "
            "overexposed, and at least 60 pixels across"
        )
    twice = sorted({number for number in numbers if numbers.count(number) > 1})
    if twice:
        raise ProbeError(
            f"marker {twice[0]} is seen twice: let one dodecahedron alone be in the picture"
        )
    side_px = float(np.median(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)))
    if side_px < _SMALLEST_PX:
        raise ProbeError(f"the dodecahedron's markers are {side_px:.0f} pixels wide: go nearer")
    if len(numbers) < 2:
        raise ProbeError(
            f"marker {numbers[0]} alone is read: turn the dodecahedron so that an edge or a corner "
            "of it faces the camera, and let nothing cover it"
        )
    return solved(numbers, corners, pinhole, side_px)


def solved(numbers: list[int], corners: Array, pinhole: Pinhole, side_px: float) -> Pose:
    """The pose by markers (N,) and their corners (N, 4, 2); raises ProbeError."""
    points = np.concatenate([solid.faces()[number].marker for number in numbers])
    found = pnp.solve(points, corners.reshape(-1, 2), pinhole, cv2.SOLVEPNP_SQPNP, _CORNER_SIGMA_PX)
    off_px = found.off_px if found else np.inf
    if (
        found is None
        or not off_px < max(_MOST_PX, _MOST_SHARE * side_px)
        or any(_faces_away(number, found) for number in numbers)
    ):
        raise ProbeError(
            f"the markers {', '.join(map(str, sorted(numbers)))} contradict each other by "
            f"{off_px:.1f} pixels: is each face where the drawing has it, is the dodecahedron "
            "whole and the only one, and are --intrinsics those of this camera?"
        )
    return Pose(
        rotation=pnp.FROM_OPENCV @ found.matrix,
        centre=pnp.FROM_OPENCV @ found.shift,
        faces=tuple(sorted(numbers)),
        sigma_deg=found.sigma_deg,
        off_px=off_px,
    )


def _faces_away(number: int, found: pnp.Solved) -> bool:
    """Whether the camera would see the back of a face."""
    face = solid.faces()[number]
    return not (found.matrix @ face.normal) @ (found.matrix @ face.centre + found.shift) < 0
