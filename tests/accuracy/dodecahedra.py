"""A paper dodecahedron as the probe: how exact its lamps are in simulated pictures.

    build/venv/bin/python tests/accuracy/dodecahedra.py --page       # docs/users/probes.md, minutes
    build/venv/bin/python tests/accuracy/dodecahedra.py --scenes 2 --json

The pictures are traced by tests/accuracy/dodecahedron_scene.py, which shares no code with the
estimator: it folds the net as it is printed. Its faces are off by 0.5° at 1 sigma. Pictures of
8 bits. First: rooms with one to three lamps, or a sky with a sun; the solid lies on the board, and
the camera goes around it. Then: one lamp at 38 cm and a little even light, the
solid turned by 20° from picture to picture, glossy paper of a roughness that is known; ours beside
Straughn's average and the rules of Biswas' thesis, which shows these angles as a picture.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import ball_scene
import dodecahedron_scene
import numpy as np
import rods
from lightprobe.calibrate import lens_board
from lightprobe.cli import estimate_solid
from lightprobe.cli.estimate_probe import Options, pinhole_of
from lightprobe.colour import luminance, srgb_table
from lightprobe.errors import LightprobeError
from lightprobe.evaluate import offline
from lightprobe.probe.dodecahedron import faces, light, net, pose, published
from page import ROOT, put
from PIL import Image

PAGE = ROOT / "docs/users/probes.md"
BOARD = lens_board.Board(ball_scene.COLUMNS, ball_scene.ROWS).draw(60)
NORMALS = ball_scene.fibonacci(642)
EDGE_MM, ACROSS_PX, SIZE_PX, FOLD_DEG = 30.0, 230, (1120, 840), 0.5
PLACE_MM = 200.0, 120.0
#: Of white paper on the brightest face, in the codes' scale.
BRIGHTEST = 0.85
#: A lamp counts as found so near: two that are nearer to each other are listed as one.
NEAR_DEG = 60.0
ROUGHNESSES = (0.1, 0.5, 1.0)
#: Of the table of angles: the lamp from the solid's centre, in mm, and its share of even light.
LAMP_MM, EVEN = 380 * np.array([0.48, 0.6, 0.64]), 0.2


@dataclass
class Case:
    """What the pictures of one scene gave."""

    scene: str
    kind: str
    pictures: int
    directions_deg: list[float]
    directions_sigmas: list[float]
    missed: int
    made_up: int
    relighting: float  # MAE, of the largest irradiance
    relighting_sigmas: float  # RMS error over normals, relative to the mean, in stated sigmas
    refused: str = ""


def taken(panorama, seed: int, number: int, sheets):
    """One picture: its scene, and radiance."""
    random = np.random.default_rng(seed)
    turn = dodecahedron_scene.lying(random.integers(12), random.uniform(0, 2 * np.pi))
    scene = dodecahedron_scene.SolidScene(
        panorama, BOARD, ball_mm=PLACE_MM, net=sheets, turn=turn, folds=FOLD_DEG, seed=seed,
        edge_mm=EDGE_MM,
    )  # fmt: skip
    camera = around(scene, random.uniform(0, 360) + 137.5 * number, random)
    return scene, camera, camera.render(scene, 2)


def around(scene, azimuth_deg: float, random):
    """A camera that looks at the solid from that side, from above."""
    azimuth, elevation = np.radians(azimuth_deg), random.uniform(0.45, 0.8)
    focal_px = 0.9 * SIZE_PX[0]
    away = np.array([
        np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)
    ])  # fmt: skip
    eye = scene.centre + 2.6 * EDGE_MM * focal_px / ACROSS_PX * away
    board = ball_scene.SQUARE_MM * np.array([ball_scene.COLUMNS / 2, 0, ball_scene.ROWS / 2])
    back = ball_scene.unit(eye - (0.6 * scene.centre + 0.4 * board))
    right = ball_scene.unit(np.cross([0.0, 1, 0], back))
    return ball_scene.Camera(
        *SIZE_PX, focal_px, eye, np.stack([right, np.cross(back, right), back])
    )


def judge(kind: str, panorama, lamps, seed: int, counts, sheets) -> list[Case]:
    """Render, estimate with the first pictures of each count, and compare with the truth."""
    random = np.random.default_rng(1000 + seed)
    shots = [taken(panorama, seed, number, sheets) for number in range(max(counts))]
    scene, camera, _ = shots[0]
    truth = scene.irradiance(NORMALS)
    cases = []
    with tempfile.TemporaryDirectory() as folder:
        files = []
        for number, (its, _, picture) in enumerate(shots):
            scale = BRIGHTEST * np.pi / dodecahedron_scene.ALBEDO / its.far_irradiance.max()
            files.append((Path(folder) / f"{number}.png", 1e6 * scale))
            Image.fromarray(ball_scene.expose(picture, scale, random)).save(
                files[-1][0], compress_level=1
            )
        for count in counts:
            case = Case(f"{kind} {seed}", kind, count, [], [], 0, 0, np.nan, np.nan)
            cases.append(case)
            options = Options(f"dodecahedron:{EDGE_MM:g}mm", camera.intrinsics, "11x8")
            settings = offline.Settings(preset="accurate", lights=8, sh_order=4)
            try:
                paths, exposures_us = zip(*files[:count], strict=True)
                found = estimate_solid.estimate(paths, exposures_us, settings, options).estimate
            except LightprobeError as error:
                case.refused, case.missed = str(error), len(lamps)
                continue
            compare(case, found, truth, np.array(lamps))
    return cases


def compare(case: Case, found, truth, lamps) -> None:
    """Put errors into a case."""
    made = found.irradiance(NORMALS)
    rms = np.sqrt(np.mean((made - truth).mean(axis=1) ** 2)) / made.mean()  # with its level
    case.relighting_sigmas = float(rms / found.relighting_sigma)
    made = made * (truth.mean() / made.mean())
    case.relighting = float((np.abs(made - truth) / truth.max(axis=0)).mean())
    seen = np.array([one.direction for one in found.lights]).reshape(-1, 3)
    angles = np.degrees(np.arccos(np.clip(lamps @ seen.T, -1, 1)))
    free = set(range(len(seen)))
    for i in np.argsort(angles.min(axis=1)) if len(seen) else []:
        j = min(free, key=lambda at: angles[i, at], default=None)
        if j is not None and angles[i, j] < NEAR_DEG:
            free.discard(j)
            case.directions_deg.append(float(angles[i, j]))
            case.directions_sigmas.append(float(angles[i, j] / found.lights[j].direction_sigma_deg))
    case.missed = len(lamps) - len(case.directions_deg)
    case.made_up = len(free)


def run(count: int, kinds, first: int, counts, sheets) -> list[Case]:
    """All cases."""
    cases = []
    for kind in kinds:
        for seed in range(first, first + count):
            if kind == "sun":
                panorama, lamps = rods.sky(seed, 1024)
            else:
                panorama, lamps = ball_scene.room(seed, lamps=(1, 1) if "one" in kind else (2, 3))
            cases += judge(kind, panorama, lamps, seed, counts, sheets)
            for case in cases[-len(counts) :]:
                print(asdict(case), file=sys.stderr)
    return cases


def table(cases: list[Case]) -> str:
    """Markdown rows."""
    rows = [
        "| light | pictures | scenes, refused | direction, RMSE (worst) | lamps, missed, made up "
        "| relighting, median (worst) | within 3 sigma: directions, light |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for kind, count in dict.fromkeys((case.kind, case.pictures) for case in cases):
        mine = [case for case in cases if (case.kind, case.pictures) == (kind, count)]
        good = [case for case in mine if not case.refused]
        angles = np.array([angle for case in good for angle in case.directions_deg])
        sigmas = np.array([s for case in good for s in case.directions_sigmas])
        relit = np.array([case.relighting for case in good])
        held = np.mean([case.relighting_sigmas < 3 for case in good]) if good else np.nan
        directions = within = "–"
        if len(angles):
            directions = f"{np.sqrt(np.mean(angles**2)):.1f}° ({angles.max():.1f}°)"
            within = f"{100 * np.mean(sigmas < 3):.0f} %"
        missed = sum(case.missed for case in mine)
        rows.append(
            f"| {kind} | {count} | {len(mine)}, {len(mine) - len(good)} | {directions} "
            f"| {len(angles) + missed}, {missed}, {sum(case.made_up for case in good)} "
            f"| {np.median(relit):.3f} ({relit.max():.3f}) | {within}, {100 * held:.0f} % |"
        )
    return "\n".join(rows)


def turned(roughness: float | None, step_deg: int, sheets):
    """Faces of the pictures of a solid that is turned about a level axis: (pose, readings)."""
    found = []
    for number, angle in enumerate(range(0, 360, step_deg)):
        turn = dodecahedron_scene.about(np.array([1.0, 0, 0]), np.radians(angle))
        turn = turn @ dodecahedron_scene.about(np.array([0, 0.6, 0.8]), 0.3)
        lamp = LAMP_MM + np.array([0, 500.0, 0])
        scene = dodecahedron_scene.SolidScene(
            None, BOARD, ball_mm=(0.0, 0.0), height_mm=500.0, net=sheets, turn=turn, seed=1,
            edge_mm=EDGE_MM, roughness=roughness, folds=FOLD_DEG, has_board=False,
            lamps=[(lamp, np.ones(3))], even=np.full(3, EVEN),
        )  # fmt: skip
        eye = scene.centre + np.array([0, 0, 500.0])
        camera = ball_scene.Camera(640, 480, 1152.0, eye, np.eye(3))
        picture = camera.render(scene, 3)
        scale = 0.7 * np.pi / dodecahedron_scene.ALBEDO / (1 + EVEN)
        codes = ball_scene.expose(picture, scale, np.random.default_rng(number))
        pinhole = pinhole_of(camera.intrinsics, Path(), (640, 480))
        where = pose.find(np.asarray(codes @ [0.299, 0.587, 0.114], np.uint8), pinhole)
        read = faces.read(srgb_table()[codes], codes.max(axis=-1) >= 255, pinhole, where, np.eye(3))
        found.append((angle, read.faces))
    return found


def angle_to_lamp(direction) -> float:
    """Degrees from the true lamp."""
    true = LAMP_MM / np.linalg.norm(LAMP_MM)
    return float(np.degrees(np.arccos(np.clip(direction @ true, -1, 1))))


def ours(readings, roughness: float | None) -> tuple[float, float]:
    """Degrees off, and in sigmas; nan: no lamp, or too few faces."""
    try:
        lamps = light.solve(readings, EDGE_MM, roughness).lamps
    except LightprobeError:
        return np.nan, np.nan
    if not lamps:
        return np.nan, np.nan
    best = max(lamps, key=lambda one: one.irradiance.sum())
    off = angle_to_lamp(best.direction)
    return off, off / best.direction_sigma_deg


def of_pose(readings, roughness: float | None) -> list[float]:
    """Degrees off: Straughn's average, the thesis' rules, ours."""
    normals = np.stack([one.normal for one in readings])
    values = luminance(np.stack([one.radiance for one in readings]))
    return [
        angle_to_lamp(published.straughn(normals, values)),
        angle_to_lamp(published.thesis(normals, values)),
        ours(readings, roughness)[0],
    ]


def angles(step_deg: int, sheets, joined=(3, 6)) -> dict:
    """Errors by roughness (None: matt) and pose, and of poses that are joined."""
    found = {}
    for roughness in (None, *ROUGHNESSES):
        poses = turned(roughness, step_deg, sheets)
        single = {angle: of_pose(read, roughness) for angle, read in poses}
        together = {}
        for count in joined:
            apart = len(poses) // count
            sets = [[poses[i + k * apart][1] for k in range(count)] for i in range(apart)]
            together[count] = [ours(tuple(sum(one, ())), roughness) for one in sets]
        found["matt" if roughness is None else roughness] = {"poses": single, "joined": together}
        print(roughness, found["matt" if roughness is None else roughness], file=sys.stderr)
    return found


def angle_table(found: dict) -> str:
    """Markdown rows: a pose each; then the root mean squares, and poses joined."""
    names = [name if name == "matt" else f"roughness {name:g}" for name in found]
    rows = [
        "| turned by | " + " | ".join(f"{name}: Straughn, thesis, ours" for name in names) + " |",
        "| --- |" + " --- |" * len(names),
    ]

    def cell(values) -> str:
        return ", ".join("–" if np.isnan(v) else f"{v:.1f}" for v in values)

    for angle in next(iter(found.values()))["poses"]:
        cells = [cell(one["poses"][angle]) for one in found.values()]
        rows.append(f"| {angle}° | " + " | ".join(cells) + " |")

    def rms(values):
        return np.sqrt(np.nanmean(np.square(np.array(values, float)), axis=0))

    cells = [cell(rms(list(one["poses"].values()))) for one in found.values()]
    rows.append("| all, RMS | " + " | ".join(cells) + " |")
    for count in next(iter(found.values()))["joined"]:
        cells = [cell([rms(one["joined"][count])[0]]) for one in found.values()]
        rows.append(f"| {count} poses joined, RMS: ours | " + " | ".join(cells) + " |")
    return "\n".join(rows)


def main() -> None:
    """Print the tables, or the cases as JSON with --json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=4)
    parser.add_argument("--first", type=int, default=800, help="seed of the first scene (800)")
    parser.add_argument("--kinds", default="sun,room with one lamp,room with more lamps")
    parser.add_argument("--pictures", default="1,3,6", help="pictures that are joined")
    parser.add_argument("--step-deg", type=int, default=20, help="from pose to pose; 0: no poses")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--page", action="store_true", help="write the tables into probes.md")
    options = parser.parse_args()
    sheets = dodecahedron_scene.pages(net, EDGE_MM)
    counts = [int(word) for word in options.pictures.split(",")]
    kinds = options.kinds.split(",") if options.scenes else []
    cases = run(options.scenes, kinds, options.first, counts, sheets)
    found = angles(options.step_deg, sheets) if options.step_deg else {}
    parts = {"dodecahedra": table(cases) + "\n"} if cases else {}
    if found:
        parts["dodecahedra-angles"] = angle_table(found) + "\n"
    if options.page:
        put(PAGE, parts)
    if options.json:
        print(json.dumps({"cases": [asdict(case) for case in cases], "angles": found}))
    else:
        print("\n".join(parts.values()))


if __name__ == "__main__":
    main()
