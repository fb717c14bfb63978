"""Stokes parameters freed of noise by what their neighbours say.

A filter by local statistics (Lee, Digital Image Enhancement and Noise Filtering by Use of Local
Statistics, 1980) on S1/S0 and S2/S0: where neighbours differ no more than noise explains, a pixel
becomes their mean; where they differ by more, as at an edge, it stays as it is. S0 is not changed.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.colour import luminance
from lightprobe.geometry import Array

#: Width of the neighbourhood in pixels.
_WIDTH = 5
_LEAST = 1e-30


def smoothed(stokes: NDArray[np.float32], covariance: Array) -> tuple[NDArray[np.float32], Array]:
    """Filter S0, S1, S2 (3, H, W, RGB) with covariance (H, W, 3, 3) of luminance; NaN: not known.

    The covariance that is returned is that of the filtered ones.
    """
    light = luminance(stokes.astype(np.float64))
    known = np.isfinite(light).all(axis=0) & (light[0] > 0)
    s0 = np.where(known, light[0], 1.0)
    q = np.where(known, light[1:] / s0, 0.0)
    noise = _ratio_covariance(q, s0, np.where(known[..., None, None], covariance, 0.0))
    count = np.maximum(_sum(known.astype(np.float64)), 1.0)
    near = _neighbours(known, s0 * known, q, noise, count)
    filtered = np.stack(
        [_pulled(stokes[..., c].astype(np.float64), known, near.share) for c in range(3)], axis=-1
    )
    # what a pixel keeps may be its own light or noise; what it takes has the neighbours' noise
    keeps, takes = near.share * (1 - near.share), (1 - near.share) / count
    result = _taken(covariance, near)
    result[..., 1:, 1:] += (s0**2)[..., None, None] * (
        keeps[..., None, None] * noise + takes[..., None, None] * near.noise
    )
    return filtered.astype(np.float32), np.where(known[..., None, None], result, covariance)


@dataclass(frozen=True, eq=False)
class _Neighbours:
    mean: Array  # (2, H, W) of S1/S0 and S2/S0, by light
    noise: Array  # (H, W, 2, 2) mean covariance
    share: Array  # (H, W) of its own deviation from the mean that a pixel keeps


def _sum(values: Array) -> Array:
    """Over each pixel's neighbourhood (H, W)."""
    return np.asarray(
        cv2.boxFilter(values, -1, (_WIDTH, _WIDTH), normalize=False, borderType=cv2.BORDER_REFLECT)
    )


def _ratio_covariance(q: Array, s0: Array, covariance: Array) -> Array:
    """Of S1/S0 and S2/S0 (H, W, 2, 2), to first order."""
    slopes = np.zeros((*s0.shape, 2, 3))
    slopes[..., 0] = -np.moveaxis(q, 0, -1)
    slopes[..., 0, 1] = slopes[..., 1, 2] = 1
    return np.asarray(slopes @ covariance @ np.swapaxes(slopes, -1, -2) / (s0**2)[..., None, None])


def _neighbours(
    known: NDArray[np.bool_], weight: Array, q: Array, noise: Array, count: Array
) -> _Neighbours:
    mean = np.stack([_sum(weight * part) for part in q]) / np.maximum(_sum(weight), _LEAST)
    off = np.where(known, ((q - mean) ** 2).sum(axis=0), 0.0)
    seen = _sum(off) / np.maximum(count - 1, 1.0)
    mean_noise = np.empty_like(noise)
    for i in range(2):
        for j in range(2):
            mean_noise[..., i, j] = _sum(noise[..., i, j]) / count
    expected = mean_noise[..., 0, 0] + mean_noise[..., 1, 1]
    share = np.clip(1 - expected / np.maximum(seen, _LEAST), 0.0, 1.0)
    return _Neighbours(mean, mean_noise, share)


def _pulled(channel: Array, known: NDArray[np.bool_], share: Array) -> Array:
    """S0, S1, S2 (3, H, W) of one colour, S1 and S2 pulled towards the neighbours' ratio."""
    usable = known & (channel[0] > 0)
    s0 = np.where(usable, channel[0], 0.0)
    total = np.maximum(_sum(s0), _LEAST)
    result = channel.copy()
    for k in (1, 2):
        mean = _sum(np.where(usable, channel[k], 0.0)) / total
        pulled = share * channel[k] + (1 - share) * s0 * mean
        result[k] = np.where(usable, pulled, channel[k])
    return result


def _taken(covariance: Array, near: _Neighbours) -> Array:
    """Of S0, and of the share of S1 and S2 with the rest as the neighbours' ratio times S0."""
    change = np.zeros_like(covariance)
    change[..., 0, 0] = 1
    for k in (1, 2):
        change[..., k, 0] = (1 - near.share) * near.mean[k - 1]
        change[..., k, k] = near.share
    return np.asarray(change @ covariance @ np.swapaxes(change, -1, -2))
