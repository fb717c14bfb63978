"""What a series of exposures of a lit scene at rest shows, gathered in one pass over its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.calibrate.exposure_series import Codes, ExposureSeries
from lightprobe.calibrate.flat_patches import (
    BLOCK_PX,
    Step,
    exposure_of,
    steady_frames,
    step_of,
    top_code,
    usable,
)
from lightprobe.calibrate.response_curve import curve_at
from lightprobe.check_camera import edges, noise
from lightprobe.check_camera.noise import NoiseKinship
from lightprobe.geometry import Array

GREEN = 1
#: Pictures of so many exposures are looked at for edges, and for noise.
_LUMAS, _NOISES = 5, 3
_MIDDLE_CODES = (30.0, 190.0)
#: The darkest code from which a place tells anything.
LOWEST_CODE = 16.0
#: Blocks in a row of them that make its mean worth something.
_LEAST_IN_ROW = 12
#: Places whose light is known well enough to see it flicker.
_FLICKER_CODES = (48.0, 235.0)
#: Light that differs by more than this from picture to picture flickers.
MOST_FLICKER = 0.012
#: The brightest exposure must show so large a share of the picture above the darkest codes.
_LEAST_LIT = 0.05


@dataclass(frozen=True, eq=False)
class SceneSeries:
    """A scene at several exposures."""

    steps: tuple[Step, ...]
    codes: Array  # (steps, rows, columns, 3) mean codes of blocks of 8 × 8 pixels; NaN: unusable
    exposures_us: Array  # (steps,)
    flicker: Array  # (steps,) RMS change of light from picture to picture, relative; NaN: unseen
    lumas: tuple[NDArray[np.float32], ...]
    noise: NoiseKinship | None

    @property
    def flickers(self) -> float:
        """The largest change from picture to picture, relative; 0: none is seen."""
        seen = self.flicker[np.isfinite(self.flicker)]
        return float(seen.max(initial=0.0))

    @property
    def is_dark(self) -> bool:
        """Tell whether no exposure shows anything."""
        return all(np.mean(step.mean[..., GREEN] > LOWEST_CODE) < _LEAST_LIT for step in self.steps)

    def best_us(self) -> float:
        """Exposure in which most places are well exposed in all colours."""
        low, high = _MIDDLE_CODES
        inside = np.all((self.codes > low) & (self.codes < high), axis=-1)
        return float(self.exposures_us[np.argmax(inside.sum(axis=(1, 2)))])


def gather(series: ExposureSeries, table: Array) -> SceneSeries:
    """Go through a series; `table`: linear light (256, 3) of each code, for comparisons only."""
    steps: list[Step] = []
    flicker: list[float] = []
    lumas: list[NDArray[np.float32]] = []
    kin: list[NoiseKinship] = []
    for group in series.steps():
        exposure_us, pictures = exposure_of(series, group), steady_frames(group)
        step = step_of(exposure_us, pictures) if exposure_us else None
        if step is None:
            continue
        steps.append(step)
        flicker.append(_flicker(pictures, table[:, GREEN]))
        middle = float(np.median(step.mean[..., GREEN]))
        if not _MIDDLE_CODES[0] < middle < _MIDDLE_CODES[1]:
            continue
        if len(lumas) < _LUMAS:
            lumas.append(edges.luma(pictures))
        if len(kin) < _NOISES and (found := noise.kinship([pictures])) is not None:
            kin.append(found)
    top = top_code(steps) if steps else 255
    codes = np.stack([usable(step, top) for step in steps]) if steps else np.zeros((0, 0, 0, 3))
    return SceneSeries(
        tuple(steps), codes, np.array([step.exposure_us for step in steps]), np.array(flicker),
        tuple(lumas), _together(kin),
    )  # fmt: skip


def _together(kin: Sequence[NoiseKinship]) -> NoiseKinship | None:
    if not kin:
        return None
    weight = [one.pixels for one in kin]
    return replace(
        kin[0], in_time=float(np.average([one.in_time for one in kin], weights=weight)),
        pixels=sum(weight),
    )  # fmt: skip


def _flicker(pictures: Sequence[Codes], curve: Array) -> float:
    """RMS change of the light of rows of blocks (a rolling shutter draws bands), relative."""
    if len(pictures) < 3:
        return np.nan
    each = np.stack([_green_blocks(picture) for picture in pictures])
    good = np.all((each > _FLICKER_CODES[0]) & (each < _FLICKER_CODES[1]), axis=0)
    rows = good.sum(axis=1) >= _LEAST_IN_ROW
    if not rows.any():
        return np.nan
    light = np.log(np.maximum(curve_at(curve, each), 1e-7))
    light = np.where(good, light - light.mean(axis=0), 0)
    of_rows = light[:, rows].sum(axis=2) / good[rows].sum(axis=1)
    # A filter in time makes pictures drift to where they belong: that is no flicker.
    bend = np.diff(of_rows, n=2, axis=0) / np.sqrt(6)
    return float(np.sqrt(np.mean(bend**2)))


def _green_blocks(picture: Codes) -> Array:
    """Mean green codes (rows, columns) of whole blocks."""
    height, width, _ = picture.shape
    size = (width // BLOCK_PX, height // BLOCK_PX)
    green = picture[: size[1] * BLOCK_PX, : size[0] * BLOCK_PX, GREEN].astype(np.float32)
    return np.asarray(cv2.resize(green, size, interpolation=cv2.INTER_AREA), dtype=np.float64)
