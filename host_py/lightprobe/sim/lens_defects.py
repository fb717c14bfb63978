"""What a real lens does to light before it reaches the sensor: `simulate --lens-defects`.

In the order of the light's way: dirt and drops on the glass, the point spread and its colours,
ghosts, veiling glare. All are of radiance without a limit, so a sun that clips still casts the veil
of all its light.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.geometry import Array, equirect_solid_angles
from lightprobe.imaging.camera import Camera
from lightprobe.sim.faults import Spell, fault

Radiance = NDArray[np.float32]

#: Cells across the picture in which wide spreading is calculated: 5.6 degrees of a panorama.
_CELLS = 64
#: Steps, at most, until each cell gives what it takes, relative.
_BALANCING, _BALANCED = 40, 1e-4
#: Each of two lenses sees so far beyond its half of the sphere.
_OVERLAP_DEG = 5.0
#: Shares of red, green and blue light in a fringe, against blue: what is out of focus most.
_FRINGE = (0.5, 0.0, 1.0)
_PURPOSE_DIRT, _PURPOSE_DROPS = 101, 102  # of random numbers
#: Share of a drop's radius in which it begins.
_DROP_RIM = 0.2


@dataclass(frozen=True)
class LensDefects(Spell):
    """Options of `simulate --lens-defects`; by default the lens is perfect."""

    _what: ClassVar[str] = "lens defects"

    glare: float = fault(
        0.0,
        "share of all light that is spread over the picture of its lens: half of it evenly, "
        "half around where it comes from",
        0, 0.5,
    )  # fmt: skip
    glare_deg: float = fault(10.0, "width w of that half: (1 + (angle/w)²)^-1.5", 1, 90)
    ghost: float = fault(
        0.0, "share of light that is seen again, mirrored through the middle of its lens", 0, 0.5
    )
    ghost_deg: float = fault(1.5, "blur of that, 1 sigma", 0.1, 20)
    point_spread_deg: float = fault(0.0, "the lens' blur, a Gaussian, 1 sigma", 0, 20)
    fringe: float = fault(
        0.0, "share of blue light, and half as much of red, spread around: purple fringes", 0, 0.5
    )
    fringe_deg: float = fault(1.0, "blur of that, 1 sigma", 0.1, 20)
    dirt: float = fault(0.0, "share of light lost in the middle of each spot of dirt", 0, 1)
    dirt_spots: int = fault(8, "spots, where the seed says", 1, 200)
    dirt_deg: float = fault(4.0, "size of each, 1 sigma", 0.1, 60)
    drops: int = fault(0, "drops of water, where the seed says: each shows a blur of all", 0, 200)
    drops_deg: float = fault(5.0, "radius of each", 0.1, 60)
    from_s: float = fault(0.0, "seconds until all this begins")
    to_s: float = fault(0.0, "seconds until it ends; 0: never")

    @property
    def is_perfect(self) -> bool:
        """Tell whether there is no defect at any time."""
        parts = (self.glare, self.ghost, self.point_spread_deg, self.fringe, self.dirt, self.drops)
        return not any(parts)


class DefectiveLens:
    """Applies defects to the picture of one camera."""

    def __init__(
        self, defects: LensDefects, lens: Camera, size_px: tuple[int, int], seed: int = 0
    ) -> None:
        """`size_px` (width, height) of its pictures."""
        self.defects = defects
        self._lens, self._size_px = lens, size_px
        directions, illumination = lens.look(*size_px)
        self._seen = (illumination > 0).astype(np.float32)[..., None]
        directions = np.nan_to_num(directions)
        weight = self._seen
        if lens.is_equirect:
            by_row = equirect_solid_angles(*size_px).astype(np.float32)
            weight = weight * (by_row / by_row.max())[:, None, None]
        self._transmission: Radiance | None = None
        if defects.dirt:
            spots = _directions(seed, _PURPOSE_DIRT, defects.dirt_spots)
            left = [
                1
                - defects.dirt
                * np.exp(-0.5 * (_angle_deg(directions, one) / defects.dirt_deg) ** 2)
                for one in spots
            ]
            self._transmission = np.prod(left, axis=0).astype(np.float32)[..., None]
        self._drops: Radiance | None = None
        if defects.drops:
            spots = _directions(seed, _PURPOSE_DROPS, defects.drops)
            depth = [1 - _angle_deg(directions, one) / defects.drops_deg for one in spots]
            covered = np.clip(np.max(depth, axis=0) / _DROP_RIM, 0, 1)
            self._drops = covered.astype(np.float32)[..., None]
        self._veil: _Veil | None = None
        if defects.glare or defects.drops:
            shares = _shares(lens, directions)
            self._veil = _Veil(directions, weight, shares, lens.is_whole, defects.glare_deg)

    def through(self, radiance: Radiance) -> Radiance:
        """What (H, W, 3) reaches the sensor of what would through a perfect lens."""
        d = self.defects
        if self._transmission is not None:
            radiance = radiance * self._transmission
        if self._drops is not None and self._veil is not None:
            blurred = self._seen * self._veil.of(radiance)
            radiance = radiance + self._drops * (blurred - radiance)
        if d.point_spread_deg:
            radiance = self._blurred(radiance, d.point_spread_deg)
        if d.fringe:
            share = np.float32(d.fringe) * np.array(_FRINGE, np.float32)
            radiance = radiance + share * (self._blurred(radiance, d.fringe_deg) - radiance)
        if d.ghost:
            ghost = self._blurred(self._mirrored(radiance), d.ghost_deg)
            radiance = radiance + np.float32(d.ghost) * (ghost - radiance)
        if d.glare and self._veil is not None:
            radiance = radiance + np.float32(d.glare) * (self._veil.of(radiance) - radiance)
        return np.asarray(radiance, dtype=np.float32)

    def _mirrored(self, radiance: Radiance) -> Radiance:
        """Show each direction of a lens on the other side of the lens' axis, as far off it."""
        if self._lens.is_equirect:  # both axes are level: ahead and behind
            return np.ascontiguousarray(radiance[::-1, ::-1])
        (width, height), lens = self._size_px, self._lens
        owner = lens.owner(width, height)
        x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
        scale = width / lens.width_px, height / lens.height_px
        centres = np.array([one.centre_px for one in lens.lenses], np.float32) * scale
        twice = (2 * centres - 1).astype(np.float32)[owner]  # the first pixel's centre is at 0.5
        mirrored = cv2.remap(radiance, twice[..., 0] - x, twice[..., 1] - y, cv2.INTER_LINEAR)
        return np.asarray(mirrored * self._seen, dtype=np.float32)

    def _blurred(self, radiance: Radiance, sigma_deg: float) -> Radiance:
        """Blur by a Gaussian of so many degrees."""
        width = self._size_px[0]
        if self._lens.is_whole:
            return _blurred_on_sphere(radiance, sigma_deg)
        if self._lens.is_equirect:
            sigma_px = sigma_deg * width / (360 * (self._lens.crop.width if self._lens.crop else 1))
        else:
            focal_px = np.mean([one.focal_px for one in self._lens.lenses])
            sigma_px = float(np.radians(sigma_deg) * focal_px * width / self._lens.width_px)
        return np.asarray(cv2.GaussianBlur(radiance, (0, 0), sigma_px) * self._seen)


class _Veil:
    """Spreads light over cells of a picture; each lens keeps its own, all of it."""

    def __init__(
        self,
        directions: Array,
        weight: Radiance,
        shares: Radiance,
        wraps: bool,
        width_deg: float,
    ) -> None:
        """`weight` (H, W, 1): of each pixel's light in the sum; `shares` (H, W, lenses)."""
        height, width, lenses = shares.shape
        self._size_px, self._weight, self._wraps = (width, height), weight, wraps
        self._cells = _CELLS, max(round(_CELLS * height / width), 1)
        self._cell_weight = self._in_cells(weight)
        n = self._cells[0] * self._cells[1]
        mean = self._in_cells(directions.astype(np.float32) * weight).reshape(n, 3)
        mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9)
        of = self._in_cells(shares).reshape(n, lenses).astype(np.float64)
        w = self._cell_weight.reshape(n).astype(np.float64)
        same = of @ of.T
        angle_deg = np.degrees(np.arccos(np.clip(mean @ mean.T, -1, 1)))
        around = same * (1 + (angle_deg / width_deg) ** 2) ** -1.5
        kernel = 0.5 * _balanced(same, w) + 0.5 * _balanced(around, w)
        self._kernel = (kernel * w).astype(np.float32)

    def of(self, radiance: Radiance) -> Radiance:
        """Light (H, W, 3) when all of it is spread."""
        light = radiance * self._weight
        cells = self._in_cells(light) / np.maximum(self._cell_weight, 1e-9)[..., None]
        spread = np.asarray(self._kernel @ cells.reshape(-1, 3), dtype=np.float32)
        veil = self._of_size(spread.reshape(cells.shape))
        before, after = light.sum(axis=(0, 1)), (veil * self._weight).sum(axis=(0, 1))
        scale = before / np.maximum(after, 1e-30)
        return np.asarray(veil * scale * (self._weight > 0), dtype=np.float32)

    def _in_cells(self, values: Radiance) -> Radiance:
        return np.asarray(cv2.resize(values, self._cells, interpolation=cv2.INTER_AREA))

    def _of_size(self, cells: Radiance) -> Radiance:
        if not self._wraps:
            return np.asarray(cv2.resize(cells, self._size_px, interpolation=cv2.INTER_LINEAR))
        side = _CELLS // 2  # cells beside the seam
        padded = cv2.copyMakeBorder(cells, 0, 0, side, side, cv2.BORDER_WRAP)
        width, height = self._size_px
        whole = cv2.resize(padded, (2 * width, height), interpolation=cv2.INTER_LINEAR)
        return np.asarray(whole[:, width // 2 : width // 2 + width])


def _shares(lens: Camera, directions: Array) -> Radiance:
    """Shares (H, W, lenses) of each lens in the pixels."""
    if not lens.is_equirect:
        owner = lens.owner(directions.shape[1], directions.shape[0])
        return np.eye(len(lens.lenses), dtype=np.float32)[owner]
    # Two lenses, one ahead and one behind, made such pictures; both see what is between them.
    behind_deg = np.degrees(np.arcsin(np.clip(directions[..., 2], -1, 1)))
    behind = np.clip(0.5 + behind_deg / (2 * _OVERLAP_DEG), 0, 1)
    return np.stack([1 - behind, behind], axis=-1).astype(np.float32)


def _balanced(kernel: Array, weight: Array) -> Array:
    """Scale a symmetric kernel (N, N) so that even light stays even, and none is lost.

    With the result K, Σ K[i, j] weight[j] is 1 for all i, and K is symmetric.
    """
    scale = np.ones(len(weight))
    for _ in range(_BALANCING):
        taken = scale * (kernel @ (weight * scale))
        scale = scale / np.sqrt(np.maximum(taken, 1e-30))
        if np.ptp(taken[weight > 0]) < _BALANCED:
            break
    return np.asarray(scale[:, None] * kernel * scale)


def _blurred_on_sphere(radiance: Radiance, sigma_deg: float) -> Radiance:
    """Blur a panorama by a Gaussian; rows near the poles by more columns."""
    height, width, _ = radiance.shape
    weight = equirect_solid_angles(width, height).astype(np.float32)
    sine = np.sin(np.pi * (np.arange(height) + 0.5) / height)
    sigma_rad = np.minimum(np.radians(sigma_deg) / sine, np.pi)  # of longitude, of each row
    order = np.arange(width // 2 + 1)
    gain = np.exp(-0.5 * (sigma_rad[:, None] * order) ** 2)[..., None]
    rows = np.fft.irfft(np.fft.rfft(radiance, axis=1) * gain, n=width, axis=1)
    sigma_px = sigma_deg * height / 180
    side = min(int(np.ceil(4 * sigma_px)) + 1, height)
    light = np.maximum(rows, 0).astype(np.float32) * weight[:, None, None]
    beyond = np.roll(light, width // 2, axis=1)  # over a pole the other half goes on
    padded = np.concatenate([beyond[:side][::-1], light, beyond[-side:][::-1]])
    weights = np.concatenate([weight[:side][::-1], weight, weight[-side:][::-1]])[:, None]
    size = (1, 2 * side + 1)
    blurred = cv2.GaussianBlur(padded, size, 1e-3, sigmaY=sigma_px)
    even = cv2.GaussianBlur(weights, size, 1e-3, sigmaY=sigma_px)
    found = (blurred / even.reshape(-1, 1, 1))[side : side + height]
    # Close to a pole this is no convolution of the sphere: what is missing is even.
    before, after = ((one * weight[:, None, None]).sum(axis=(0, 1)) for one in (radiance, found))
    return np.asarray(found * (before / np.maximum(after, 1e-30)), dtype=np.float32)


def _directions(seed: int, purpose: int, count: int) -> Sequence[Array]:
    """Random ones (3,), all equally likely."""
    found = np.random.default_rng([seed, purpose]).standard_normal((count, 3))
    return list(found / np.linalg.norm(found, axis=1, keepdims=True))


def _angle_deg(directions: Array, one: Array) -> Array:
    """Angles (H, W) of directions (H, W, 3) to one of them."""
    return np.degrees(np.arccos(np.clip(directions @ one, -1, 1)))
