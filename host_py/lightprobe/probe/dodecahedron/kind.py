"""What `--probe dodecahedron:…` says: its edge, and its paper."""

from __future__ import annotations

import re
from dataclasses import dataclass

from lightprobe.errors import UsageError

NAME = "dodecahedron"
_SOLID = re.compile(NAME + r":(\d+(?:\.\d+)?)(mm|cm|m)(?:,roughness=(\d+(?:\.\d+)?|fit))?")
_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
_SMALLEST_MM, _LARGEST_MM = 5.0, 1000.0
_LEAST_ROUGHNESS = 0.05


@dataclass(frozen=True)
class Kind:
    """A dodecahedron that is the probe."""

    edge_mm: float
    roughness: float | None = None  # of a coat, 0.05…1; None: matt paper
    fits_roughness: bool = False  # it is found by the pictures


def parse(text: str) -> Kind:
    """Read `dodecahedron:30mm`, also with `,roughness=0.5` or `fit`; raises UsageError."""
    found = _SOLID.fullmatch(text.strip())
    if not found:
        raise UsageError(
            f"--probe {text}: expected dodecahedron:EDGE, like dodecahedron:30mm; of glossy paper "
            "also its roughness, dodecahedron:30mm,roughness=0.5 or =fit"
        )
    edge_mm = float(found[1]) * _MM[found[2]]
    if not _SMALLEST_MM <= edge_mm <= _LARGEST_MM:
        raise UsageError(
            f"--probe {text}: an edge is {_SMALLEST_MM:g} mm to {_LARGEST_MM / 1000:g} m"
        )
    if found[3] in (None, "fit"):
        return Kind(edge_mm, None, found[3] == "fit")
    roughness = float(found[3])
    if not _LEAST_ROUGHNESS <= roughness <= 1:
        raise UsageError(f"--probe {text}: a roughness is {_LEAST_ROUGHNESS:g} to 1")
    return Kind(edge_mm, roughness)
