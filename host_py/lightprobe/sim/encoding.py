"""Codes of a picture as the bytes of a camera's format."""

from __future__ import annotations

import cv2
import numpy as np

from lightprobe.sim.sensor import Codes, encode_jpeg

FORMATS = ("MJPG", "YUYV", "NV12", "GREY", "RGBF")


def encode(codes: Codes, pixel_format: str, quality: int, chroma: str) -> bytes:
    """8-bit RGB (H, W, 3) as the bytes of a camera's format; BT.601, full range."""
    if pixel_format == "MJPG":
        return encode_jpeg(codes, quality, chroma)
    planes = cv2.cvtColor(codes, cv2.COLOR_RGB2YCrCb)
    luma, cr, cb = planes[..., 0], planes[..., 1], planes[..., 2]
    if pixel_format == "GREY":
        return luma.tobytes()
    height, width = luma.shape
    if pixel_format == "YUYV":
        packed = np.empty((height, width, 2), np.uint8)
        packed[..., 0] = luma
        for offset, plane in enumerate((cb, cr)):
            packed[:, offset::2, 1] = cv2.resize(
                plane, (width // 2, height), interpolation=cv2.INTER_AREA
            )
        return packed.tobytes()
    half = (width // 2, height // 2)
    mixed = [cv2.resize(plane, half, interpolation=cv2.INTER_AREA) for plane in (cb, cr)]
    return luma.tobytes() + np.stack(mixed, axis=-1).tobytes()
