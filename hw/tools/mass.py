# SPDX-License-Identifier: Apache-2.0
"""Volume and mass of the printed parts as rendered (build/hw/stl)."""

from __future__ import annotations

import argparse

import trimesh
from dimensions import ROOT

PETG_G_CM3 = 1.27
COPIES = {"sensor_carrier": 2}


def main() -> None:
    """Prints one line per part; masses are of solid plastic, so a real print is lighter."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    total_g = 0.0
    for path in sorted((ROOT / "build" / "hw" / "stl").glob("*.stl")):
        copies = COPIES.get(path.stem, 1)
        volume_cm3 = copies * trimesh.load_mesh(path).volume / 1000
        total_g += volume_cm3 * PETG_G_CM3
        print(f"{path.stem:16} {copies} {volume_cm3:6.1f} cm3 {volume_cm3 * PETG_G_CM3:6.0f} g")
    print(f"all, solid PETG: {total_g:.0f} g at most")


if __name__ == "__main__":
    main()
