"""The scene that all pictures of tests/files/exr and tests/files/hdr show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from lightprobe.geometry import equirect_solid_angles
from numpy.typing import NDArray

FILES = Path(__file__).resolve().parents[1] / "files"
SKY, FLOOR, LAMP = (0.5, 0.4, 0.3), (0.1, 0.1, 0.1), (400.0, 300.0, 200.0)
AZIMUTH_DEG, ELEVATION_DEG, RADIUS_DEG = 60.0, 30.0, 4.0
#: Radiance that CIE X, Y, Z of these primaries, D65, is: IEC 61966-2-1.
TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)


def draw(width_px: int = 256) -> NDArray[np.float32]:
    """The scene as an equirectangular picture."""
    height_px = width_px // 2
    t = (np.arange(height_px) + 0.5)[:, None] / height_px * np.pi
    longitude = ((np.arange(width_px) + 0.5)[None, :] / width_px - 0.5) * 2 * np.pi
    x, y, z = np.sin(t) * np.sin(longitude), np.cos(t), -np.sin(t) * np.cos(longitude)
    azimuth, elevation = np.radians([AZIMUTH_DEG, ELEVATION_DEG])
    cosine = (
        x * np.cos(elevation) * np.sin(azimuth)
        + y * np.sin(elevation)
        - z * np.cos(elevation) * np.cos(azimuth)
    )
    picture = np.where((y > 0)[..., None], np.array(SKY), np.array(FLOOR))
    picture = np.broadcast_to(picture, (height_px, width_px, 3)).copy()
    picture[cosine > np.cos(np.radians(RADIUS_DEG))] = LAMP
    return picture.astype(np.float32)


def light(picture: NDArray[np.float32]) -> NDArray[np.float64]:
    """Mean radiance over the sphere, of each colour, of what is seen."""
    weight = np.broadcast_to(
        equirect_solid_angles(picture.shape[1], picture.shape[0])[:, None], picture.shape[:2]
    )
    seen = np.isfinite(picture).all(axis=-1)
    return np.asarray((picture[seen] * weight[seen, None]).sum(axis=0) / weight[seen].sum())
