"""OpenCV's decoders without the lines that they write to standard error."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np
from numpy.typing import NDArray


def decode(data: bytes, flags: int) -> NDArray[np.generic] | None:
    """Give the pixels as OpenCV has them, blue first; None: no picture, or a damaged one."""
    if not data:
        return None
    with _quietly():
        try:
            decoded = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
        except cv2.error:
            return None
    return None if decoded is None else np.asarray(decoded)


@contextmanager
def _quietly() -> Iterator[None]:
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
