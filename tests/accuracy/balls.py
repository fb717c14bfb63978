"""Balls as probes: how exact they are in simulated pictures, and whether their sigmas hold.

    build/venv/bin/python tests/accuracy/balls.py                   # docs/users/probes.md, minutes
    build/venv/bin/python tests/accuracy/balls.py --scenes 2 --kinds mirror

The pictures are traced by tests/accuracy/ball_scene.py, which shares no code with the estimator:
rooms with one to three lamps, or panoramas (--panoramas FOLDER); a ball on a board, seen by an
ordinary camera from a random side. Direction, and relighting as in docs/users/accuracy.md: mean
absolute error of irradiance over 642 normals, of its largest value.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import ball_scene
import numpy as np
from lightprobe.calibrate import lens_board
from lightprobe.cli import estimate_probe
from lightprobe.errors import LightprobeError
from lightprobe.evaluate import offline
from lightprobe.imaging import image
from PIL import Image

BOARD = lens_board.Board(ball_scene.COLUMNS, ball_scene.ROWS).draw(60)
NORMALS = ball_scene.fibonacci(642)
#: Three exposures of a bracket, each 4 stops shorter.
EXPOSURES_US = (160000.0, 10000.0, 625.0)


@dataclass(frozen=True)
class Kind:
    """One row of the table."""

    name: str
    surface: str
    diameter_px: int
    picture: str  # float, or three exposures
    probe: str
    board: str = "11x8"


KINDS = {
    "mirror": Kind("mirror, chrome, 200 px", "chrome", 200, "float", "ball:60mm"),
    "black": Kind("mirror, black, 200 px", "black", 200, "float", "ball:60mm,black"),
    "bracket": Kind("mirror, chrome, 200 px", "chrome", 200, "three exposures", "ball:60mm"),
    "small": Kind("mirror, chrome, 50 px", "chrome", 50, "float", "ball:60mm", "none"),
    "diffuse": Kind("diffuse, 200 px", "white", 200, "float", "diffuse-ball:60mm"),
    "diffuse-codes": Kind("diffuse, 200 px", "white", 200, "one exposure", "diffuse-ball:60mm"),
}


@dataclass
class Case:
    """What one picture gave."""

    scene: str
    kind: str
    relighting: float  # MAE, of the largest irradiance
    relighting_sigmas: float  # RMS error over normals, relative to the mean, in stated sigmas
    directions_deg: list[float]
    directions_sigmas: list[float]
    missed: int
    made_up: int
    refused: str = ""


def scenes(count: int, folder: Path | None, first: int):
    """Name, panorama and true lamps (None: not known) of each scene."""
    if folder is not None:
        for file in sorted([*folder.glob("*.hdr"), *folder.glob("*.exr")])[:count]:
            panorama = np.asarray(image.read(file).radiance, np.float64)
            step = max(1, panorama.shape[1] // 1024)
            rows = panorama.shape[0] // step * step
            small = panorama[:rows, : panorama.shape[1] // step * step]
            small = small.reshape(rows // step, step, -1, step, 3).mean(axis=(1, 3))
            yield file.stem, small, None
        return
    for seed in range(first, first + count):
        panorama, lamps = ball_scene.room(seed)
        yield f"room {seed}", panorama, lamps


def write(kind: Kind, picture, scene, folder: Path, seed: int):
    """Write the pictures of a case; files and exposures."""
    random = np.random.default_rng(seed)
    middle = float(np.median(picture))
    if kind.picture == "float":
        file = folder / "picture.pfm"
        image.write_pfm(file, picture * random.uniform(0.5, 2))
        return [file], ()
    if kind.picture == "one exposure":
        x, y = scene.camera.place(scene.scene.centre)
        part = picture[int(y) - 90 : int(y) + 90, int(x) - 90 : int(x) + 90]
        file = folder / "picture.png"
        codes = ball_scene.expose(picture, 0.9 / part.max(), random)
        Image.fromarray(codes).save(file)
        return [file], ()
    files = []
    for exposure_us in EXPOSURES_US:
        files.append(folder / f"{exposure_us:.0f}.png")
        scale = 0.25 / middle * exposure_us / EXPOSURES_US[0]
        Image.fromarray(ball_scene.expose(picture, scale, random)).save(files[-1])
    return files, EXPOSURES_US


@dataclass
class Set:
    """Scene and camera together."""

    scene: ball_scene.Scene
    camera: ball_scene.Camera


def render(kind: Kind, panorama, seed: int):
    """Scene, camera and radiance of a case."""
    scene = ball_scene.Scene(panorama, BOARD, surface=kind.surface)
    camera = ball_scene.Camera.before(scene, kind.diameter_px, seed, 800, 600)
    return Set(scene, camera), camera.render(scene, 5)


def judge(kind: Kind, name: str, rendered: Set, picture, lamps, seed: int) -> Case:
    """Estimate, and compare with the truth."""
    truth = rendered.scene.irradiance(NORMALS)
    x, y = rendered.camera.place(rendered.scene.centre)
    options = estimate_probe.Options(
        kind.probe, rendered.camera.intrinsics, kind.board, ball_scene.SQUARE_MM,
        f"{x + 1:.1f},{y - 1:.1f},{kind.diameter_px / 2:.1f}" if kind.board == "none" else None,
    )  # fmt: skip
    # Without a board, the frame is the camera's.
    turn = rendered.camera.axes if kind.board == "none" else np.eye(3)
    with tempfile.TemporaryDirectory() as folder:
        files, exposures = write(kind, picture, rendered, Path(folder), seed)
        try:
            settings = offline.Settings(preset="accurate", lights=8, sh_order=4)
            once = estimate_probe.estimate(files, exposures, settings, options)
        except LightprobeError as error:
            return Case(name, kind.name, np.nan, np.nan, [], [], len(lamps or ()), 0, str(error))
    found = once.estimate
    made = found.irradiance(NORMALS @ turn.T)
    made = made * (truth.mean() / made.mean())  # no scale is known of these pictures
    off = np.abs(made - truth) / truth.max(axis=0)
    rms = np.sqrt(np.mean((made - truth).mean(axis=1) ** 2)) / truth.mean()
    case = Case(
        name, kind.name, float(off.mean()), float(rms / found.relighting_sigma), [], [], 0, 0
    )
    if lamps is None:
        return case
    true, seen = np.array(lamps) @ turn.T, np.array([light.direction for light in found.lights])
    if not len(seen):
        case.missed = len(true)
        return case
    cosine = np.clip(true @ seen.T, -1, 1)
    angles = np.degrees(np.arccos(cosine))
    limit = 45.0 if kind.surface == "white" else 12.0
    for i in range(len(true)):
        j = int(angles[i].argmin())
        if angles[i, j] < limit:
            case.directions_deg.append(float(angles[i, j]))
            case.directions_sigmas.append(float(angles[i, j] / found.lights[j].direction_sigma_deg))
        else:
            case.missed += 1
    case.made_up = max(len(seen) - len(case.directions_deg), 0)
    return case


def run(count: int, names, folder: Path | None, first: int) -> list[Case]:
    """All cases."""
    cases = []
    for number, (name, panorama, lamps) in enumerate(scenes(count, folder, first)):
        pictures: dict[tuple[str, int], tuple] = {}
        for key in names:
            kind = KINDS[key]
            of = kind.surface, kind.diameter_px
            if of not in pictures:
                pictures[of] = render(kind, panorama, number)
            rendered, picture = pictures[of]
            cases.append(judge(kind, name, rendered, picture, lamps, number))
            cases[-1].kind = f"{kind.name} | {kind.picture}"
            print(asdict(cases[-1]), file=sys.stderr)
    return cases


def table(cases: list[Case]) -> str:
    """Markdown rows."""
    rows = [
        "| probe | picture | pictures, refused | direction, RMSE (worst) | missed lamps "
        "| relighting, median (worst) | within 3 sigma: directions, light |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for kind in dict.fromkeys(case.kind for case in cases):
        mine = [case for case in cases if case.kind == kind]
        good = [case for case in mine if not case.refused]
        angles = np.array([angle for case in good for angle in case.directions_deg])
        sigmas = np.array([s for case in good for s in case.directions_sigmas])
        light = np.array([case.relighting for case in good])
        if not good:
            rows.append(f"| {kind} | {len(mine)}, {len(mine)} | – | – | – | – |")
            continue
        held = np.mean([case.relighting_sigmas < 3 for case in good])
        lamps = f"{np.sqrt(np.mean(angles**2)):.2f}° ({angles.max():.2f}°)" if len(angles) else "–"
        within = f"{100 * np.mean(sigmas < 3):.0f} %" if len(sigmas) else "–"
        rows.append(
            f"| {kind} | {len(mine)}, {len(mine) - len(good)} | {lamps} "
            f"| {sum(case.missed for case in good)} | {np.median(light):.3f} ({light.max():.3f}) "
            f"| {within}, {100 * held:.0f} % |"
        )
    return "\n".join(rows)


def main() -> None:
    """Print the table, and the cases as JSON with --json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=12)
    parser.add_argument("--first", type=int, default=500, help="seed of the first room (500)")
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--panoramas", type=Path)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    cases = run(options.scenes, options.kinds.split(","), options.panoramas, options.first)
    print(json.dumps([asdict(case) for case in cases]) if options.json else table(cases))


if __name__ == "__main__":
    main()
