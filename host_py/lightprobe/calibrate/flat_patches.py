"""From frames of a series to what a response is fitted to: mean codes of small flat places.

A place is a block of 8 × 8 pixels, as JPEG has them. It counts at an exposure where all of its
pixels, in all frames, lie within the scale and close together: so its mean is nearly free of noise,
of quantization, and of what JPEG does to edges and colours.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.calibrate.exposure_series import Codes, ExposureSeries, Frame
from lightprobe.calibrate.response_curve import PatchCodes, ResponseError
from lightprobe.geometry import Array

BLOCK_PX = 8
#: Frames at the end of a step that are averaged.
STEADY_FRAMES = 4
_MOST_DEVIATION_CODES = 8.0
#: Pixels this close to either end of the scale may be clipped.
_MARGIN_CODES = 2
#: A step's frames that differ by more than this have not settled, or the light is not constant.
_MOST_UNREST_CODES = 3.0
#: Places are drawn evenly from so many classes of brightness.
_CLASSES = 48
_PLACES_PER_CLASS = 32
#: A picture saturates below 255 when so much of it piles up at its brightest code.
_PILE = 2e-3
_FULL_SCALE_CODE = 250


@dataclass(frozen=True, eq=False)
class Step:
    """One exposure of the scene: statistics (rows, columns, 3) of its blocks."""

    exposure_us: float
    mean: Array
    deviation: Array  # largest of any frame
    lowest: Array
    highest: Array
    unrest_codes: float  # mean difference between its first and last frame
    brightest: int  # code of any pixel
    pile: float  # share of pixels within 2 codes of the brightest


def blocks(codes: Codes) -> Array:
    """Whole blocks (rows, columns, 64, 3) of a picture."""
    height, width, _ = codes.shape
    rows, columns = height // BLOCK_PX, width // BLOCK_PX
    cut = codes[: rows * BLOCK_PX, : columns * BLOCK_PX]
    tiles = cut.reshape(rows, BLOCK_PX, columns, BLOCK_PX, 3).swapaxes(1, 2)
    return np.asarray(tiles.reshape(rows, columns, BLOCK_PX**2, 3))


def step_of(exposure_us: float, pictures: Iterable[Codes]) -> Step | None:
    """Statistics of one exposure; None without a picture."""
    means, deviations, lows, highs = [], [], [], []
    brightest, pile = 0, 0.0
    for codes in pictures:
        height, width, _ = codes.shape
        rows, columns = height // BLOCK_PX, width // BLOCK_PX
        cut = codes[: rows * BLOCK_PX, : columns * BLOCK_PX]
        light = cut.astype(np.float32)
        mean, square = block_means(light), block_means(light * light)
        means.append(mean.astype(np.float64))
        deviations.append(np.sqrt(np.maximum(square - mean * mean, 0)))
        lows.append(_folded(np.minimum, cut))
        highs.append(_folded(np.maximum, cut))
        strongest = np.maximum(np.maximum(codes[..., 0], codes[..., 1]), codes[..., 2])
        brightest = max(brightest, int(strongest.max()))
        pile = float(np.mean(strongest >= brightest - 2))
    if not means:
        return None
    return Step(
        exposure_us=exposure_us,
        mean=np.mean(means, axis=0),
        deviation=np.max(deviations, axis=0),
        lowest=np.min(lows, axis=0),
        highest=np.max(highs, axis=0),
        unrest_codes=float(np.mean(np.abs(means[-1] - means[0]))),
        brightest=brightest,
        pile=pile,
    )


def block_means(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Means of the whole blocks of a picture, as it has channels: (rows, columns[, 3])."""
    height, width = light.shape[:2]
    size = (width // BLOCK_PX, height // BLOCK_PX)
    return np.asarray(cv2.resize(light, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _folded(take: np.ufunc, codes: Codes) -> Codes:
    """Smallest or largest codes of whole blocks (rows, columns, 3)."""
    for _ in range(BLOCK_PX.bit_length() - 1):
        codes = take(codes[::2], codes[1::2])
        codes = take(codes[:, ::2], codes[:, 1::2])
    return codes


def steady_frames(frames: Sequence[Frame]) -> list[Codes]:
    """Pictures of a step's last frames, when every camera has settled; broken ones left out."""
    pictures = (frame.codes() for frame in frames[-STEADY_FRAMES:])
    return [picture for picture in pictures if picture is not None]


def exposure_of(series: ExposureSeries, frames: Sequence[Frame]) -> float | None:
    """Exposure (times gain) of a step's last frames: stated if the camera does, else commanded."""
    stated = [frame.stated_us for frame in frames[-STEADY_FRAMES:] if frame.stated_us is not None]
    if (series.reports_exposure and stated) or frames[-1].step < 0:
        return float(np.median(stated)) if stated else None
    return frames[-1].commanded_us


def collect(steps: Sequence[Step], seed: int = 0) -> tuple[PatchCodes, list[str]]:
    """Choose places and give their codes, and notes on what was left out.

    Raises :class:`~lightprobe.calibrate.response_curve.ResponseError` when nothing usable is left.
    """
    notes = []
    good = []
    for step in steps:
        if step.unrest_codes > _MOST_UNREST_CODES:
            notes.append(
                f"{step.exposure_us:g} us left out: its frames differ by {step.unrest_codes:.1f} "
                f"codes, because the light or the camera moved"
            )
        else:
            good.append(step)
    if len({step.mean.shape for step in good}) > 1:
        raise ResponseError(
            "response: the pictures have different sizes: use one camera at one size"
        )
    if len({step.exposure_us for step in good}) < 3:
        reason = f": {notes[0]}" if notes else ""
        raise ResponseError(
            f"response: {len(good)} usable exposures, but three are needed and ten are "
            f"better{reason}"
        )
    top = top_code(good)
    if top < 255:
        notes.append(f"the picture saturates at code {top}, which is taken as full scale")
    codes = np.stack([usable(step, top) for step in good], axis=2)
    codes = codes.reshape(-1, len(good), 3)
    exposures = np.array([step.exposure_us for step in good])
    order = np.argsort(exposures, kind="stable")
    chosen = _choose(
        np.stack([step.mean for step in good], axis=2).reshape(codes.shape), codes, seed
    )
    return PatchCodes(codes[chosen][:, order], exposures[order], top), notes


def top_code(steps: Sequence[Step]) -> int:
    """Code of full scale: lower than 255 only where the picture plainly saturates below."""
    brightest = max(step.brightest for step in steps)
    longest = max(steps, key=lambda step: step.exposure_us)
    if brightest >= _FULL_SCALE_CODE or longest.pile < _PILE:
        return 255
    return brightest


def usable(step: Step, top: int) -> Array:
    """Mean codes (rows, columns, 3), NaN where a block does not count."""
    flat = np.all(step.deviation <= _MOST_DEVIATION_CODES, axis=2, keepdims=True)
    inside = (step.lowest >= 1) & (step.mean >= _MARGIN_CODES)
    inside &= step.highest <= top - _MARGIN_CODES
    return np.where(flat & inside, step.mean, np.nan)


def _choose(means: Array, codes: Array, seed: int) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Indices of places that are usable twice at least, as many bright as dark ones."""
    usable = np.flatnonzero((np.isfinite(codes).sum(axis=1) >= 2).any(axis=1))
    brightness = means[usable].sum(axis=(1, 2))
    if not len(usable):
        return usable
    edges = np.linspace(brightness.min(), brightness.max() + 1e-9, _CLASSES + 1)
    number = np.digitize(brightness, edges)
    rng = np.random.default_rng(seed)
    chosen = []
    for one in np.unique(number):
        members = usable[number == one]
        chosen.append(rng.permutation(members)[:_PLACES_PER_CLASS])
    return np.concatenate(chosen)
