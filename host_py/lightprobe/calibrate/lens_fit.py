"""A fisheye lens from pictures of a board: start, least squares, what is left out, what is known.

Two models: OpenCV's fisheye (lightprobe.calibrate.lens_adjust), which is that of camera files, and
OpenCV's omnidir (lens_omnidir), which is rewritten as such.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from lightprobe.calibrate import lens_adjust, lens_omnidir
from lightprobe.calibrate.lens_adjust import Adjusted
from lightprobe.calibrate.lens_board import Corners
from lightprobe.errors import LightprobeError
from lightprobe.geometry import Array
from lightprobe.imaging.camera import Lens

MODELS = ("fisheye", "omnidir")
LEAST_PICTURES = 6
#: Fields of view across the picture's shorter side that are tried as a start.
_STARTS_DEG = (90.0, 120.0, 150.0, 180.0, 210.0, 240.0)
#: A picture is left out when it is so many times as wrong as the middle one, and by so many pixels.
_OUTLIER, _OUTLIER_PX = 3.0, 0.5
#: Fits that are worse than this, in pixels and of the picture's height, explain nothing.
_MOST_RMS_PX, _MOST_RMS_SHARE = 2.0, 0.004
#: Corners must reach so far to the picture's edge, all around.
LEAST_COVERED = 0.5
#: Directions are known at the edge by what is known to within so many degrees, 1 sigma.
_MOST_SIGMA_DEG = 1.0
_RADIUS_STEPS = 1024


class LensError(LightprobeError):
    """The pictures do not say what the lens is; says why, and what to do."""


@dataclass(frozen=True)
class Fit:
    """A lens, and how well it explains the corners."""

    model: str
    lens: Lens  # max_theta_deg: the farthest corner off the axis
    size_px: tuple[int, int]
    rms_px: float  # distance of corners, root mean square
    picture_rms_px: tuple[float, ...]  # of each picture; NaN: it was left out
    corners: int
    covered: float  # share of the picture's inscribed circle that corners reach, 12 parts by angle
    adjusted: Adjusted  # of the fisheye model

    def sigma_deg(self, max_theta_deg: float) -> float:
        """1 sigma of where pixels look, to an angle off the axis: the worst, fisheye model."""
        angles = np.linspace(1, max_theta_deg, 64)
        return float(lens_adjust.sigma_deg(self.adjusted, angles).max())


def fit(pictures: Sequence[Corners], size_px: tuple[int, int], model: str = "fisheye") -> Fit:
    """Fit a lens to what pictures of one size (width, height) show.

    Raises :class:`LensError`, and what lens_omnidir.fit() raises.
    """
    if len(pictures) < LEAST_PICTURES:
        raise LensError(
            f"calibrate: lens: the board is found in {len(pictures)} pictures, expected at least "
            f"{LEAST_PICTURES}: take more, sharp and well lit, with the board large and tilted"
        )
    _refuse_middle_only(pictures, size_px)
    focal_px = min((_start_error(pictures, size_px, deg), deg) for deg in _STARTS_DEG)[1]
    adjusted = lens_adjust.adjust(pictures, size_px, _focal(size_px, focal_px))
    worst = max(_OUTLIER * float(np.median(adjusted.picture_rms_px)), _OUTLIER_PX)
    kept = [k for k, rms in enumerate(adjusted.picture_rms_px) if rms <= worst]
    if len(kept) < LEAST_PICTURES:
        raise _contradiction()
    chosen = [pictures[k] for k in kept]
    if len(kept) < len(pictures):
        adjusted = lens_adjust.adjust(chosen, size_px, adjusted.lens.focal_px[0])
    lens, of_kept = adjusted.lens, adjusted.picture_rms_px
    if model == "omnidir":
        lens, of_kept = lens_omnidir.fit(chosen, size_px, lens.max_theta_deg)
    rms_px = np.full(len(pictures), np.nan)
    rms_px[kept] = of_kept
    used = [k for k in kept if np.isfinite(rms_px[k])]
    weights = [len(pictures[k].board) for k in used]
    mean_px = float(np.sqrt(np.average(rms_px[used] ** 2, weights=weights)))
    if mean_px > max(_MOST_RMS_PX, _MOST_RMS_SHARE * min(size_px)):
        raise _contradiction()
    every = np.concatenate([pictures[k].picture_px for k in used])
    result = Fit(
        model, lens, size_px, mean_px, tuple(rms_px.tolist()), len(every),
        _covered(every, np.array(lens.centre_px), size_px), adjusted,
    )  # fmt: skip
    _refuse_unknown(result)
    return result


def grows_to_deg(lens: Lens, max_theta_deg: float) -> float:
    """How far off the axis the image radius grows, at most to `max_theta_deg`."""
    theta = np.linspace(0, np.radians(max_theta_deg), _RADIUS_STEPS)
    stops = np.flatnonzero(np.diff(lens.radius(theta)) <= 0)
    return float(np.degrees(theta[stops[0]])) if len(stops) else max_theta_deg


def _contradiction() -> LensError:
    return LensError(
        "calibrate: lens: the pictures contradict each other, or this is no fisheye lens with its "
        "axis near the middle: is the board flat, the focus fixed, and every picture of one camera?"
    )


def _refuse_middle_only(pictures: Sequence[Corners], size_px: tuple[int, int]) -> None:
    every = np.concatenate([p.picture_px for p in pictures])
    covered = _covered(every, np.array(size_px) / 2, size_px)
    if covered < LEAST_COVERED:
        raise LensError(
            f"calibrate: lens: corners reach {100 * covered:.0f} % of the way from the middle to "
            f"the edge, expected at least {100 * LEAST_COVERED:.0f} %, all around: add pictures "
            "with the board at the edges of the picture, on every side"
        )


def _refuse_unknown(found: Fit) -> None:
    sigma_deg = found.sigma_deg(found.lens.max_theta_deg)
    if not sigma_deg < _MOST_SIGMA_DEG:
        raise LensError(
            f"calibrate: lens: where pixels look is known to {sigma_deg:.1f} degrees only: take "
            "more pictures, with the board nearer, tilted, and at all edges"
        )
    farthest = found.lens.max_theta_deg
    if grows_to_deg(found.lens, farthest) < farthest:
        raise LensError(
            "calibrate: lens: no lens explains the pictures: take more near the edges, all around"
        )


def _focal(size_px: tuple[int, int], field_deg: float) -> float:
    return min(size_px) / float(np.radians(field_deg))


def _start_error(pictures: Sequence[Corners], size_px: tuple[int, int], field_deg: float) -> float:
    """How badly boards look flat through an equidistant lens of this field of view, in radians."""
    focal_px = _focal(size_px, field_deg)
    errors = []
    for corners in pictures:
        directions = lens_adjust.rays(corners, size_px, focal_px)
        pose = lens_adjust.pose_of(corners, directions)
        places = corners.board @ cv2.Rodrigues(pose[:3])[0].T + pose[3:]
        seen = places / np.linalg.norm(places, axis=1, keepdims=True)
        errors.append(np.mean(np.linalg.norm(seen - directions, axis=1)))
    return float(np.median(errors))


def _covered(places_px: Array, centre_px: Array, size_px: tuple[int, int]) -> float:
    """Mean over 12 sectors of how far out corners reach, of the way to the picture's edge."""
    offset = places_px - centre_px
    sector = ((np.degrees(np.arctan2(offset[:, 1], offset[:, 0])) % 360) // 30).astype(int)
    reach = np.hypot(*offset.T) / (min(size_px) / 2)
    return float(np.mean([min(reach[sector == k].max(initial=0), 1.0) for k in range(12)]))
