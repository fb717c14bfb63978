"""Pixels that shine before a covered lens: stuck ones in every exposure, warm ones in long ones."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.calibrate.exposure_series import ExposureSeries
from lightprobe.calibrate.flat_patches import exposure_of, steady_frames
from lightprobe.check_camera.answers import Answer, Outcome
from lightprobe.geometry import Array

QUESTION = "pixels"
#: Exposures before the covered lens; those that a camera has not are left out.
SCHEDULE_US = (512.0, 32768.0)
#: Codes over their surroundings from which on pixels shine; a JPEG rings around them by a share.
NOTICED_CODES, _RING, _RING_PX = 12.0, 0.45, 17
#: A cover lets less light through than this; so much of what shines is gone in a short exposure.
_MOST_LEAK_CODES, _LEAST_STUCK = 32.0, 0.5
#: More the daemon does not leave out.
MOST = 4096


@dataclass(frozen=True, eq=False)
class ShiningPixels:
    """What shines by itself."""

    stuck_px: NDArray[np.intp]  # (n, 2) column and row
    warm_px: NDArray[np.intp]  # (m, 2)
    leak_codes: float  # median of the picture
    exposure_us: float  # the longest
    picture: NDArray[np.float32]  # (H, W) brightest colour, mean of its frames

    @property
    def places_px(self) -> NDArray[np.intp]:
        """All of them (n + m, 2)."""
        return np.concatenate([self.stuck_px, self.warm_px])


def find(series: ExposureSeries) -> ShiningPixels | None:
    """Look at a series of a covered lens; None: no picture."""
    means: list[tuple[float, Array]] = []
    for group in series.steps():
        pictures = steady_frames(group)
        if pictures:
            mean = np.mean([picture.astype(np.float32) for picture in pictures], axis=0)
            means.append((exposure_of(series, group) or 0.0, mean.max(axis=2)))
    if not means:
        return None
    means.sort(key=lambda one: one[0])
    exposure_us, longest = means[-1]
    shine = _shine(longest)
    y, x = np.nonzero(_peaks(shine))
    # A warm pixel's light goes with the exposure, a stuck one's does not.
    stays = _shine(means[0][1])[y, x] >= _LEAST_STUCK * shine[y, x]
    if len(means) == 1:
        stays[:] = True
    places = np.stack([x, y], axis=-1)
    picture = longest.astype(np.float32)
    return ShiningPixels(
        places[stays], places[~stays], float(np.median(longest)), exposure_us, picture
    )


def _shine(picture: Array) -> Array:
    """Codes (H, W) over those around: what leaks through a cover is smooth."""
    codes = np.rint(np.clip(picture, 0, 255)).astype(np.uint8)
    return np.asarray(picture - cv2.medianBlur(codes, 15), dtype=np.float64)


def _peaks(shine: Array) -> NDArray[np.bool_]:
    """Pixels that shine, not what a JPEG or demosaicing makes of those beside."""
    values = shine.astype(np.float32)
    beside = cv2.dilate(values, np.ones((3, 3), np.uint8))
    around = cv2.dilate(values, np.ones((_RING_PX, _RING_PX), np.uint8))
    found = (values >= NOTICED_CODES) & (values >= beside - 1) & (values >= _RING * around)
    return np.asarray(found)


def judge(found: ShiningPixels | None) -> Answer:
    """Say which pixels shine by themselves."""
    if found is None:
        return Answer(QUESTION, Outcome.UNKNOWN, "because no picture came", "cover the lens again")
    numbers = {
        "stuck": float(len(found.stuck_px)), "warm": float(len(found.warm_px)),
        "leak_codes": found.leak_codes, "exposure_us": found.exposure_us,
    }  # fmt: skip
    if found.leak_codes > _MOST_LEAK_CODES:
        return Answer(
            QUESTION, Outcome.UNKNOWN, "because light comes through what covers the lens",
            "cover it with something opaque, such as black cloth, not with a hand", numbers,
        )  # fmt: skip
    if not len(found.places_px):
        return Answer(QUESTION, Outcome.FINE, "none shines by itself", numbers=numbers)
    stuck, warm = len(found.stuck_px), len(found.warm_px)
    kinds = [f"{n} {kind}" for n, kind in ((stuck, "stuck"), (warm, "warm")) if n]
    words = f"{' and '.join(kinds)} pixel{'s' if stuck + warm > 1 else ''}"
    if stuck + warm > MOST:
        step = f"a camera file takes {MOST} at most: take another camera, or cool this one"
        return Answer(QUESTION, Outcome.UNFIT, words, step, numbers)
    step = "--output FILE.camera names them in stuck_pixels: the daemon leaves them out"
    return Answer(QUESTION, Outcome.DEFECT, words, step, numbers)
