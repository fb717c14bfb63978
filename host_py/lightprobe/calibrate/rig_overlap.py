"""How cameras in one box are turned against each other, by what two of them see at once.

Pictures of a box that stands still are turned until they agree where lenses overlap: Gauss–Newton
on the difference of log radiance with Cauchy's weights, from coarse to fine. Brightness that
changes slowly over the picture (roll-off, responses) is left out, so that edges count. Two lenses
see near things from two places; such places contradict the others, and what this does to the
result is part of its sigma: a jackknife over parts of the sphere. Noise and coarse pixels do the
same to all parts; they show by what the coarser and the finer blur tell differently.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.geometry import Array
from lightprobe.imaging.camera import Camera, Lens

Plane = NDArray[np.float32]
#: Exposure in any unit, and RGB codes (H, W, 3).
Shot = tuple[float, NDArray[np.uint8]]

#: Codes of a usable pixel: neither dark nor near saturation.
_DARKEST, _BRIGHTEST = 8, 240
#: Blurs, coarse to fine, 1 sigma. What is smoother than so many times the blur is left out.
_BLURS_DEG, _SMOOTH = (0.7, 0.35), 2.0
#: Share of the smoother blur's kernel that must be known.
_KNOWN = 0.97
_MOST_STEPS, _SMALL_STEP_DEG = 25, 3e-3
#: For slopes, of the blur; and the farthest step, of the blur.
_SLOPE_STEP, _LONGEST_STEP = 0.3, 2.0
#: Of the median absolute difference; of the steepest places, as flat ones always agree.
_CAUCHY, _EDGES = 2.4 / 0.6745, 0.2
_MOST_POINTS = 12_000
#: 1 sigma about each axis that no comparison shows, of a pixel.
_PIXEL_SHARE = 0.25
#: Overlaps of fewer places tell nothing. The jackknife leaves out one part at a time.
LEAST_POINTS, _LEAST_PARTS = 500, 4


@dataclass(frozen=True, eq=False)
class Edges:
    """Log radiance of a lens between two blurs (H, W), and where it is known."""

    values: Plane
    known: NDArray[np.bool_]
    own: Plane  # values (N,) where they are known
    directions: Array  # (N, 3) in the camera's frame

    @classmethod
    def of(cls, view: View, blur_deg: float) -> Edges:
        """Blur what a lens sees; what is smoother than `_SMOOTH` times the blur is left out."""
        blur_px = blur_deg * np.radians(view.lens.focal_px[0])
        known = view.known.astype(np.float32)
        fine, _ = _blurred(view.log_radiance, known, blur_px)
        smooth, seen = _blurred(view.log_radiance, known, _SMOOTH * blur_px)
        values, sure = fine - smooth, view.known & (seen > _KNOWN)
        y, x = np.nonzero(sure)
        at_x, at_y = (place.astype(np.float64) + 0.5 for place in (x, y))
        directions, _ = view.lens.look(at_x, at_y)
        return cls(values, sure, values[y, x], directions)


@dataclass(frozen=True, eq=False)
class View:
    """What one lens of a camera sees: log radiance (H, W), and where it is known."""

    camera: int
    lens: Lens  # for pictures of this size
    log_radiance: Plane
    known: NDArray[np.bool_]

    @cached_property
    def edges(self) -> dict[float, Edges]:
        """Edges at each of the blurs, in degrees."""
        return {blur_deg: Edges.of(self, blur_deg) for blur_deg in _BLURS_DEG}


@dataclass(frozen=True, eq=False)
class Overlap:
    """Rotations (camera's frame to that of the first) by overlaps."""

    rotations: tuple[Rotation, ...]  # of every camera; the first is the identity
    covariance: Array  # (3 (n − 1), 3 (n − 1)): turns of the others in degrees, box frame
    points: dict[tuple[int, int], int]  # of each pair of cameras


def views(number: int, camera: Camera, shots: Sequence[Shot]) -> list[View]:
    """Views of a camera's lenses, from pictures of a still scene at one exposure or several."""
    table = camera.response_table()
    height, width = shots[0][1].shape[:2]
    total, weight = np.zeros((height, width)), np.zeros((height, width))
    for exposure, codes in shots:
        linear = np.stack([table[codes[..., c], c] for c in range(3)], axis=-1)
        usable = (codes.max(axis=-1) < _BRIGHTEST) & (codes.max(axis=-1) > _DARKEST)
        total += usable * luminance(linear)
        weight += usable * exposure
    _, illumination = camera.look(width, height)
    owner = camera.owner(width, height)
    known = (weight > 0) & (total > 0) & (illumination > 0)
    radiance = np.where(known, total, 1) / np.where(known, weight * illumination, 1)
    log_radiance = np.log(radiance).astype(np.float32)
    scale = width / camera.width_px, height / camera.height_px
    return [
        View(number, lens.scaled(*scale), log_radiance, known & (owner == k))
        for k, lens in enumerate(camera.lenses)
    ]


def align(seen: Sequence[View], start: Sequence[Rotation]) -> Overlap:
    """Turn the cameras from `start` (camera to first camera) on until their pictures agree."""
    rotations = list(start)
    pairs = [(a, b) for a, b in combinations(seen, 2) if a.camera != b.camera]
    by_blur = []
    for blur_deg in _BLURS_DEG:
        for _ in range(_MOST_STEPS):
            system = _System.of(pairs, rotations, blur_deg)
            step = system.step()
            longest = np.abs(step).max(initial=0.0)
            step *= min(1.0, _LONGEST_STEP * blur_deg / max(longest, 1e-9))
            for k in range(1, len(rotations)):
                turn = Rotation.from_rotvec(step[3 * k - 3 : 3 * k], degrees=True)
                rotations[k] = turn * rotations[k]
            if longest < _SMALL_STEP_DEG:
                break
        by_blur.append(list(rotations))
    apart = np.concatenate(
        [(a * b.inv()).as_rotvec(degrees=True) for a, b in zip(*by_blur, strict=True)][1:]
    )
    pixel_deg = max(float(np.degrees(1 / view.lens.focal_px[0])) for view in seen)
    coarse = np.outer(apart, apart) + (_PIXEL_SHARE * pixel_deg) ** 2 * np.eye(len(apart))
    return Overlap(tuple(rotations), system.covariance() + coarse, system.points)


class _System:
    """Normal equations of small turns of all cameras but the first, by parts of the sphere."""

    def __init__(self, cameras: int) -> None:
        size = 3 * (cameras - 1)
        self.matrices = np.zeros((len(_PARTS), size, size))
        self.vectors = np.zeros((len(_PARTS), size))
        self.points: dict[tuple[int, int], int] = {}

    @classmethod
    def of(
        cls,
        pairs: Sequence[tuple[View, View]],
        rotations: Sequence[Rotation],
        blur_deg: float,
    ) -> _System:
        system = cls(len(rotations))
        for one, other in pairs:
            system.add(one, other, rotations, blur_deg)
        return system

    def add(self, one: View, other: View, rotations: Sequence[Rotation], blur_deg: float) -> None:
        """Compare what `other` sees with `one` in the same directions."""
        reference, edges = one.edges[blur_deg], other.edges[blur_deg]
        back = rotations[one.camera].inv()
        turn = (back * rotations[other.camera]).as_matrix()
        common = np.flatnonzero(one.lens.sees(edges.directions @ turn.T))
        if len(common) > _MOST_POINTS:
            common = common[np.linspace(0, len(common) - 1, _MOST_POINTS).astype(int)]
        in_box = rotations[other.camera].apply(edges.directions[common])
        pair = one.camera, other.camera
        if len(in_box) < LEAST_POINTS:
            return
        step_deg = _SLOPE_STEP * blur_deg
        samples = [_sample(one.lens, reference, back.apply(in_box))]
        for axis in np.eye(3):
            for sign in (1, -1):
                turn = Rotation.from_rotvec(sign * step_deg * axis, degrees=True)
                samples.append(_sample(one.lens, reference, back.apply(turn.apply(in_box))))
        values = np.stack(samples)
        usable = np.isfinite(values).all(axis=0)
        values, in_box = values[:, usable], in_box[usable]
        self.points[pair] = self.points.get(pair, 0) + len(in_box)
        if len(in_box) < LEAST_POINTS:
            return
        residuals = values[0] - edges.own[common[usable]]
        residuals -= np.median(residuals)
        slopes = (values[1::2] - values[2::2]).T / (2 * step_deg)
        steepness = np.linalg.norm(slopes, axis=1)
        steep = steepness >= np.quantile(steepness, 1 - _EDGES)
        scale = max(_CAUCHY * float(np.median(np.abs(residuals[steep]))), 1e-4)
        weights = 1 / (1 + (residuals / scale) ** 2)
        self._sum(pair, in_box, residuals, slopes, weights)

    def _sum(
        self, pair: tuple[int, int], in_box: Array, residuals: Array, slopes: Array, weights: Array
    ) -> None:
        wide = np.zeros((len(residuals), self.vectors.shape[1]))
        for camera, sign in zip(pair, (-1, 1), strict=True):
            if camera:
                wide[:, 3 * camera - 3 : 3 * camera] = sign * slopes
        part = np.argmax(in_box @ _PARTS.T, axis=1)
        for k in np.unique(part):
            rows, w = wide[part == k], weights[part == k]
            self.matrices[k] += (w[:, None] * rows).T @ rows
            self.vectors[k] -= rows.T @ (w * residuals[part == k])

    def step(self) -> Array:
        """Turns in degrees that bring the residuals near zero."""
        return _solution(self.matrices.sum(axis=0), self.vectors.sum(axis=0))

    def covariance(self) -> Array:
        """Spread of the solutions without one part of the sphere each (jackknife)."""
        used = [k for k in range(len(_PARTS)) if self.matrices[k].any()]
        size = self.vectors.shape[1]
        if len(used) < _LEAST_PARTS:
            return np.diag(np.full(size, np.inf))
        matrix, vector = self.matrices.sum(axis=0), self.vectors.sum(axis=0)
        found = np.stack(
            [_solution(matrix - self.matrices[k], vector - self.vectors[k]) for k in used]
        )
        spread = found - found.mean(axis=0)
        return np.asarray((len(used) - 1) / len(used) * spread.T @ spread)


#: Parts of the sphere for the jackknife.
_PARTS = geometry.sphere_normals(1)


def _solution(matrix: Array, vector: Array) -> Array:
    """Solve; what nothing is known of stays as it is."""
    return np.asarray(np.linalg.pinv(matrix, rcond=1e-9, hermitian=True) @ vector)


def _blurred(values: Plane, known: Plane, blur_px: float) -> tuple[Plane, Plane]:
    """Blur of what is known, and the share of the kernel that was."""
    seen = cv2.GaussianBlur(known, (0, 0), blur_px)
    total = cv2.GaussianBlur(values * known, (0, 0), blur_px)
    return np.asarray(total / np.maximum(seen, 1e-3), np.float32), np.asarray(seen, np.float32)


def _sample(lens: Lens, edges: Edges, directions: Array) -> Array:
    """Values (N,) of a lens' edges at directions (N, 3); NaN where they are not known."""
    x, y = (place.astype(np.float32) - np.float32(0.5) for place in lens.place(directions))
    seen = cv2.remap(edges.known.astype(np.float32), x[None], y[None], cv2.INTER_LINEAR)[0]
    found = cv2.remap(edges.values, x[None], y[None], cv2.INTER_LINEAR)[0]
    return np.where((seen > 0.99) & lens.sees(directions), found, np.nan)
