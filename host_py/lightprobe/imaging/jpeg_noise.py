"""What JPEG's rounding does to the codes of a picture, from its own quantisation table."""

from __future__ import annotations

import math

#: Markers (ITU-T T.81, table B.1).
_TABLES, _SCAN = 0xDB, 0xDA
_FRAMES = (0xC0, 0xC1, 0xC2)
_COEFFICIENTS = 64


def code_sigma(data: bytes) -> float | None:
    """1 sigma of a pixel's luma, in codes; None: `data` is no JPEG with such a table.

    A coefficient is rounded to multiples of its step q, so that it is off by q / √12 at most on
    average; the transform is orthonormal, so that a pixel is off by the root of their mean square.
    Rounding hits small coefficients less: they become 0, and are off by what they were.
    """
    if data[:2] != b"\xff\xd8":
        return None
    steps: dict[int, list[int]] = {}
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        segment = data[at + 4 : at + 2 + length]
        if marker == _TABLES:
            steps |= _tables(segment)
        elif marker in _FRAMES and len(segment) >= 9:
            luma = steps.get(segment[8])  # of the first component
            if luma is None:
                return None
            return math.sqrt(sum(q * q for q in luma) / _COEFFICIENTS / 12)
        elif marker == _SCAN:
            return None
        at += 2 + length
    return None


def _tables(segment: bytes) -> dict[int, list[int]]:
    """Steps of each table by its number; tables of 8 or 16 bits."""
    found: dict[int, list[int]] = {}
    at = 0
    while at < len(segment):
        width, number = 1 + (segment[at] >> 4), segment[at] & 15
        steps = segment[at + 1 : at + 1 + width * _COEFFICIENTS]
        if len(steps) == width * _COEFFICIENTS:
            found[number] = [
                int.from_bytes(steps[k : k + width], "big") for k in range(0, len(steps), width)
            ]
        at += 1 + width * _COEFFICIENTS
    return found
