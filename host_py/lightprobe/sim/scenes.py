"""Which scenes a command means: `room`, `procedural[:N]`, `sky[:ELEVATION]`, `polished:SCENE`, …"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path

from lightprobe.errors import UsageError
from lightprobe.imaging.image import HDR_SUFFIXES
from lightprobe.sim.glossy_rooms import glossy_room
from lightprobe.sim.polarized import PolishedFloor, Sky, StokesPanorama
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.room import Room
from lightprobe.sim.scene import PanoramaScene, Scene

DEFAULT_PROCEDURAL = 20
ENVIRONMENT = "LIGHTPROBE_SCENES"
#: Rooms by number.
_DRAWN: dict[str, Callable[[int], Scene]] = {"procedural": random_scene, "glossy": glossy_room}


def panorama_folder() -> Path:
    """Folder of the CC0 panoramas that `make scenes` unpacks; UsageError when it is not there."""
    named = os.environ.get(ENVIRONMENT)
    here = Path(__file__).resolve()
    tried = [Path(named)] if named else [Path("build/scenes"), here.parents[3] / "build/scenes"]
    for folder in tried:
        if any(folder.glob("*.exr")):
            return folder
    raise UsageError(
        f"scenes: no *.exr in {' or '.join(map(str, tried))}: get them with `make scenes`, "
        f"or name a folder in ${ENVIRONMENT}"
    )


def panorama_files(folder: Path) -> list[Path]:
    """HDR pictures of a folder by name; UsageError when there is none."""
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in HDR_SUFFIXES)
    if not files:
        raise UsageError(f"scenes: {folder}: no {', '.join(sorted(HDR_SUFFIXES))} in it")
    return files


def load(names: Iterable[str]) -> list[Scene]:
    """Load scenes by name, in the order given."""
    scenes: list[Scene] = []
    for name in names:
        kind, _, rest = name.partition(":")
        if kind in _DRAWN:
            scenes += [_DRAWN[kind](seed) for seed in range(_number(name))]
        elif kind == "polished" and rest:
            scenes += [PolishedFloor(scene) for scene in load([rest])]
        elif kind == "sky":
            scenes.append(Sky(_elevation_deg(name)) if rest else Sky())
        elif Path(name).suffix == ".npz":
            scenes.append(StokesPanorama.load(name))
        elif name == "room":
            scenes.append(Room())
        elif name == "blender":
            scenes += [PanoramaScene.load(path) for path in panorama_files(panorama_folder())]
        elif Path(name).is_dir():
            scenes += [PanoramaScene.load(path) for path in panorama_files(Path(name))]
        else:
            scenes.append(PanoramaScene.load(name))
    return scenes


def _number(name: str) -> int:
    text = name.partition(":")[2]
    if not text:
        return DEFAULT_PROCEDURAL
    if not text.isdecimal() or int(text) < 1:
        raise UsageError(f"scenes: {name}: expected {name.partition(':')[0]}:N with N ≥ 1")
    return int(text)


def _elevation_deg(name: str) -> float:
    try:
        elevation_deg = float(name.partition(":")[2])
    except ValueError:
        elevation_deg = 91
    if not -90 <= elevation_deg <= 90:
        raise UsageError(f"scenes: {name}: expected sky:ELEVATION of the sun, −90…90 degrees")
    return elevation_deg
