"""Pictures of the probes that are no box, all in one simulated room: docs/users/probes.jpg.

    build/venv/bin/python tests/accuracy/probe_pictures.py

They are what the tables of docs/users/probes.md are made of: a mirror ball, a white ball, a rod, a
paper dodecahedron, and things whose shape is known, on the printed board, traced by the scripts
beside this one.
"""

from __future__ import annotations

import ball_scene
import dodecahedra
import dodecahedron_scene
import numpy as np
import object_scene
import rod_scene
from lightprobe.probe.dodecahedron import net
from page import ROOT
from PIL import Image

FILE = ROOT / "docs/users/probes.jpg"
ROOM, VIEW = 502, 4
WIDTH, HEIGHT, PART = 640, 480, 320
#: The largest code of what is not a lamp.
BRIGHT = 0.9


def shown(picture) -> Image.Image:
    """A picture for the eye: its lamps may clip."""
    level = BRIGHT / float(np.percentile(picture, 97))
    codes = ball_scene.expose(picture, level, np.random.default_rng(0))
    return Image.fromarray(codes).resize((PART, PART * HEIGHT // WIDTH), Image.Resampling.LANCZOS)


def rendered() -> list[Image.Image]:
    """Mirror ball, white ball, rod, dodecahedron, things."""
    room = ball_scene.room(ROOM, 512)[0]
    board = dodecahedra.BOARD
    found = []
    for surface in ("chrome", "white"):
        scene = ball_scene.Scene(room, board, surface=surface)
        camera = ball_scene.Camera.before(scene, 150, VIEW, WIDTH, HEIGHT)
        found.append(camera.render(scene, 3))
    rod = rod_scene.RodScene(room, board, height_mm=50, radius_mm=4)
    found.append(ball_scene.Camera.before(rod, 20, VIEW, WIDTH, HEIGHT).render(rod, 2))
    solid = dodecahedron_scene.SolidScene(
        room, board, net=dodecahedron_scene.pages(net, 30.0), edge_mm=30.0,
        turn=dodecahedron_scene.lying(3, 0.4),
    )  # fmt: skip
    found.append(ball_scene.Camera.before(solid, 200, VIEW, WIDTH, HEIGHT).render(solid, 2))
    things = object_scene.ObjectScene(room, board, object_scene.still_life(VIEW))
    found.append(things.picture(ball_scene.Camera.before(things, 180, VIEW, WIDTH, HEIGHT))[0])
    return [shown(picture) for picture in found]


def main() -> None:
    """Write them side by side."""
    parts = rendered()
    page = Image.new("RGB", (PART * len(parts), parts[0].height))
    for number, part in enumerate(parts):
        page.paste(part, (PART * number, 0))
    page.save(FILE, quality=88)
    print(f"{FILE.relative_to(ROOT)}: written")


if __name__ == "__main__":
    main()
