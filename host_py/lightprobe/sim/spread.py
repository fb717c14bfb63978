"""What one pixel sees of a map: not a point of it, but all that its area and the lens' blur reach.

A camera that looked up points of a finer map would step over some pixels of it, and hit others
twice: a small sun would be as bright as it happens to lie between the lookups.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry
from lightprobe.geometry import Array
from lightprobe.imaging.camera import Camera
from lightprobe.imaging.metadata import WHOLE

#: Lens and pixel together spread a point by a Gaussian of so many pixels, 1 sigma. That halves the
#: contrast of 0.29 cycles per pixel, as good lenses do; and of a point's light the sum over all
#: pixels is the same, wherever it lies between them.
SIGMA_PX = 0.65
#: Pixels of the map to one of the camera. With fewer the map's own grid shows in the sums.
FINER = 2.0
#: A map is looked up so far beside each place, along both its axes, and the mean is taken: linear
#: interpolation alone leaves a beat between its grid and the camera's.
LOOKUPS_PX = (-0.25, 0.25)
#: What that blurs by itself: a pixel's own width, linear interpolation, two places.
_LOOKUP_VARIANCE_PX2 = 1 / 12 + 1 / 6 + 1 / 16
#: The kernel ends after so many sigma.
_REACH = 4.0
#: Until the rows' weights no longer change.
_BALANCINGS = 30


def pitch_rad(camera: Camera, size_px: tuple[int, int]) -> float:
    """Angle from one pixel of a picture (width, height) to the next: the mean along a radius.

    Of several lenses that of the coarsest; of a part of a panorama that at the horizon.
    """
    if camera.is_equirect:
        crop = camera.crop or WHOLE
        return 2 * math.pi * crop.width / size_px[0]
    scale = min(size_px[0] / camera.width_px, size_px[1] / camera.height_px)
    pitches = []
    for lens in camera.lenses:
        most = math.radians(lens.max_theta_deg)
        pitches.append(most / (float(lens.radius(most)) * min(lens.focal_px) * scale))
    return max(pitches)


def map_px(camera: Camera, size_px: tuple[int, int]) -> tuple[int, int]:
    """Size (width, height) of the map that a picture of `size_px` is looked up in."""
    height = math.ceil(FINER * math.pi / pitch_rad(camera, size_px))
    return 2 * height, height


def spread(radiance: NDArray[np.float32], pitch: float) -> NDArray[np.float32]:
    """Blur an equirectangular map (H, W, 3) on the sphere, as pixels `pitch` (rad) apart see it.

    What looking it up between its pixels blurs is left out. An even map stays even, and light is
    neither lost nor made: each pixel gives to another, by solid angle, as much as it takes of it.
    """
    row_rad = math.pi / len(radiance)
    variance = (SIGMA_PX * pitch) ** 2 - _LOOKUP_VARIANCE_PX2 * row_rad**2
    if variance <= 0:
        return radiance
    sigma_rad = math.sqrt(variance)
    return _down(_along(radiance, sigma_rad), sigma_rad / row_rad)


def _along(radiance: NDArray[np.float32], sigma_rad: float) -> NDArray[np.float32]:
    """Blur rows, each by as many degrees: near the poles these are many columns."""
    height, width, _ = radiance.shape
    sine = np.sin(np.pi * (np.arange(height) + 0.5) / height)
    waves = np.arange(width // 2 + 1)
    kept = np.exp(-0.5 * (waves * (sigma_rad / sine)[:, None]) ** 2).astype(np.float32)
    turned = np.ascontiguousarray(np.moveaxis(radiance, -1, 0))
    found = np.fft.irfft(np.fft.rfft(turned) * kept, width)
    # A lamp's ripples of single precision are no darkness.
    found = np.maximum(found, 0) if radiance.min() >= 0 else found
    return np.ascontiguousarray(np.moveaxis(found, 0, -1), np.float32)


def _down(radiance: NDArray[np.float32], sigma_px: float) -> NDArray[np.float32]:
    """Blur columns, over the poles; rows count by their solid angles."""
    height, width, _ = radiance.shape
    reach = min(math.ceil(_REACH * sigma_px), height)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_px) ** 2)
    kernel /= kernel.sum()
    solid_angle = geometry.equirect_solid_angles(width, height)
    solid_angle = solid_angle / solid_angle.max()
    balance = _balance(solid_angle, kernel)
    weighted = radiance * (balance * solid_angle)[:, None, None].astype(np.float32)
    over = np.roll(weighted, width // 2, axis=1)  # what lies behind a pole
    padded = np.concatenate([over[reach - 1 :: -1], weighted, over[: -reach - 1 : -1]])
    blurred = cv2.sepFilter2D(padded, -1, np.ones(1), kernel)[reach:-reach]
    return np.asarray(blurred * balance[:, None, None].astype(np.float32), np.float32)


def _balance(weight: Array, kernel: Array) -> Array:
    """Factors f of rows so that f · blur(f · weight) is 1: then even maps stay so (Sinkhorn)."""
    reach, factor = len(kernel) // 2, np.ones_like(weight)
    for _ in range(_BALANCINGS):
        rows = factor * weight
        padded = np.concatenate([rows[reach - 1 :: -1], rows, rows[: -reach - 1 : -1]])
        factor = np.sqrt(factor / np.convolve(padded, kernel, mode="valid"))
    return factor
