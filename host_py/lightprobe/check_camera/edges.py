"""Sharpening: the mean step of a picture overshoots to both sides.

Isolated steps between two even areas are laid over each other where they cross the middle, each
from 0 to 1. An optical blur never leaves that range; a sharpened step does, by as much below as
above. Real things have bright or dark rims, but not both at most of their edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.calibrate.exposure_series import Codes
from lightprobe.check_camera.answers import Answer, Outcome
from lightprobe.geometry import Array

QUESTION = "sharpening"
#: A profile reaches so far to each side; its ends, from here on, are the even areas.
_REACH_PX, _EVEN_PX = 10, 6
#: Sharpening overshoots so near; local tone mapping bends what is farther.
_NEAR_PX = 4
#: Steps count from so many codes on, between areas that vary by no more than a share of it.
_LEAST_STEP_CODES, _MOST_UNEVEN = 24.0, 0.06
#: Codes that an even area may have: sharpening needs room beyond.
_LOW, _HIGH = 20.0, 215.0
_LEAST_EDGES = 60
#: So much of a step must lie between two pixels: where the lens blurs more, nothing overshoots.
_LEAST_STEEP = 0.4
_MOST_EDGES = 20000
#: The mean step is known at these distances, each from samples so near.
_STEP_PX, _HALF_PX = 0.5, 0.55
#: Shares of a step by which it overshoots: noticed, and too much to measure light with.
NOTICED, TOO_MUCH = 0.03, 0.25
#: Rows near the poles of a panorama are stretched; this share of the picture is left out at each.
_POLE = 1 / 6


@dataclass(frozen=True, eq=False)
class EdgeProfile:
    """The mean step."""

    at_px: Array  # (n,) from where it crosses the middle
    level: Array  # (n,) median; 0 and 1 are the even areas
    above: float  # overshoot over 1
    below: float  # and under 0
    edges: int

    @property
    def overshoot(self) -> float:
        """What is seen on both sides, as a share of the step: their geometric mean."""
        return float(np.sqrt(self.above * self.below))


def luma(pictures: Sequence[Codes]) -> NDArray[np.float32]:
    """Mean luma (H, W) of pictures of one exposure, in codes."""
    weight = np.array([[0.299, 0.587, 0.114]], np.float32)
    mean = np.mean([cv2.transform(picture, weight) for picture in pictures], axis=0)
    return np.asarray(mean, dtype=np.float32)


def profile(lumas: Sequence[NDArray[np.float32]]) -> EdgeProfile | None:
    """Mean step of some pictures (H, W), of different exposures; None: too few steps."""
    found: list[Array] = []
    for one in lumas:
        cut = round(_POLE * len(one))
        middle = one[cut : len(one) - cut]
        found += [_steps(middle), _steps(np.ascontiguousarray(middle.T))]
    steps = np.concatenate(found)
    if len(steps) < _LEAST_EDGES:
        return None
    steps = steps[_steepness(steps) > _LEAST_STEEP]
    if len(steps) < _LEAST_EDGES:
        return None
    if len(steps) > _MOST_EDGES:
        steps = np.random.default_rng(0).permutation(steps)[:_MOST_EDGES]
    at, level = _laid_over(steps)
    reach = round((_REACH_PX - 1) / _STEP_PX)
    places = np.asarray(_STEP_PX * np.arange(-reach, reach + 1), dtype=np.float64)
    median = np.array([np.median(level[np.abs(at - place) <= _HALF_PX]) for place in places])
    near = np.abs(places) <= _NEAR_PX
    above = np.max(median[near & (places > 0)], initial=1.0) - 1
    below = -np.min(median[near & (places < 0)], initial=0.0)
    return EdgeProfile(places, median, float(above), float(below), len(steps))


def _steps(picture: NDArray[np.float32]) -> Array:
    """Rows of pixels (n, 2·reach + 1) around isolated steps along the rows, rising."""
    reach, even = _REACH_PX, _REACH_PX - _EVEN_PX + 1
    slope = np.abs(picture[:, 2:] - picture[:, :-2])
    peak = slope == cv2.dilate(slope, np.ones((1, 2 * reach + 1), np.uint8))
    y, x = np.nonzero(peak & (slope > _LEAST_STEP_CODES / 4))
    x = x + 1
    inside = (x >= reach) & (x < picture.shape[1] - reach)
    y, x = y[inside], x[inside]
    rows = picture[y[:, None], x[:, None] + np.arange(-reach, reach + 1)].astype(np.float64)
    left, right = rows[:, :even], rows[:, -even:]
    step = right.mean(axis=1) - left.mean(axis=1)
    limit = _MOST_UNEVEN * np.abs(step)
    ends = np.stack([left.mean(axis=1), right.mean(axis=1)])
    good = (np.abs(step) >= _LEAST_STEP_CODES) & (ends.min(axis=0) > _LOW)
    good &= (ends.max(axis=0) < _HIGH) & (np.ptp(left, axis=1) < 2 * limit)
    good &= np.ptp(right, axis=1) < 2 * limit
    rows = rows[good]
    falls = step[good] < 0
    rows[falls] = rows[falls, ::-1]
    return np.asarray(rows)


def _steepness(steps: Array) -> Array:
    """Largest change (n,) from pixel to pixel, as a share of each step."""
    even = _REACH_PX - _EVEN_PX + 1
    height = steps[:, -even:].mean(axis=1) - steps[:, :even].mean(axis=1)
    return np.asarray(np.diff(steps, axis=1).max(axis=1) / height)


def _laid_over(steps: Array) -> tuple[Array, Array]:
    """Places and levels of all their pixels, counted from where each crosses its middle."""
    even = _REACH_PX - _EVEN_PX + 1
    low = steps[:, :even].mean(axis=1, keepdims=True)
    high = steps[:, -even:].mean(axis=1, keepdims=True)
    level = (steps - low) / (high - low)
    over = level[:, :-1] < 0.5
    crosses = over & (level[:, 1:] >= 0.5)
    middle = len(steps[0]) // 2
    distance = np.abs(np.arange(level.shape[1] - 1) + 0.5 - middle)
    k = np.argmin(np.where(crosses, distance, np.inf), axis=1)
    which = np.arange(len(steps))
    before, after = level[which, k], level[which, k + 1]
    cross = k + (0.5 - before) / np.where(after > before, after - before, 1)
    at = np.arange(level.shape[1]) - cross[:, None]
    return at.ravel(), level.ravel()


def judge(found: EdgeProfile | None) -> Answer:
    """Say whether the camera sharpens."""
    if found is None:
        return Answer(
            QUESTION, Outcome.UNKNOWN, "because the picture has too few clear edges",
            "put printed paper or furniture with clear edges in view",
        )  # fmt: skip
    numbers = {"overshoot": found.overshoot, "edges": float(found.edges)}
    if found.overshoot < NOTICED:
        return Answer(QUESTION, Outcome.FINE, "edges do not overshoot", numbers=numbers)
    words = f"sharpening (edges overshoot by {100 * found.overshoot:.0f} % of their height)"
    step = (
        "switch it off (v4l2-ctl -d DEVICE -c sharpness=0; processing=neutral in the camera file); "
        "small lamps count as brighter than they are"
    )
    outcome = Outcome.UNFIT if found.overshoot > TOO_MUCH else Outcome.DEFECT
    return Answer(QUESTION, outcome, words, step, numbers)
