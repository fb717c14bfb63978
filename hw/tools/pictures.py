# SPDX-License-Identifier: Apache-2.0
"""The pictures that hw/*.md show, small: from build/hw into hw/."""

from __future__ import annotations

import argparse

from dimensions import HW, ROOT
from PIL import Image

WIDTHS_PX = {
    "box": 700,
    "open": 700,
    "headset": 700,
    "module": 700,
    "wheel": 700,
    "schematic": 2200,
    "schematic_hat": 1000,
    "schematic_panel": 800,
}


def main() -> None:
    """Writes them."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    for name, width_px in WIDTHS_PX.items():
        picture = Image.open(ROOT / "build" / "hw" / f"{name}.png").convert("RGB")
        height_px = round(picture.height * width_px / picture.width)
        picture = picture.resize((width_px, height_px), Image.Resampling.LANCZOS).quantize(128)
        picture.save(HW / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
