"""OpenCV's decoders without the lines that they, libjpeg and libpng write to standard error."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.imaging.quiet import quiet


def decode(data: bytes, flags: int) -> NDArray[np.generic] | None:
    """Give the pixels as OpenCV has them, blue first; None: no picture, or a damaged one."""
    if not data:
        return None
    with quiet():
        try:
            decoded = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
        except cv2.error:
            return None
    return None if decoded is None else np.asarray(decoded)
