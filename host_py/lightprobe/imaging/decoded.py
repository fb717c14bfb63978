"""What the readers of float pictures give."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lightprobe.imaging import primaries

Radiance = NDArray[np.float32]

#: The largest picture that is read: 32768×16384.
MOST_PIXELS = 1 << 29
TOO_LARGE = "expected at most 32768×16384 pixels"
#: Samples of half floats from here on are saturated; so +Inf in any file stands for at least this
#: (the daemon's rule, too: vision/picture/cells.h).
HALF_MOST = float(np.finfo(np.float16).max)


@dataclass(frozen=True)
class Decoded:
    """Linear light (height, width, 3), Rec. 709, row 0 up, and what had to be done to it.

    NaN: not seen, or broken. +Inf: saturated.
    """

    radiance: Radiance
    notes: list[str] = field(default_factory=list)
    unseen: NDArray[np.bool_] | None = None  # (height, width); None: all is seen


def convert(radiance: Radiance, stated: tuple[float, ...]) -> Decoded:
    """Convert from the primaries that a file states to Rec. 709; what is saturated stays so.

    Raises ValueError for what are no primaries.
    """
    matrix = primaries.to_rec709(stated)
    if primaries.is_rec709(matrix):
        return Decoded(radiance)
    saturated = np.isposinf(radiance)
    least = max(HALF_MOST, float(radiance[np.isfinite(radiance)].max(initial=0)))
    converted = (np.where(saturated, np.float32(least), radiance) @ matrix.T).astype(np.float32)
    converted[saturated] = np.inf
    return Decoded(converted, ["primaries converted to Rec. 709"])
