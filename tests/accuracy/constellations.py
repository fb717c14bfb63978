"""All light as a number of lights: error against their number, by how the rest is cut.

`python tests/accuracy/constellations.py` prints a table, `--page` puts it into docs/users/trade.md.
Panoramas and rooms go through `lightprobe estimate` (preset accurate, SH of order 4, eight lamps,
area lights); errors are of what an app draws (tests/bench/drawn.py), against the true light.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from lightprobe.estimate import Estimate
from lightprobe.evaluate import offline
from lightprobe.imaging import image
from lightprobe.imaging.constellation import CUTS, constellation
from lightprobe.sim import scenes
from lightprobe.sim.scene import Scene
from page import ROOT, put
from recording import markdown

sys.path.insert(0, str(ROOT / "tests/bench"))
import drawn

PAGE = ROOT / "docs/users/trade.md"
COUNTS = (4, 8, 16, 32, 64)
SCENES = ("room", "procedural:4", "blender")
_SETTINGS = offline.Settings(preset="accurate", sh_order=4, lights=8, area_lights=True)
_DRAWN = ("diffuse", "shadows")

Errors = dict[str, list[float]]  # by what is drawn: one of each scene


def _judged(scene: Scene) -> dict[str, dict[str, float]]:
    """Errors by how the light is given."""
    powers = np.ones(len(scene.lamps))
    picture = scene.render(drawn.WIDTH_PX, drawn.WIDTH_PX // 2).compose(powers)
    truth = drawn.Truth.of(scene.truth(powers).irradiance(drawn.NORMALS), picture)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.pfm"
        image.write_pfm(file, scene.render(1920, 960).compose(powers))
        packet = offline.estimate_pictures([file], settings=_SETTINGS).estimate
    found: dict[str, Estimate] = {"SH of order 4 and lamps": packet}
    for cut in CUTS:
        found |= {f"{count}, {cut} cut": constellation(packet, count, cut)[0] for count in COUNTS}
    return {name: truth.errors(one, None) for name, one in found.items()}


def table() -> str:
    """Markdown: a row for each number of lights and cut."""
    every = [_judged(scene) for scene in scenes.load(SCENES)]
    rows = []
    for name in every[0]:
        errors = {what: 100 * np.array([one[name][what] for one in every]) for what in _DRAWN}
        rows.append([name, *(f"{np.median(e):.2g} ({e.max():.2g})" for e in errors.values())])
    return markdown(["lights", *(f"{what}, %" for what in _DRAWN)], rows) + "\n"


def main() -> None:
    """Print the table, or write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--page", action="store_true", help="write docs/users/trade.md")
    found = table()
    print(found)
    if parser.parse_args().page:
        put(PAGE, {"constellations": found})


if __name__ == "__main__":
    main()
