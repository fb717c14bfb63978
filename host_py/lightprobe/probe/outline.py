"""The outline of a ball in a picture, to a fraction of a pixel.

The rays that touch a ball form a cone: of a known shape, with three unknowns (two of its axis, and
its half angle). So what is fitted to the edges is that cone, in the rays of the camera, and not a
circle or a free ellipse: perspective and distortion of the lens are in it.

A mirror ball shows much that runs along its rim: the nearer to the rim, the more the room is
squeezed. So edges are first looked for within some pixels of a guess, and then within fewer and
fewer of the last fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.geometry import Array, cross
from lightprobe.imaging.ball import Pinhole

_ANGLES = 360
#: Half widths of the search around the last fit: the first relative to the radius, then in pixels.
_FIRST_SHARE, _THEN_SHARE, _THEN_PX = 0.06, 0.04, (6.0, 3.5, 2.0, 1.5, 1.5, 1.5, 1.5)
_STEP_PX = 0.25
#: The outermost edges of a mirror: from this step of the search on, of at least this share of the
#: strongest; and how far within the outline they lie then, in the mean over simulated pictures.
_OUTERMOST_FROM, _NOT_MUCH_WEAKER, _INSET_PX = 3, 0.1, 0.3
#: Edges of so many codes to a pixel (of all channels together) tell as much as stronger ones; those
#: of less than the share of it, nothing.
_CLEAR, _WEAK = 8.0, 0.5
#: An outline of which less is seen is none.
LEAST_SUPPORT = 0.45
#: Residuals count less from so many times their typical size on (Tukey's biweight).
_TUKEY = 4.0
#: Edges of neighbouring angles err alike: so many of them count as one.
_ALIKE = 6.0
#: An outline is never better known: blur, what a mirror's rim shows. So much, and so much over the
#: radius in pixels: around a small one, other edges are near.
_LEAST_SIGMA_PX, _SIGMA_PX2 = 0.2, 16.0
#: The guess is made in a picture of this width at most.
_GUESS_WIDTH_PX = 480
_MOST_GUESSES, _CIRCLES_A_SIZE = 8, 120
#: There, edges count from this slope (Sobel's) on, that run along the circle by this cosine.
_GUESS_ANGLES, _GUESS_EDGE, _ALIGNED = 96, 24.0, 0.93
_SMALLEST_PX = 10.0
#: Circles beside one, in steps.
_NEAR = np.stack(np.meshgrid(*3 * [np.arange(-2, 3)], indexing="ij"), axis=-1).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Outline:
    """A cone of rays that touch a ball."""

    axis: Array  # (3,) unit, camera frame: towards the ball's centre
    half_angle_rad: float
    sigma_px: float  # 1 sigma of centre, each way, and radius
    support: float  # share of the angles around it where an edge is
    strength: float  # of these edges, relative to the picture's contrast
    radius_px: float

    @property
    def ratio(self) -> float:
        """Radius of the ball over its distance."""
        return float(np.sin(self.half_angle_rad))

    def places(self, pinhole: Pinhole, count: int = _ANGLES) -> Array:
        """Places (count, 2) around the outline in the picture."""
        return pinhole.places(_cone(self.axis, self.half_angle_rad, count))


def guesses(grey: NDArray[np.uint8]) -> list[tuple[float, float, float]]:
    """Circles (x, y, radius in px) that may be a ball, the likeliest first."""
    shrink = max(1.0, grey.shape[1] / _GUESS_WIDTH_PX)
    small = np.asarray(
        cv2.resize(grey, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA)
    )
    small = np.asarray(cv2.GaussianBlur(small, (3, 3), 0.8), np.uint8)
    found: list[tuple[float, ...]] = []
    radius, largest = max(4.0, _SMALLEST_PX / shrink), 0.5 * min(small.shape)
    while radius < largest:
        circles = cv2.HoughCircles(
            small, cv2.HOUGH_GRADIENT, dp=1, minDist=4, param1=80, param2=9 + radius / 8,
            minRadius=int(radius), maxRadius=int(min(1.6 * radius, largest)) + 1,
        )  # fmt: skip
        rows = np.empty(0) if circles is None else np.asarray(circles, np.float64)
        rows = rows.reshape(-1, 3)
        found += [tuple(row) for row in rows[:_CIRCLES_A_SIZE]]
        radius *= 1.5
    if not found:
        return []
    return [
        (float(x * shrink), float(y * shrink), float(r * shrink))
        for x, y, r in _climbed(_slopes(np.asarray(small, np.uint8)), np.asarray(found, np.float64))
    ]


def _climbed(slopes: Array, circles: Array) -> Array:
    """The roundest of circles (N, 3), each moved to where it is roundest."""
    circles = _apart(circles[np.argsort(-_roundness(slopes, circles), kind="stable")])
    for step in (2.0, 1.0, 1.0, 0.5):
        around = circles[:, None] + step * _NEAR
        best = _roundness(slopes, around.reshape(-1, 3)).reshape(around.shape[:2])
        # of equals, the one that has moved least
        chosen = np.asarray(best - 1e-3 * np.linalg.norm(_NEAR, axis=-1)).argmax(axis=1)
        circles = around[np.arange(len(circles)), chosen]
        circles = circles[circles[:, 2] >= 4]
    return _apart(circles[np.argsort(-_roundness(slopes, circles), kind="stable")])


def _apart(circles: Array) -> Array:
    """The first of circles (N, 3) that are not about the same as one before."""
    kept: list[Array] = []
    for circle in circles.astype(np.float64):
        if all(np.abs(circle - other).max() > 0.1 * circle[2] for other in kept):
            kept.append(circle)
    return np.array(kept[:_MOST_GUESSES]).reshape(-1, 3)


def _slopes(small: NDArray[np.uint8]) -> Array:
    """Slope to the right and downwards (H, W, 2)."""
    picture = small.astype(np.float32)
    slopes = [cv2.Sobel(picture, cv2.CV_32F, 1 - k, k, ksize=3) for k in range(2)]
    return np.stack(slopes, axis=-1)


def _roundness(slopes: Array, circles: Array) -> Array:
    """Share (N,) of each circle's angles where an edge runs along it, by gradients."""
    height, width = slopes.shape[:2]
    turn = 2 * np.pi * np.arange(_GUESS_ANGLES) / _GUESS_ANGLES
    outwards = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    at = np.zeros((len(circles), _GUESS_ANGLES), bool)
    for offset in (-0.7, 0.0, 0.7):
        places = circles[:, None, :2] + (circles[:, 2, None] + offset)[..., None] * outwards
        column, row = np.moveaxis(np.round(places).astype(int), -1, 0)
        inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        slope = slopes[np.where(inside, row, 0), np.where(inside, column, 0)]
        length = np.hypot(slope[..., 0], slope[..., 1])
        along = np.abs((slope * outwards).sum(axis=-1))
        at |= inside & (length > _GUESS_EDGE) & (along > _ALIGNED * length)
    return np.asarray(at.mean(axis=1))


def refine(
    picture: NDArray[np.float32],
    pinhole: Pinhole,
    guess: tuple[float, float, float],
    is_mirror: bool = True,
) -> Outline | None:
    """Fit the cone to the edges around a guess (x, y, radius in px); None: there is no outline.

    `picture`: (H, W, C), values that the eye would compare, like codes. The outermost fraction of a
    pixel of a mirror ball shows what is behind it, and so looks like the background: edges of a
    mirror are taken from outside, and belong `_INSET_PX` further out.
    """
    x, y, radius = guess
    centre, beside = pinhole.rays(np.array([[x, y], [x + radius, y]]))
    axis, angle = centre, float(np.arccos(np.clip(centre @ beside, -1, 1)))
    outline = None
    widths = [min(half_px, max(_THEN_SHARE * radius, 0.8)) for half_px in _THEN_PX]
    for step, half_px in enumerate((max(_FIRST_SHARE * radius, 3.0), *widths)):
        outermost = is_mirror and step >= _OUTERMOST_FROM
        edges = _edges(picture, pinhole, axis, angle, half_px, outermost)
        if edges is None:
            return None
        fitted = _fit(pinhole, axis, angle, *edges)
        if fitted is None:
            return None
        axis, angle, outline = fitted.axis, fitted.half_angle_rad, fitted
    if outline is None or not is_mirror:
        return outline
    inset_rad = _INSET_PX / _px_per_rad(pinhole, axis)
    radius_px = outline.radius_px + _INSET_PX
    return replace(outline, half_angle_rad=angle + inset_rad, radius_px=radius_px)


def _cone(axis: Array, half_angle_rad: float, count: int) -> Array:
    """Rays (count, 3) of the cone."""
    aside = cross(axis, np.array([0.0, 1, 0]))
    aside /= np.linalg.norm(aside)
    above = cross(aside, axis)
    turn = 2 * np.pi * (np.arange(count) + 0.5) / count
    around = np.cos(turn)[:, None] * aside + np.sin(turn)[:, None] * above
    return np.asarray(np.cos(half_angle_rad) * axis + np.sin(half_angle_rad) * around)


def _edges(
    picture: NDArray[np.float32],
    pinhole: Pinhole,
    axis: Array,
    angle: float,
    half_px: float,
    outermost: bool,
) -> tuple[Array, Array] | None:
    """Places (N, 2) of the strongest edge across the outline at each angle, and strengths (N,).

    Or of the outermost that is not much weaker.
    """
    places = pinhole.places(_cone(axis, angle, _ANGLES))
    middle = places.mean(axis=0)
    outwards = places - middle
    radius_px = float(np.linalg.norm(outwards, axis=1).mean())
    if not np.isfinite(radius_px) or radius_px < _SMALLEST_PX / 2:
        return None
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    steps = np.arange(-half_px - 2 * _STEP_PX, half_px + 2.5 * _STEP_PX, _STEP_PX)
    at = places[:, None] + steps[None, :, None] * outwards[:, None]
    inside = np.all((at > 1) & (at < np.array(picture.shape[1::-1]) - 1), axis=(1, 2))
    x, y = (at[..., axis_] - 0.5 for axis_ in (0, 1))
    values = cv2.remap(
        picture, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    values = values.reshape(_ANGLES, len(steps), -1)
    width = 4  # steps: a central difference over two pixels
    slope = np.zeros((_ANGLES, len(steps)))
    rise = (values[:, width:] - values[:, :-width]).astype(np.float64)
    slope[:, width // 2 : -(width // 2)] = np.sqrt((rise**2).sum(axis=-1))
    slope[~inside] = 0
    inner = slope[:, 2:-2]
    if outermost:
        peak = (slope[:, 2:-2] >= slope[:, 1:-3]) & (slope[:, 2:-2] >= slope[:, 3:-1])
        strongest = inner.max(axis=1, keepdims=True)
        peak &= inner >= np.maximum(_NOT_MUCH_WEAKER * strongest, _CLEAR)
        inner = np.where(peak, np.arange(inner.shape[1]), -1)
    best = inner.argmax(axis=1) + 2
    rows = np.arange(_ANGLES)
    low, top, high = slope[rows, best - 1], slope[rows, best], slope[rows, best + 1]
    bend = low - 2 * top + high
    shift = np.where(bend < 0, 0.5 * (low - high) / np.where(bend < 0, bend, 1), 0)
    offset = steps[best] + np.clip(shift, -1, 1) * _STEP_PX
    return places + offset[:, None] * outwards, top


def _fit(
    pinhole: Pinhole, axis: Array, angle: float, places: Array, strengths: Array
) -> Outline | None:
    """Fit axis and half angle by weighted least squares, Gauss and Newton's method."""
    weight = np.clip(strengths / _CLEAR, 0, 1)
    weight[weight < _WEAK] = 0
    if np.count_nonzero(weight) < 12:
        return None
    rays = pinhole.rays(places)
    per_rad = _px_per_rad(pinhole, axis)
    scale_px, count = 1.0, 0.0
    residual = np.zeros(len(rays))
    for _ in range(12):
        aside = cross(axis, np.array([0.0, 1, 0]))
        aside /= np.linalg.norm(aside)
        above = cross(aside, axis)
        off = np.arccos(np.clip(rays @ axis, -1, 1))
        residual = (off - angle) * per_rad
        size = np.median(np.abs(residual[weight > 0])) * 1.4826
        scale_px = max(float(size), 0.05)
        robust = weight * np.maximum(1 - (residual / (_TUKEY * scale_px)) ** 2, 0) ** 2
        count = float(robust.sum() ** 2 / max(np.sum(robust**2), 1e-12))
        if count < 8:
            return None
        sine = np.maximum(np.sin(off), 1e-9)
        jacobian = np.stack(
            [-(rays @ aside) / sine, -(rays @ above) / sine, -np.ones(len(rays))], axis=1
        )
        normal = (jacobian * robust[:, None]).T @ jacobian + 1e-9 * np.eye(3)
        step = np.linalg.solve(normal, -(jacobian * robust[:, None]).T @ (residual / per_rad))
        axis = axis + step[0] * aside + step[1] * above
        axis = np.asarray(axis / np.linalg.norm(axis))
        angle += float(step[2])
        if np.abs(step).max() * per_rad < 1e-4:
            break
    if not 0 < angle < 1.2:
        return None
    near = (weight > 0) & (np.abs(residual) < max(2.5 * scale_px, 0.75)) & (np.abs(residual) < 1.5)
    sigma_px = float(np.sqrt(np.sum(near * residual**2) / max(near.sum(), 1)))
    sigma_px *= np.sqrt(2 * _ALIKE / max(float(near.sum()), 1))
    radius_px = angle * per_rad
    sigma_px = float(np.hypot(sigma_px, np.hypot(_LEAST_SIGMA_PX, _SIGMA_PX2 / radius_px)))
    strength = float(strengths[near].mean()) if near.any() else 0.0
    return Outline(axis, angle, sigma_px, float(near.mean()), strength, radius_px)


def _px_per_rad(pinhole: Pinhole, axis: Array) -> float:
    """Pixels to a radian across the line of sight, as along the outline's short axis."""
    return float(np.sqrt(pinhole.fx_px * pinhole.fy_px) / -axis[2])
