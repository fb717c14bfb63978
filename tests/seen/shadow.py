"""The research's shadow test, replayed: how steep is the shadow of an upright rod?

Its measure: elevation = atan(height / length of the shadow), of six scenes with one main lamp.
Here lamps of those elevations hang in a plain room; the daemon measures them through the simulated
camera. The rod's true shadow is by the lamp's place; the drawn one by the packet's direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import probe
from lightprobe import geometry
from lightprobe.geometry import Array
from lightprobe.lamp import Lamp, disc_pixels

#: Alhakamy and Tuceryan, "An Empirical Evaluation of the Performance of Real-Time Illumination
#: Approaches", table of shadow angles, as elevations; their errors recomputed: 1.39° RMS.
ELEVATIONS_DEG = (12.96, 50.19, 27.47, 52.44, 23.42, 58.39)
PUBLISHED_RMS_DEG = 1.39
#: Distances of the rod from the probe; of the lamp from the probe.
RODS_M, LAMP_M = (0.0, 0.3, 0.5, 1.0), 2.5
AZIMUTHS_DEG = (20.0, 80.0, 140.0, 200.0, 260.0, 320.0)
RADIUS_DEG, _WIDTH_PX = 1.0, 1920


@dataclass(frozen=True)
class Shadow:
    """Errors of one scene's shadows, degrees, by the rod's distance from the probe."""

    elevation_deg: float
    errors_deg: tuple[float, ...]


def _panorama(towards: Array) -> Array:
    radiance = np.full((_WIDTH_PX // 2, _WIDTH_PX, 3), 0.5, np.float32)
    lamp = Lamp(towards, RADIUS_DEG, np.array([3.0, 2.8, 2.4]))
    index, values = disc_pixels(lamp, _WIDTH_PX, _WIDTH_PX // 2)
    radiance.reshape(-1, 3)[index] += values
    return radiance


def measured() -> list[Shadow]:
    """All six scenes. Rods stand where the error is largest: towards the lamp, or away from it."""
    shadows = []
    for elevation, azimuth in zip(ELEVATIONS_DEG, AZIMUTHS_DEG, strict=True):
        towards = geometry.direction_from_angles(azimuth, elevation)
        told = probe.measure(_panorama(towards)).estimate.lights[0].elevation_deg
        level = LAMP_M * np.cos(np.radians(elevation))
        height = LAMP_M * np.sin(np.radians(elevation))
        true = np.degrees([np.arctan2(height, np.abs(level + np.array([-d, d]))) for d in RODS_M])
        errors = np.abs(told - true).max(axis=1)
        shadows.append(Shadow(elevation, tuple(errors.tolist())))
    return shadows


def table(shadows: list[Shadow]) -> str:
    """Markdown: a row for each scene, and root mean squares."""
    head = ["elevation of the lamp", *(f"rod {d:g} m from the probe" for d in RODS_M)]
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for shadow in shadows:
        errors = " | ".join(f"{error:.2f}°" for error in shadow.errors_deg)
        lines.append(f"| {shadow.elevation_deg:.2f}° | {errors} |")
    rms = np.sqrt(np.mean([np.square(shadow.errors_deg) for shadow in shadows], axis=0))
    lines.append(f"| RMS | {' | '.join(f'{value:.2f}°' for value in rms)} |")
    lines.append(f"| published, RMS | {PUBLISHED_RMS_DEG:g}° |" + " |" * (len(RODS_M) - 1))
    return "\n".join(lines)
