"""An environment as glTF's EXT_lights_image_based has it: irradiance by SH, reflections by images.

https://github.com/KhronosGroup/glTF/tree/main/extensions/2.0/Vendor/EXT_lights_image_based: cube
faces as PNG in RGBD, one set per level of roughness. The specification leaves open how RGBD encodes
colours, how SH are signed and how faces are turned. Here they are as Babylon.js reads them in a
right-handed scene (tests/engines).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.convert import ADAPTERS
from lightprobe.estimate import Estimate
from lightprobe.imaging.cube import Faces, ggx_levels

EXTENSION = "EXT_lights_image_based"

#: The last level, for roughness 1, has this size; half of the first one's where that is smaller.
_LAST_SIZE = 16
#: The brightest texel lies in this range: below it colours are coarse, and RGBD ends above it.
_RGBD_RANGE = (0.1, 255.0)
_GAMMA = 2.2
#: Faces in the order of the file, and whether they are turned by 180°: the reader mirrors z, and
#: its rows begin at the bottom.
_FACES = ((0, True), (1, True), (2, False), (3, False), (5, True), (4, True))


@dataclass(frozen=True)
class ImageBasedLight:
    """What the extension says of one light."""

    intensity: float  # factor of the two below
    irradiance: list[list[float]]  # 9 × RGB: SH of E(n)
    size: int  # of the faces of the first level
    images: list[bytes]  # PNG: level after level, six faces each


def image_based_light(estimate: Estimate, faces: Faces, scale: float) -> ImageBasedLight:
    """Light of the estimate's SH and, for reflections, of a cube map of the same light.

    `scale`: units of the file over those of the estimate.
    """
    levels = ggx_levels(faces, max(2, int(np.log2(faces.shape[1] / _LAST_SIZE)) + 1))
    intensity = _intensity(scale * float(faces.max()))
    factor = np.float32(scale / intensity)
    images = [
        _png(rgbd(factor * (level[face, ::-1, ::-1] if turned else level[face])))
        for level in levels
        for face, turned in _FACES
    ]
    # Babylon.js' own coefficients are of E(n) / π.
    irradiance = ADAPTERS["babylon"].coefficients(estimate.sh.coefficients).reshape(9, 3) * np.pi
    irradiance *= scale / intensity
    return ImageBasedLight(intensity, irradiance.tolist(), faces.shape[1], images)


def _intensity(largest: float) -> float:
    """1, or where RGBD does not hold the values well a power of two.

    Babylon.js multiplies the irradiance by it twice, so that any other value is a last resort.
    """
    low, high = _RGBD_RANGE
    if largest == 0 or low <= largest <= high:
        return 1.0
    return float(2.0 ** np.ceil(np.log2(largest / high)))


def rgbd(radiance: NDArray[np.float32]) -> NDArray[np.uint8]:
    """RGBA (…, 4) of radiance 0…255: rgb^2.2 / a is the radiance again, all of them from 0 to 1."""
    largest = np.maximum(radiance.max(axis=-1, keepdims=True), 1.0)
    divisor = np.floor(np.clip(255 / largest, 1, 255))
    colour = np.clip(radiance * divisor / 255, 0, 1) ** (1 / _GAMMA)
    return np.concatenate([np.rint(255 * colour), divisor], axis=-1).astype(np.uint8)


def _png(rgba: NDArray[np.uint8]) -> bytes:
    _, data = cv2.imencode(".png", cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGRA))
    return data.tobytes()
