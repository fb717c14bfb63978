"""An object whose shape is known as the probe: how exact its light is in simulated pictures.

    build/venv/bin/python tests/accuracy/objects.py --page         # docs/users/probes.md, minutes
    build/venv/bin/python tests/accuracy/objects.py --scenes 2 --json

The pictures are traced by tests/accuracy/object_scene.py, which shares no code with the estimator:
two balls and a box on the board, under one to eight square lights, each scene in so many rotations
of its light (float, 1 % noise); or in rooms with one to three lamps (one picture of 8 bits, the
things 0.5 mm off their place and turned by 0.5°, at 1 sigma).
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import ball_scene
import numpy as np
import object_scene
from lightprobe.calibrate import lens_board
from lightprobe.cli import estimate_object
from lightprobe.cli.estimate_probe import Options
from lightprobe.errors import LightprobeError
from lightprobe.evaluate import offline
from lightprobe.imaging import image
from page import ROOT, put
from PIL import Image

PAGE = ROOT / "docs/users/probes.md"
BOARD = lens_board.Board(ball_scene.COLUMNS, ball_scene.ROWS).draw(60)
NORMALS = ball_scene.fibonacci(642)
SIZE_PX, ACROSS_PX = (960, 720), 255
#: Kinds of light: lights of so many sr; rooms.
KINDS = {
    "1 light of 0.1 sr": (1, 0.1), "1 light of 0.3 sr": (1, 0.3), "1 light of 1 sr": (1, 1.0),
    "1 light of 3 sr": (1, 3.0), "2 lights of 0.3 sr": (2, 0.3), "4 lights of 0.3 sr": (4, 0.3),
    "8 lights of 0.3 sr": (8, 0.3), "room": None,
}  # fmt: skip


@dataclass
class Case:
    """What one picture gave."""

    kind: str
    seed: int
    rerender: float = np.nan  # RMSE over the picture of things and board, of its largest value
    light: float = np.nan  # RMSE of radiance above, when the picture's largest value is 1
    light_true: float = np.nan  # RMS of the true radiance, the same
    relighting: float = np.nan  # MAE, of the largest irradiance
    relighting_sigmas: float = np.nan  # RMS error over normals, relative to the mean
    albedo: float = np.nan  # found, over the true one
    took_s: float = np.nan
    refused: str = ""


def lit_by(kind: str, seed: int):
    """A panorama: the same lights in each rotation, or another room."""
    if KINDS[kind] is None:
        return ball_scene.room(seed, 512)[0]
    count, sr = KINDS[kind]
    random = np.random.default_rng(seed)
    return object_scene.area_lights(random, count, sr)


def judge(kind: str, seed: int, folder: Path) -> Case:
    """Render, estimate, and compare with the truth."""
    random = np.random.default_rng(1000 + seed)
    scene = object_scene.ObjectScene(lit_by(kind, seed), BOARD, object_scene.still_life(seed))
    camera = ball_scene.Camera.before(scene, ACROSS_PX, seed, *SIZE_PX)
    picture, thing = scene.picture(camera)
    brightest = float(np.percentile(picture, 99.9))
    at, turn_deg = scene.centre[[0, 2]] / ball_scene.SQUARE_MM, 0.0
    if kind == "room":
        at, turn_deg = at + random.normal(0, 0.5 / ball_scene.SQUARE_MM, 2), random.normal(0, 0.5)
        file, scale = folder / "picture.png", 0.85 / brightest
        Image.fromarray(ball_scene.expose(picture, scale, random)).save(file)
    else:
        file, scale = folder / "picture.pfm", 1.0
        noisy = picture + random.normal(0, 0.01 * brightest, picture.shape)
        image.write_pfm(file, np.maximum(noisy, 0).astype(np.float32))
    scene.mesh().export(folder / "things.glb")
    options = Options(
        f"object:{folder}/things.glb@{at[0]:.4f},{at[1]:.4f},{turn_deg:.3f}", camera.intrinsics,
        square_mm=ball_scene.SQUARE_MM,
    )  # fmt: skip
    case = Case(kind, seed)
    try:
        began_s = time.monotonic()
        light, turn_sigma_deg = estimate_object.find_light([file], (), options)
        case.took_s = time.monotonic() - began_s
        settings = offline.Settings(preset="accurate", lights=8, sh_order=4)
        found = estimate_object.told(light, turn_sigma_deg, settings).estimate
    except LightprobeError as error:
        case.refused = str(error)
        return case
    case.albedo = float(light.albedo.mean() / np.mean(scene.albedo))
    made = light.panorama(256) / scale
    whole = scene.around(256)
    row_sr = ball_scene.panorama_directions(256)[1][:64, None, None]
    share = row_sr / row_sr.sum() / 256 / 3
    case.light = float(np.sqrt((share * (made - whole)[:64] ** 2).sum()) / brightest)
    case.light_true = float(np.sqrt((share * whole[:64] ** 2).sum()) / brightest)
    case.rerender = (
        rerendered(scene, camera, made[::2, ::2], light.albedo, thing, random) / brightest
    )
    truth, now = scene.irradiance(NORMALS) * scale, found.irradiance(NORMALS)
    case.relighting = float((np.abs(now - truth) / truth.max(axis=0)).mean())
    rms = np.sqrt(np.mean((now - truth).mean(axis=1) ** 2)) / truth.mean()
    case.relighting_sigmas = float(rms / found.relighting_sigma)
    return case


def rerendered(scene, camera, light, albedo, thing, random) -> float:
    """RMSE of pixels of things and board in the same scene under the light that was found."""
    again = replace(scene, panorama=np.asarray(light, np.float64), albedo=tuple(albedo))
    y, x = np.nonzero(thing)
    of_things = random.choice(len(x), 1500)
    size = ball_scene.SQUARE_MM * np.array([ball_scene.COLUMNS, ball_scene.ROWS])
    places = random.uniform(0, 1, (1500, 2)) * size
    on_board = np.array([camera.place([u, 0, v]) for u, v in places])
    inside = np.all((on_board > 1) & (on_board < np.array(SIZE_PX) - 1), axis=1)
    at = np.concatenate([np.stack([x, y], axis=1)[of_things] + 0.5, on_board[inside]])
    off = again.shown(camera, *at.T) - scene.shown(camera, *at.T)
    return float(np.sqrt(np.mean(off**2)))


def run(count: int, kinds, first: int) -> list[Case]:
    """All cases."""
    cases = []
    with tempfile.TemporaryDirectory() as folder:
        for kind in kinds:
            for seed in range(first, first + count):
                cases.append(judge(kind, seed, Path(folder)))
                print(asdict(cases[-1]), file=sys.stderr, flush=True)
    return cases


def table(cases: list[Case]) -> str:
    """Markdown rows."""
    rows = [
        "| light | pictures, refused | re-render, RMSE | light, RMSE (RMS of the truth) "
        "| relighting, median (worst) | albedo, RMS error | within 3 sigma |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]

    def rms(values) -> float:
        return float(np.sqrt(np.mean(np.square(values))))

    for kind in dict.fromkeys(case.kind for case in cases):
        mine = [case for case in cases if case.kind == kind]
        good = [case for case in mine if not case.refused]
        if not good:
            rows.append(f"| {kind} | {len(mine)}, {len(mine)} | | | | | |")
            continue
        light = [case.relighting for case in good]
        rows.append(
            f"| {kind} | {len(mine)}, {len(mine) - len(good)} "
            f"| {rms([case.rerender for case in good]):.3f} "
            f"| {rms([case.light for case in good]):.2f} "
            f"({rms([case.light_true for case in good]):.2f}) "
            f"| {np.median(light):.3f} ({max(light):.3f}) "
            f"| {100 * rms([case.albedo - 1 for case in good]):.0f} % "
            f"| {100 * np.mean([case.relighting_sigmas < 3 for case in good]):.0f} % |"
        )
    return "\n".join(rows)


def main() -> None:
    """Print the table, or the cases as JSON with --json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=10, help="pictures of each kind (10)")
    parser.add_argument("--first", type=int, default=700, help="seed of the first scene (700)")
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--page", action="store_true", help="write the table into probes.md")
    options = parser.parse_args()
    cases = run(options.scenes, options.kinds.split(","), options.first)
    if options.page:
        put(PAGE, {"objects": table(cases) + "\n"})
    print(json.dumps([asdict(case) for case in cases]) if options.json else table(cases))


if __name__ == "__main__":
    main()
