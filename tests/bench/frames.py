"""Pictures to time: the repository's scenes through the simulated camera, textured like real ones.

Panoramas are 1024 pixels wide and frames are wider: resampled, they would be smoother than what a
camera sees, and a JPEG of them too easy to read. Pictures of the world have the same contrast in
every octave of spatial frequency (their amplitude falls as 1/f: Field 1987, "Relations between the
statistics of natural images and the response properties of cortical cells"), so each octave beyond
the map's own is filled with noise that has the local contrast of the map's finest one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from lightprobe.imaging import camera
from lightprobe.sim import scenes
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.exposure import bracket_us, median_luminance
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.room import Room
from lightprobe.sim.scene import PanoramaScene, Scene, resize
from lightprobe.sim.world import Behaviour, World
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
CAMERAS = ROOT / "packaging" / "cameras"
#: Two circles in one picture.
FISHEYE, LARGE_FISHEYE = CAMERAS / "theta_s.camera", CAMERAS / "insta360_air.camera"
#: A camera's lens and demosaicing take this part of the contrast at its finest octave.
LENS_CONTRAST = 0.5
#: How fast the camera turns where that is timed.
TURN_DEG_S = 30.0
#: Exposures of a bracket: each so many times as short as the one before (as in pipelines.cpp).
EXPOSURES, EXPOSURE_STEP = 4, 16

Map = NDArray[np.float32]


@dataclass(frozen=True)
class Kind:
    """A size, a lens and a chroma subsampling."""

    name: str
    width_px: int
    height_px: int
    camera: str
    chroma: str
    quality: int


def _kinds() -> Iterator[Kind]:
    for chroma, quality in (("420", 85), ("422", 90)):
        yield Kind(f"dual_fisheye_1280x720_{chroma}", 1280, 720, str(FISHEYE), chroma, quality)
        yield Kind(f"equirect_1920x960_{chroma}", 1920, 960, "equirect", chroma, quality)
        yield Kind(f"equirect_3840x1920_{chroma}", 3840, 1920, "equirect", chroma, quality)
    yield Kind("equirect_960x480_420", 960, 480, "equirect", "420", 85)
    yield Kind("dual_fisheye_2176x1088_420", 2176, 1088, str(LARGE_FISHEYE), "420", 85)


KINDS = {kind.name: kind for kind in _kinds()}


def texture(coarse: Map, width_px: int, height_px: int, rng: np.random.Generator) -> Map:
    """Resample a radiance map (H, W, 3) and fill the octaves that it has no samples for."""
    fine = resize(coarse, width_px, height_px)
    grey = np.log(np.maximum(coarse.mean(axis=-1), 1e-6))
    finest = grey - cv2.GaussianBlur(grey, (0, 0), 1.0)
    local = np.sqrt(cv2.GaussianBlur(finest**2, (0, 0), 4.0))
    # A lamp's edge is no texture.
    local = np.minimum(local, 3 * np.median(local) + 0.02)
    contrast = resize(np.repeat(local[..., None], 3, -1).astype(np.float32), width_px, height_px)
    width, detail = coarse.shape[1], np.zeros((height_px, width_px), np.float32)
    while width < width_px:
        width = min(2 * width, width_px)
        noise = rng.standard_normal((width // 2, width), dtype=np.float32)
        noise -= cv2.GaussianBlur(noise, (0, 0), 1.0)
        noise /= noise.std()
        share = LENS_CONTRAST if width == width_px else 1.0
        detail += share * cv2.resize(noise, (width_px, height_px), interpolation=cv2.INTER_CUBIC)
    return np.asarray(fine * np.exp(detail[..., None] * contrast), dtype=np.float32)


def subjects(quick: bool) -> list[Scene]:
    """Scenes that are timed: real rooms and skies, the furnished room, five lamps on a gradient."""
    if quick:
        return [Room(), random_scene(4)]
    return [*scenes.load(["blender"]), Room(), random_scene(4)]


def shoot(
    kind: Kind, scene: Scene, seed: int, count: int = 1, turn_deg_s: float = 0, shorter: int = 0
) -> list[bytes]:
    """Successive JPEGs of a scene, with the sensor's noise: exposed for its median, or shorter.

    shorter: number of EXPOSURE_STEPs.
    """
    lens = camera.load(kind.camera)
    # a lens samples a map finer than its own pixels
    scale = 1 if lens.is_equirect else 2
    width_px = scale * kind.width_px
    if isinstance(scene, PanoramaScene):
        rng = np.random.default_rng([seed, 0xBE7C])
        scene = PanoramaScene.of(scene.name, texture(scene.radiance, width_px, width_px // 2, rng))
    radiance = scene.render(512, 256).compose(np.ones(len(scene.lamps)))
    (exposure_us,) = bracket_us(median_luminance(radiance), 1)
    size_px = (kind.width_px, kind.height_px)
    behaviour = Behaviour(act_s=0, turn_deg_s=turn_deg_s)
    shooting = SimulatedCamera(
        World([scene], behaviour), lens, size_px,
        quality=kind.quality, chroma=kind.chroma, seed=seed,
    )  # fmt: skip
    exposure_us /= EXPOSURE_STEP**shorter
    return [shooting.frame(number, Shot(exposure_us)) for number in range(count)]


def shoot_bracket(kind: Kind, scene: Scene, seed: int, file: Path) -> None:
    """Write a picture, and beside it the shorter exposures, each when it is not there yet."""
    for k in range(EXPOSURES):
        path = file.with_suffix(f".exposure{k}.jpg") if k else file
        if not path.exists():
            path.write_bytes(shoot(kind, scene, seed, shorter=k)[0])


def make(kind: Kind, folder: Path, subjects: Sequence[Scene]) -> list[Path]:
    """Files of one kind, one for each scene, beside its shorter exposures: made when missing."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for seed, scene in enumerate(subjects):
        path = folder / f"{kind.name}-{scene.name}.jpg"
        shoot_bracket(kind, scene, seed, path)
        files.append(path)
    return files


def make_turning(kind: Kind, folder: Path, scene: Scene, seed: int, count: int) -> list[Path]:
    """Files of a camera that turns at TURN_DEG_S, made when they are not there yet."""
    files = [folder / f"{kind.name}-{scene.name}-turning{number}.jpg" for number in range(count)]
    if not all(file.exists() for file in files):
        folder.mkdir(parents=True, exist_ok=True)
        for file, jpeg in zip(files, shoot(kind, scene, seed, count, TURN_DEG_S), strict=True):
            file.write_bytes(jpeg)
    return files
