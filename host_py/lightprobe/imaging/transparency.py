"""Pixels that show nothing because their file says that they are transparent."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

Sample = TypeVar("Sample", bound=np.generic)
NOTE = "transparent pixels are not seen"
#: Of 255. What is half transparent and less shows the picture more than nothing.
_LEAST_OPAQUE = 128


def read(path: Path) -> NDArray[np.bool_] | None:
    """Where (height, width) the picture is more transparent than not; None: nowhere.

    By alpha, by a palette's alpha, or by the one colour that counts as transparent.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path) as picture:
                if not picture.has_transparency_data:
                    return None
                alpha = np.asarray(_alpha(picture))
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        return None  # of a kind that Pillow does not know: it has none
    clear = np.asarray(alpha < _LEAST_OPAQUE)
    return clear if clear.any() else None


def _alpha(picture: Image.Image) -> NDArray[np.generic]:
    if picture.mode.startswith("I"):  # 16 bits of grey, and one of them is transparent
        return np.asarray(np.where(np.asarray(picture) == picture.info["transparency"], 0, 255))
    return np.asarray(picture.convert("RGBA").getchannel("A"))


def fill(codes: NDArray[Sample], transparent: NDArray[np.bool_]) -> NDArray[Sample]:
    """Give transparent pixels the colour of the nearest other one: means at the edge stay right."""
    _, nearest = cv2.distanceTransformWithLabels(
        transparent.astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    colours = np.zeros((int(nearest.max()) + 1, *codes.shape[2:]), codes.dtype)
    colours[nearest[~transparent]] = codes[~transparent]
    return np.asarray(colours[nearest])
