"""Bits of the flags of a light and of an estimate.

Generated from lightprobe.proto by proto/flags_code.py.
"""

from enum import IntFlag


class LightFlag(IntFlag):
    """Bits of Light.flags."""

    CLIPPED = 1
    REFLECTION = 2
    EXTENDED = 4
    RING = 8
    HELD = 16


class EstimateFlag(IntFlag):
    """Bits of Estimate.flags."""

    STALE = 1
    EXPOSURE_UNKNOWN = 2
    CLIPPED = 4
    UNDEREXPOSED = 8
    BRACKET_INCOMPLETE = 16
    PARTIAL_VIEW = 32
    MORE_LIGHTS = 64
    INVALID_INPUT = 128
    DEGRADED = 256
    RING_ONLY = 512
    EXPOSURE_IGNORED = 1024
    RING_FAULT = 2048
    WHEEL_FAULT = 4096
    NO_LIGHT = 8192
    MOTION = 16384
    FLICKER = 32768
    COVERED = 65536
    POLARIZATION_UNKNOWN = 131072
    FILM_TURNED = 262144
    RESPONSE = 524288
