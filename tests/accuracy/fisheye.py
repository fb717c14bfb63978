"""How good still estimates by fisheye lenses are, beside an equirectangular camera's.

Part of `make accuracy`. Procedural rooms, as report.py has them: one stream with two circles, two
modules with a picture each, and lenses that are dark at their rims, with and without the roll-off
that `lightprobe calibrate roll-off` finds in another scene. ROOMS take ten minutes:

    build/venv/bin/python tests/accuracy/fisheye.py
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import recording
from judge import HARMLESS, STATED, WRONG
from lightprobe import daemon
from lightprobe.calibrate import camera_file, roll_off, turned_pictures
from lightprobe.errors import LightprobeError
from lightprobe.estimate import Estimate, EstimateFlag
from lightprobe.evaluate import evaluation, metrics
from lightprobe.evaluate.evaluation import Input
from lightprobe.imaging import camera as lenses
from lightprobe.imaging.camera import Camera, Lens
from lightprobe.sim import scenes
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.scene import Scene
from lightprobe.sim.world import Behaviour, World
from recording import MODULES, markdown

ROOT = Path(__file__).resolve().parents[2]
DUAL, DUAL_PX = ROOT / "packaging/cameras/insta360_air.camera", (1472, 736)
MODULE_PX = 1040, 1040
#: Kinds of cameras by name: what the table calls them, files, and the size of each picture.
EQUIRECT = {
    "large": ("equirectangular, 1920×960", (1920, 960)),
    "small": ("equirectangular, 1344×672, as many pixels to a degree as the next", (1344, 672)),
}
WORDS = {
    **{name: words for name, (words, _) in EQUIRECT.items()},
    "dual": "one stream with two circles, 1472×736",
    "modules": "two modules, 1040×1040 each",
    "unknown": "one stream, rims at 19 %, the file does not say",
    "calibrated": "one stream, rims at 19 %, as calibrated",
}
ROOMS = 20
INPUTS = ("unclipped", "3")
DARK_INPUTS = ("3",)
#: The size of the panorama whose median and maximum tell exposures, of all cameras.
EXPOSED_FOR_PX = (1920, 960)
#: A camera of two circles may have a gap between them.
PARTIAL = EstimateFlag.PARTIAL_VIEW
#: What turns before the lenses to calibrate their roll-off: pictures, and degrees between them.
TURNS, TURN_DEG, TURNED_PX = 24, 15.0, (1088, 544)


@dataclass(frozen=True, eq=False)
class DarkLens(Lens):
    """Falls off by the fourth power of the cosine of half the angle, which is no polynomial."""

    def illumination(self, theta: object) -> lenses.Array:
        """See :class:`Lens`."""
        return np.asarray(np.cos(np.asarray(theta, np.float64) / 2) ** 4)


@dataclass(frozen=True)
class Still:
    """One scene before one kind of camera."""

    scene: str
    camera: str
    input: str
    relighting_mae: float
    missed: int
    false: int
    angles_deg: tuple[float, ...]
    wrong_and_healthy: bool


def darkened(camera: Camera) -> Camera:
    """The same camera with lenses that are dark at their rims."""
    fields = ("centre_px", "focal_px", "k", "max_theta_deg", "rotation_wxyz")
    dark = [DarkLens(**{name: getattr(lens, name) for name in fields}) for lens in camera.lenses]
    return replace(camera, lenses=tuple(dark))


def calibrated(folder: Path) -> Path:
    """A camera file of the dark lenses, as `lightprobe calibrate roll-off` makes it."""
    known, path = lenses.load(str(DUAL)), folder / "calibrated.camera"
    path.write_text(DUAL.read_text())
    scene = scenes.load([str(ROOT / "build/scenes/interior.exr")])[0].scaled(30.0)
    behaviour = Behaviour(act_s=0, turn_deg_s=TURN_DEG)
    taking = SimulatedCamera(
        World([scene], behaviour), darkened(known), TURNED_PX, rate_hz=1.0, quality=92
    )
    shot = Shot(2 * taking.automatic(0)[0].exposure_us)
    pictures = []
    for number in range(TURNS):
        jpeg = np.frombuffer(taking.frame(number, shot), np.uint8)
        pictures.append(np.ascontiguousarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR)[..., ::-1]))
    names = [f"picture {number}" for number in range(TURNS)]
    numbers, turned = turned_pictures.rotations(pictures, known, names)
    pictures = [pictures[number] for number in numbers]
    for number in range(len(known.lenses)):
        found = roll_off.fit(pictures, turned, known, number)
        value = ", ".join(f"{a:.6g}" for a in found.rolloff)
        camera_file.save(path, DUAL_PX, f"lens.{number}", {"rolloff": value})
    return path


class Shoot:
    """Cameras before one scene; each renders it once, so they are kept for all exposures."""

    def __init__(self, scene: Scene, seen: Sequence[tuple[Camera, tuple[int, int]]]) -> None:
        """`seen`: cameras as they are, and the size of their pictures."""
        world = World([scene], Behaviour(act_s=0))
        self._cameras = [
            SimulatedCamera(world, camera, size_px, seed=number)
            for number, (camera, size_px) in enumerate(seen)
        ]

    def estimate(self, exposures_us: Sequence[float], files: Sequence[str]) -> Estimate:
        """Take a picture for each exposure, and estimate with these camera files."""
        arguments, query = [], ",".join(f"{us:.9g}" for us in exposures_us)
        with tempfile.TemporaryDirectory(prefix="lightprobe-") as name:
            for number, (camera, file) in enumerate(zip(self._cameras, files, strict=True)):
                folder = Path(name) / str(number)
                folder.mkdir()
                for index, exposure_us in enumerate(exposures_us):
                    jpeg = camera.frame(index, Shot(exposure_us))
                    (folder / f"{index:04}.jpg").write_bytes(jpeg)
                arguments += [f"--source=file:{folder}?exposures_us={query}", f"--camera={file}"]
            return daemon.run_once(arguments, timeout_s=600).estimate


def shoots(
    scene: Scene, found: str
) -> Iterator[tuple[Shoot, tuple[str, ...], dict[str, list[str]]]]:
    """Give cameras before a scene, inputs, and by kind of camera the files that describe them.

    `found`: the file with the calibrated roll-off.
    """
    for kind, (_, size_px) in EQUIRECT.items():
        yield Shoot(scene, [(lenses.equirect(*size_px), size_px)]), INPUTS, {kind: ["equirect"]}
    modules = [str(file) for file in MODULES]
    pair = Shoot(scene, [(lenses.load(file), MODULE_PX) for file in modules])
    yield pair, INPUTS, {"modules": modules}
    known = lenses.load(str(DUAL))
    yield Shoot(scene, [(known, DUAL_PX)]), INPUTS, {"dual": [str(DUAL)]}
    dark = Shoot(scene, [(darkened(known), DUAL_PX)])
    yield dark, DARK_INPUTS, {"unknown": [str(DUAL)], "calibrated": [found]}


def seems_fine(estimate: Estimate) -> bool:
    """Tell whether an app has no reason to doubt: no flag, and a small sigma."""
    stated = metrics.stated_error(estimate)
    return stated is not None and stated < STATED and not estimate.flags & ~(HARMLESS | PARTIAL)


def judged(case: tuple[int, str]) -> list[Still]:
    """Every kind of camera before one procedural room (its seed); and the calibrated file."""
    seed, found = case
    scene, stills = random_scene(seed), []
    reference = evaluation.reference(scene)
    radiance = scene.render(*EXPOSED_FOR_PX).compose(np.ones(len(scene.lamps)))
    for shoot, inputs, kinds in shoots(scene, found):
        for name, (kind, files) in product(inputs, kinds.items()):
            estimate = shoot.estimate(Input.parse(name).exposures_us(radiance), files)
            score = reference.score(estimate)
            angles_deg = tuple(match.angle_deg for match in score.matches)
            wrong = score.relighting_mae > WRONG and seems_fine(estimate)
            stills.append(
                Still(scene.name, kind, name, score.relighting_mae, score.missed, score.false,
                      angles_deg, wrong)
            )  # fmt: skip
    return stills


def all_figures(count: int, processes: int = 2) -> list[Still]:
    """All kinds before so many rooms; progress on stderr."""
    with tempfile.TemporaryDirectory(prefix="lightprobe-") as name:
        found = str(calibrated(Path(name)))
        todo = [(seed, found) for seed in range(count)]
        return recording.all_figures("fisheye", judged, todo, lambda one: one.scene, processes)


HEAD = [
    "input", "camera", "light on a white sphere, median (worst)", "lamp direction, RMSE (worst)",
    "missed, made up", "more than 10 % wrong, and neither flag nor sigma says so",
]  # fmt: skip


def rows(stills: Sequence[Still]) -> list[list[str]]:
    """Table over scenes."""
    table = []
    for name in reversed(INPUTS):
        for kind, words in WORDS.items():
            some = [one for one in stills if (one.camera, one.input) == (kind, name)]
            if not some:
                continue
            light = [one.relighting_mae for one in some]
            angles = np.array([angle for one in some for angle in one.angles_deg])
            table.append([
                name, words, f"{np.median(light):.4f} ({max(light):.4f})",
                f"{np.sqrt(np.mean(angles**2)):.3f}° ({angles.max():.2f}°)",
                f"{sum(one.missed for one in some)}, {sum(one.false for one in some)}",
                f"{sum(one.wrong_and_healthy for one in some)}",
            ])  # fmt: skip
    return table


def main() -> None:
    """Print the table, or all figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--procedural", type=int, default=ROOMS, metavar="N", help="rooms")
    parser.add_argument("--processes", type=int, default=2, metavar="N")
    parser.add_argument("--json", action="store_true", help="every room's figures")
    options = parser.parse_args()
    stills = all_figures(options.procedural, options.processes)
    if options.json:
        print(json.dumps([asdict(one) for one in stills], indent=2))
    else:
        print(markdown(HEAD, rows(stills)))


if __name__ == "__main__":
    try:
        main()
    except LightprobeError as error:
        raise SystemExit(f"fisheye: {error}") from None
