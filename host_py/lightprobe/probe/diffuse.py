"""The light on a white ball: radiance that is nowhere negative, and what is not known of it.

Each pixel of a matt ball shows the irradiance of its normal. That is a sum over directions of light
that is not negative, so the sum is solved for by non-negative least squares (Lawson and Hanson
1974). Light from behind the ball reaches only its rim, and what is straight behind reaches nothing
that the camera sees: there a weak prior decides, an even share, and the sigma says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from lightprobe.colour import srgb_table
from lightprobe.geometry import Array, equirect_directions, sphere_normals
from lightprobe.imaging import image
from lightprobe.imaging.ball import Pinhole
from lightprobe.probe.find import Sight
from lightprobe.probe.kinds import ProbeError

#: Of white plastic, and of paint: what share of the light it reflects, and how well that is known.
ALBEDO, ALBEDO_SIGMA = 0.85, 0.1
#: Directions that light may come from, 8° apart.
_DIRECTIONS = 640
#: Normals that the pixels are averaged over, about.
_BINS = 900
#: The outermost pixels hold what is behind the ball, too.
_RIM_PX = 1.5
#: Noise of a bin, relative to the brightest: texture, response, light that the board reflects.
_NOISE = 0.004
#: 1 sigma of the flux of a direction around an even share, in such shares, where nothing tells.
_PRIOR = 20.0
#: How much the even share counts as a whole.
_EVEN = 0.05
_MOST_CLIPPED = 0.02
_FULL = 255


@dataclass(frozen=True, eq=False)
class Shading:
    """What the ball shows: irradiance by normal."""

    normals: Array  # (N, 3) unit, probe frame
    irradiance: Array  # (N, 3)
    weight: Array  # (N,) pixels
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Light:
    """Flux by direction, and how well the irradiance is known that it makes."""

    directions: Array  # (D, 3)
    flux: Array  # (D, 3) irradiance of each direction on a surface that faces it
    relighting_sigma: float  # of irradiance, mean over all normals, relative to its mean
    covariance: Array  # (D, D) of the flux of one channel whose mean irradiance is 1

    def panorama(self, width: int) -> NDArray[np.float32]:
        """Radiance (width / 2, width, 3): each direction fills what is nearest to it."""
        places = equirect_directions(width, width // 2).reshape(-1, 3)
        nearest = np.argmax(places @ self.directions.T, axis=1)
        rows = np.sin(np.pi * (np.arange(width // 2) + 0.5) / (width // 2))
        cell_sr = np.repeat(rows * (np.pi / (width // 2)) * (2 * np.pi / width), width)
        sr = np.bincount(nearest, cell_sr, minlength=len(self.directions))
        radiance = self.flux / np.maximum(sr, 1e-12)[:, None]
        return np.asarray(radiance[nearest].reshape(width // 2, width, 3), np.float32)

    def direction_sigma_deg(self, direction: Array) -> float:
        """1 sigma of a lamp's direction (3,): by its flux's covariance, and the directions' gap."""
        near = self.directions @ direction > np.cos(np.radians(25))
        flux = self.flux[near].mean(axis=1)
        total = float(flux.sum())
        gap = float(np.degrees(np.sqrt(4 * np.pi / len(self.directions) / 12)))
        if not total > 0:
            return 90.0
        off = self.directions[near] - direction
        scale = float(self.flux.sum(axis=0).mean()) / 4  # mean irradiance
        spread = np.einsum("ia,ij,ja->", off, self.covariance[np.ix_(near, near)], off)
        return float(np.hypot(gap, np.degrees(np.sqrt(max(spread, 0.0)) * scale / total)))


def shading(
    files: Sequence[Path], exposures_us: Sequence[float], sight: Sight, pinhole: Pinhole
) -> Shading:
    """Read irradiance and normals from the pictures; raises ProbeError for an overexposed ball.

    Values: as radiance of the estimate (relative to full scale, at one second with exposures).
    """
    radiance, clipped = merged(files, exposures_us)
    height, width = radiance.shape[:2]
    y, x = np.mgrid[:height, :width] + 0.5
    normals = normals_of(np.stack([x, y], axis=-1).reshape(-1, 2), sight, pinhole)
    seen = np.isfinite(normals[:, 0])
    bad = clipped.reshape(-1)[seen]
    if bad.mean() > _MOST_CLIPPED:
        raise ProbeError(
            f"{100 * bad.mean():.0f} % of the ball is overexposed: a white ball must not clip: "
            "expose less, or add a shorter exposure"
        )
    values = radiance.reshape(-1, 3)[seen][~bad] * np.pi / ALBEDO
    at = normals[seen][~bad]
    return binned(at @ sight.rotation.T, at, values)


def normals_of(places_px: Array, sight: Sight, pinhole: Pinhole) -> Array:
    """Normals (N, 3), camera frame, of the ball at places (N, 2); NaN beside it and at its rim."""
    outline = sight.outline
    rays = pinhole.rays(places_px)
    alpha = np.arccos(np.clip(rays @ outline.axis, -1, 1))
    used = alpha < outline.half_angle_rad * (1 - _RIM_PX / outline.radius_px)
    incidence = np.arcsin(np.where(used, np.sin(alpha) / outline.ratio, np.nan))
    across = rays - (rays @ outline.axis)[:, None] * outline.axis
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-15)
    psi = (incidence - alpha)[:, None]
    return np.asarray(-np.cos(psi) * outline.axis + np.sin(psi) * across)


def merged(files: Sequence[Path], exposures_us: Sequence[float]) -> tuple[Array, NDArray[np.bool_]]:
    """Radiance (H, W, 3) of a bracket, each pixel of its longest exposure, and where all clip."""
    order = np.argsort(exposures_us)[::-1] if len(exposures_us) else range(len(files))
    table = srgb_table()
    found: Array | None = None
    clipped: NDArray[np.bool_] | None = None
    for index in order:
        if files[index].suffix.lower() in image.HDR_SUFFIXES:
            radiance = np.asarray(image.read(files[index]).radiance, np.float64)
            # An infinite one has clipped.
            unknown = np.asarray(~np.isfinite(radiance).all(axis=-1), bool)
            return np.where(unknown[..., None], 0.0, radiance), unknown
        codes = image.read_srgb8(files[index])
        scale = 1e6 / exposures_us[index] if len(exposures_us) else 1.0
        light, top = table[codes] * scale, codes.max(axis=-1) >= _FULL
        if found is None or clipped is None:
            found, clipped = light, top
        else:
            found = np.where(clipped[..., None], light, found)
            clipped = clipped & top
    if found is None or clipped is None:
        raise ProbeError("no pictures: name at least one")
    return found, clipped


def binned(normals: Array, in_camera: Array, values: Array) -> Shading:
    """Means over bins of like normals: equal parts of the ball's picture."""
    side = int(np.sqrt(_BINS * 4 / np.pi))
    column, row = (
        np.clip(((in_camera[:, axis] + 1) / 2 * side).astype(int), 0, side - 1) for axis in (0, 1)
    )
    bins, index = np.unique(row * side + column, return_inverse=True)
    count = np.bincount(index, minlength=len(bins)).astype(float)

    def means(of: Array) -> Array:
        sums = [np.bincount(index, of[:, k], minlength=len(bins)) for k in range(3)]
        return np.asarray(np.stack(sums, axis=1) / count[:, None])

    mean = means(normals)
    return Shading(mean / np.linalg.norm(mean, axis=1, keepdims=True), means(values), count)


def directions() -> Array:
    """Directions (D, 3) evenly over the sphere (Fibonacci's lattice)."""
    i = np.arange(_DIRECTIONS) + 0.5
    y = 1 - 2 * i / _DIRECTIONS
    turn, ring = i * np.pi * (3 - np.sqrt(5)), np.sqrt(1 - y * y)
    return np.stack([ring * np.cos(turn), y, ring * np.sin(turn)], axis=1)


def solve(shaded: Shading) -> Light:
    """Find the light that makes this shading."""
    towards = directions()
    kernel = np.maximum(shaded.normals @ towards.T, 0)
    mean = shaded.irradiance.mean(axis=0)
    if not np.all(mean > 0):
        raise ProbeError("the ball is black: expose more, or name the right place with --ball-at")
    full = np.maximum(np.sqrt(shaded.weight / shaded.weight.max()), 0.3)
    noise = _NOISE * float(shaded.irradiance.max() / mean.max()) * np.sqrt(len(full) / 50)
    share = 4 / len(towards)  # of even light whose irradiance is 1
    rows = np.concatenate([
        kernel * (full / noise)[:, None],
        np.eye(len(towards)) / (_PRIOR * share),
        np.full((1, len(towards)), 1 / (_EVEN * 4 * np.sqrt(len(towards)))),
    ])  # fmt: skip
    flux = np.empty((len(towards), 3))
    for c in range(3):
        wanted = np.concatenate([
            shaded.irradiance[:, c] / mean[c] * full / noise,
            np.full(len(towards), share / (_PRIOR * share)),
            [4 / (_EVEN * 4 * np.sqrt(len(towards)))],
        ])  # fmt: skip
        gram = rows.T @ rows
        root = np.linalg.cholesky(gram + 1e-9 * np.trace(gram) / len(gram) * np.eye(len(gram)))
        flux[:, c] = nnls(root.T, np.linalg.solve(root, rows.T @ wanted))[0] * mean[c]
    covariance = np.asarray(np.linalg.inv(rows.T @ rows))
    kernel_all = np.maximum(sphere_normals(3) @ towards.T, 0)
    variance = np.einsum("ni,ij,nj->n", kernel_all, covariance, kernel_all)
    level = float((kernel_all @ flux.mean(axis=1)).mean() / mean.mean())
    sigma = float(np.sqrt(variance.mean())) / max(level, 1e-9)
    return Light(towards, flux, sigma, covariance)
