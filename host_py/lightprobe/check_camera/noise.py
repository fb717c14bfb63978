"""Noise reduction in time: the noise of one picture is still there in the next.

The noise of a sensor is new in every picture. Then differences d of pictures that follow each other
have the correlation −1/2; a filter that keeps a share a of the last picture makes (a − 1)/2 of it.
Noise reduction in space looks like what demosaicing and JPEG do to noise, and is not told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from lightprobe.calibrate.exposure_series import Codes
from lightprobe.check_camera.answers import Answer, Outcome

QUESTION = "noise reduction"
#: Share of the last picture above which noise has been filtered; rounding hides a part of it.
NOTICED = 0.04
#: Noise below so many codes is lost in rounding.
_LEAST_SIGMA = 0.35
_FLAT_CODES, _LOW, _HIGH = 6.0, 16, 235
_LEAST_PIXELS = 2000
_BOX, _WIDE = (9, 9), (65, 65)


@dataclass(frozen=True)
class NoiseKinship:
    """How much noise has in common with that of the last picture."""

    in_time: float
    sigma_codes: float
    pixels: int


def kinship(steps: Sequence[Sequence[Codes]]) -> NoiseKinship | None:
    """Look at some exposures, three or more consecutive pictures each; None: no noise is seen."""
    across = power = 0.0
    pixels = 0
    for pictures in steps:
        if len(pictures) < 3:
            continue
        green = np.stack([picture[..., 1] for picture in pictures]).astype(np.float32)
        mean = green.mean(axis=0)
        even = np.abs(mean - cv2.blur(mean, _BOX)) < _FLAT_CODES
        even &= (green.min(axis=0) > _LOW) & (green.max(axis=0) < _HIGH)
        if even.sum() < _LEAST_PIXELS:
            continue
        change = np.diff(green, axis=0)
        change -= np.stack([cv2.blur(one, _WIDE) for one in change])  # light that changes
        here = float(np.mean(change[:, even] ** 2))
        if here < 2 * _LEAST_SIGMA**2:
            continue
        before, after = change[:-1][:, even], change[1:][:, even]
        weight = int(even.sum())
        across += weight * float(np.mean(before * after)) / here
        power += weight * here / 2
        pixels += weight
    if not pixels:
        return None
    return NoiseKinship(1 + 2 * across / pixels, float(np.sqrt(power / pixels)), pixels)


def judge(found: NoiseKinship | None) -> Answer:
    """Say whether the camera reduces noise in time."""
    if found is None:
        return Answer(
            QUESTION, Outcome.UNKNOWN, "because no noise is left in its even areas, be it by its "
            "file format or by noise reduction",
            "format = yuyv in [v4l2] of the camera file, if the camera has it, tells more",
        )  # fmt: skip
    numbers = {"share_of_last_picture": found.in_time, "sigma_codes": found.sigma_codes}
    if found.in_time <= NOTICED:
        return Answer(QUESTION, Outcome.FINE, "each picture has noise of its own", numbers=numbers)
    return Answer(
        QUESTION, Outcome.DEFECT, "noise reduction in time",
        "switch it off if the camera has a control for it (v4l2-ctl --list-ctrls); small changes "
        "of light come late with it",
        numbers,
    )  # fmt: skip
