# SPDX-License-Identifier: Apache-2.0
"""Mass of the printed parts as rendered (build/hw/stl), and of all that a headset carries.

A print is a solid wall around an infill. Its mass is taken as that of a wall of WALL_MM all over
the surface, and of INFILL of the rest: a little too much where walls meet. Masses of what is bought
are those of bom.yml, from data sheets or from size and density: nothing was weighed.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import bom
import trimesh
from dimensions import ROOT

PETG_G_CM3 = 1.27
WALL_MM = 1.2  # three lines; guide.md
INFILL = 0.3
#: Printed parts of each box, and how many of each.
HEADSET = {
    "wheel_front": 1,
    "wheel_comb": 1,
    "wheel_back": 1,
    "servo_gear": 1,
    "plate": 1,
    "sensor_carrier": 2,
    "cradle": 1,
    "headset_base": 1,
}
TRIPOD = {name: n for name, n in HEADSET.items() if name != "headset_base"} | {
    "ring_cap": 1,
    "base": 1,
    "ring": 1,
    "lid": 1,
}


@dataclass(frozen=True)
class Mass:
    """Of something, in g: as printed, and if it were solid (bought parts: the same)."""

    what: str
    count: int
    printed_g: float
    solid_g: float


def printed(name: str, count: int) -> Mass:
    """Of a rendered part; OSError when it is not rendered."""
    mesh = trimesh.load_mesh(ROOT / "build" / "hw" / "stl" / f"{name}.stl")
    solid_cm3 = mesh.volume / 1000
    wall_cm3 = min(solid_cm3, mesh.area * WALL_MM / 1000)
    filled_cm3 = wall_cm3 + INFILL * (solid_cm3 - wall_cm3)
    return Mass(name, count, count * filled_cm3 * PETG_G_CM3, count * solid_cm3 * PETG_G_CM3)


def headset() -> list[Mass]:
    """All that is on a headset, but the camera and the cables that leave it."""
    bought = [part for part in bom.load()[0] if part.headset_g]
    return [
        *(printed(name, count) for name, count in HEADSET.items()),
        *(Mass(p.what, p.count, p.count * p.headset_g, p.count * p.headset_g) for p in bought),
    ]


def total(masses: list[Mass]) -> tuple[float, float]:
    """As printed, and solid."""
    return sum(m.printed_g for m in masses), sum(m.solid_g for m in masses)


def table() -> str:
    """Markdown."""
    lines = ["| on a headset | count | g as printed | g solid |", "|---|---|---|---|"]
    masses = headset()
    for m in masses:
        what = f"`{m.what}`" if m.what in HEADSET else m.what
        lines.append(f"| {what} | {m.count} | {m.printed_g:.1f} | {m.solid_g:.1f} |")
    light, solid = total(masses)
    lines.append(f"| **all but the camera and cables** | | **{light:.0f}** | **{solid:.0f}** |")
    light, solid = total([printed(name, count) for name, count in TRIPOD.items()])
    lines.append(f"| compare: all prints with drum and ring | | {light:.0f} | {solid:.0f} |")
    return "\n".join(lines)


def main() -> None:
    """Prints the table; `make hw` first."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    print(table())


if __name__ == "__main__":
    main()
