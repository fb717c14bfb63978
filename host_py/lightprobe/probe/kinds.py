"""What `--probe` names: a ball, its diameter and its surface; or an upright rod."""

from __future__ import annotations

import re
from dataclasses import dataclass

from lightprobe.errors import LightprobeError, UsageError
from lightprobe.imaging.ball import SURFACES

_PROBE = re.compile(r"(ball|diffuse-ball):(\d+(?:\.\d+)?)(mm|cm|m)(?:,(\w+))?")
_ROD = re.compile(
    r"rod:(\d+(?:\.\d+)?)(mm|cm|m),(\d+(?:\.\d+)?)(mm|cm|m)(?:@(\d+(?:\.\d+)?),(\d+(?:\.\d+)?))?"
)
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


@dataclass(frozen=True)
class Upright:
    """A rod that stands upright on the board."""

    height_mm: float
    diameter_mm: float
    place: tuple[float, float] | None  # of its foot: columns, rows; None: the board's middle corner


def parse(text: str) -> Kind | Upright:
    """Read `ball:60mm[,SURFACE]`, `diffuse-ball:40mm`, `rod:60mm,8mm[@5,4]`; raises UsageError."""
    if text.strip().startswith("rod"):
        return _rod(text)
    found = _PROBE.fullmatch(text.strip())
    surface = (found[4] or "chrome") if found else ""
    is_mirror = bool(found) and found is not None and found[1] == "ball"
    if not found or surface not in SURFACES or (found[4] and not is_mirror):
        raise UsageError(
            f"--probe {text}: expected ball:DIAMETER or ball:DIAMETER,SURFACE of a mirror ball, "
            "diffuse-ball:DIAMETER, rod:HEIGHT,DIAMETER, dodecahedron:EDGE or object:MESH, like "
            f"ball:60mm,black; surfaces: {', '.join(SURFACES)}"
        )
    diameter_mm = float(found[2]) * _MM[found[3]]
    if not _SMALLEST_MM <= diameter_mm <= _LARGEST_MM:
        raise UsageError(
            f"--probe {text}: a diameter is {_SMALLEST_MM:g} mm to {_LARGEST_MM / 1000:g} m"
        )
    return Kind(is_mirror, diameter_mm, surface)


def _rod(text: str) -> Upright:
    found = _ROD.fullmatch(text.strip())
    if not found:
        raise UsageError(
            f"--probe {text}: expected rod:HEIGHT,DIAMETER or rod:HEIGHT,DIAMETER@COLUMN,ROW of "
            "the board's squares, like rod:60mm,8mm@5,4"
        )
    height_mm, diameter_mm = (float(found[at]) * _MM[found[at + 1]] for at in (1, 3))
    if not (_SMALLEST_MM <= height_mm <= _LARGEST_MM and 1 <= diameter_mm <= height_mm / 2):
        raise UsageError(
            f"--probe {text}: a rod is {_SMALLEST_MM:g} mm to {_LARGEST_MM / 1000:g} m high, and "
            "1 mm to half of its height across"
        )
    place = (float(found[5]), float(found[6])) if found[5] else None
    return Upright(height_mm, diameter_mm, place)
