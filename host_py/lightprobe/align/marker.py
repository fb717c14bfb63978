"""The mount's rotation from a printed marker on the probe that a camera of the head sees.

An ArUco marker (Garrido-Jurado and others, Pattern Recognition 47, 2014) is found by OpenCV; its
pose comes from its four corners (Collins and Bartoli, "Infinitesimal plane-based pose estimation",
2014). A small marker seen from straight ahead has two poses that look alike: such a picture is left
out where it does not tell which one it is.

Frames: the marker's has +X to its right, +Y up on the paper and +Z out of the paper; cameras
+X right, +Y up, −Z forward, as AR frameworks have them (OpenCV's has +Y down, +Z forward).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lightprobe.align.track import AlignError
from lightprobe.geometry import Array

#: Markers of the dictionary DICT_4X4_50.
MARKERS = 50
#: Modules across, the black border included; on paper one more of white is needed on each side.
_MODULES = 6
_QUIET_MODULES = 1
#: Sides of the box that the marker may be glued to, top of the paper up (for top and bottom:
#: forward); each as marker → probe, columns are where the marker's axes point in the probe's frame.
SIDES: dict[str, Array] = {
    "front": np.array([[-1, 0, 0], [0, 1, 0], [0, 0, -1.0]]).T,
    "back": np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1.0]]).T,
    "right": np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0.0]]).T,
    "left": np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0.0]]).T,
    "top": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]]).T,
    "bottom": np.array([[-1, 0, 0], [0, 0, -1], [0, -1, 0.0]]).T,
}
#: From OpenCV's camera to that of AR frameworks.
_FROM_OPENCV = Rotation.from_matrix(np.diag([1.0, -1, -1]))
#: A corner is found so exactly, at best.
_CORNER_SIGMA_PX = 0.2
#: The second pose is ruled out where its corners are off by so many times as much.
_UNLIKE = 2.0
_LEAST_SIDE_PX = 20.0
#: Pictures that are further off the others than this are left out.
_OUTLIER_DEG, _OUTLIER_SIGMAS = 1.0, 4.0


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole camera with OpenCV's distortion; pixels, the first one's centre at (0, 0)."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, ...] = ()  # k1, k2, p1, p2[, k3]

    @property
    def matrix(self) -> Array:
        """OpenCV's camera matrix."""
        return np.array([[self.fx_px, 0, self.cx_px], [0, self.fy_px, self.cy_px], [0, 0, 1.0]])


@dataclass(frozen=True, eq=False)
class Sight:
    """The marker in one picture."""

    rotation: Rotation  # probe → camera
    sigma_deg: float  # about the worst axis


@dataclass(frozen=True, eq=False)
class FromMarker:
    """Rotation of a mount, found by pictures of a marker."""

    rotation: Rotation  # probe → head
    sigma_deg: float  # 1 sigma about the axis known worst
    residual_deg: float  # RMS of the pictures' rotations around the mean; 0 of a single one
    used: tuple[bool, ...]  # one for each picture that shows the marker

    def to_json(self) -> dict[str, object]:
        """Plain values."""
        return {
            "rotation_xyzw": self.rotation.as_quat(canonical=True).tolist(),
            "sigma_deg": self.sigma_deg,
            "residual_deg": self.residual_deg,
            "pictures_used": sum(self.used),
        }


def _dictionary() -> Any:
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)


def draw(number: int, side_px: int) -> NDArray[np.uint8]:
    """Give a marker with its white edge as a grey picture; its black square has `side_px`."""
    module_px = side_px // _MODULES
    black = cv2.aruco.generateImageMarker(_dictionary(), number, _MODULES * module_px)
    edge_px = _QUIET_MODULES * module_px
    return np.pad(np.asarray(black, np.uint8), edge_px, constant_values=255)


def find(picture: NDArray[np.uint8], number: int, camera: Intrinsics, side: str) -> Sight | str:
    """Find the marker in a grey picture (H, W); or say why it does not tell the rotation."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(_dictionary(), parameters)
    corners, numbers, _ = detector.detectMarkers(picture)
    places = [] if numbers is None else np.flatnonzero(np.ravel(numbers) == number)
    if len(places) != 1:
        return "the marker is not found" if len(places) == 0 else "the marker is there twice"
    seen = np.asarray(corners[places[0]], np.float64).reshape(4, 2)
    side_px = float(np.mean(np.linalg.norm(seen - np.roll(seen, 1, axis=0), axis=1)))
    if side_px < _LEAST_SIDE_PX:
        return f"the marker is {side_px:.0f} pixels across: go nearer"
    square = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]], np.float64) / 2
    distortion = np.asarray(camera.distortion or (0.0,) * 4)
    _, turns, shifts, errors = cv2.solvePnPGeneric(
        square, seen, camera.matrix, distortion, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    off_px = np.ravel(errors)
    if len(off_px) > 1 and off_px[1] < _UNLIKE * max(off_px[0], _CORNER_SIGMA_PX):
        return "two poses of the marker look alike: take the picture from nearer, and from aside"
    marker = Rotation.from_rotvec(np.ravel(turns[0]))
    rotation = _FROM_OPENCV * marker * Rotation.from_matrix(SIDES[side]).inv()
    _, slopes = cv2.projectPoints(square, turns[0], shifts[0], camera.matrix, distortion)
    noise_px = max(float(off_px[0]), _CORNER_SIGMA_PX)
    covariance = noise_px**2 * np.linalg.inv(slopes[:, :6].T @ slopes[:, :6])[:3, :3]
    sigma_deg = float(np.degrees(np.sqrt(np.linalg.eigvalsh(covariance)[-1])))
    return Sight(rotation, sigma_deg)


def combine(sights: Sequence[Sight], head_from_camera: Rotation) -> FromMarker:
    """Mean over pictures, weighed by their sigmas, without those that contradict the others."""
    if not sights:
        raise AlignError("align: marker: no picture shows it: see the notes above")
    sigma = np.array([sight.sigma_deg for sight in sights])
    rotations = Rotation.concatenate([sight.rotation for sight in sights])
    # From the picture that most others agree with, so that one outlier does not shift the mean.
    apart = np.degrees([(one.inv() * rotations).magnitude() for one in rotations])
    centre = rotations[int(np.argmin(np.median(apart, axis=1)))]
    limit = np.maximum(_OUTLIER_DEG, _OUTLIER_SIGMAS * sigma)
    used = np.degrees((centre.inv() * rotations).magnitude()) < limit
    if used.sum() <= len(sights) / 2 and len(sights) > 1:
        raise AlignError(
            f"align: marker: the pictures contradict each other (only {used.sum()} of "
            f"{len(sights)} agree): the probe must not move on the head, and --intrinsics must be "
            "those of this camera"
        )
    mean = rotations[used].mean(weights=1 / sigma[used] ** 2)
    off_deg = np.degrees((mean.inv() * rotations[used]).magnitude())
    formal_deg = 1 / float(np.sqrt(np.sum(1 / sigma[used] ** 2)))
    chi2 = float(np.mean((off_deg / sigma[used]) ** 2)) if used.sum() > 1 else 1.0
    return FromMarker(
        head_from_camera * mean, formal_deg * max(1.0, np.sqrt(chi2)),
        float(np.sqrt(np.mean(off_deg**2))), tuple(bool(u) for u in used),
    )  # fmt: skip


def read(path: Path) -> NDArray[np.uint8]:
    """Read a picture as grey values; raises :class:`AlignError`."""
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.is_file() else None
    if picture is None:
        raise AlignError(f"align: {path}: read: no picture: name PNG or JPEG files")
    return np.asarray(picture, np.uint8)
