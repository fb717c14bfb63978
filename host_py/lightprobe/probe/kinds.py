"""What `--probe` names: a ball, its diameter and its surface."""

from __future__ import annotations

import re
from dataclasses import dataclass

from lightprobe.errors import LightprobeError, UsageError
from lightprobe.imaging.ball import SURFACES

_PROBE = re.compile(r"(ball|diffuse-ball):(\d+(?:\.\d+)?)(mm|cm|m)(?:,(\w+))?")
_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
_SMALLEST_MM, _LARGEST_MM = 5.0, 2000.0


class ProbeError(LightprobeError):
    """A picture that does not show the probe as it should; says what to do."""


@dataclass(frozen=True)
class Kind:
    """A ball that is the probe."""

    is_mirror: bool
    diameter_mm: float
    surface: str = "chrome"  # of a mirror: a key of SURFACES


def parse(text: str) -> Kind:
    """Read `ball:60mm[,SURFACE]` or `diffuse-ball:40mm`; raises UsageError."""
    found = _PROBE.fullmatch(text.strip())
    surface = (found[4] or "chrome") if found else ""
    is_mirror = bool(found) and found is not None and found[1] == "ball"
    if not found or surface not in SURFACES or (found[4] and not is_mirror):
        raise UsageError(
            f"--probe {text}: expected ball:DIAMETER or ball:DIAMETER,SURFACE of a mirror ball, or "
            f"diffuse-ball:DIAMETER, like ball:60mm,black; surfaces: {', '.join(SURFACES)}"
        )
    diameter_mm = float(found[2]) * _MM[found[3]]
    if not _SMALLEST_MM <= diameter_mm <= _LARGEST_MM:
        raise UsageError(
            f"--probe {text}: a diameter is {_SMALLEST_MM:g} mm to {_LARGEST_MM / 1000:g} m"
        )
    return Kind(is_mirror, diameter_mm, surface)
