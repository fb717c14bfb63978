"""Scenes × settings → scores: what `lightprobe evaluate` and the accuracy tests run.

A scene reaches the daemon as a float map, or as 8-bit JPEG frames of the simulated camera (noise,
saturation, response): one exposure that does not clip, or a bracket of exposures four stops apart
of which the first puts the scene's median at a quarter of full scale.
"""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry
from lightprobe.daemon import DaemonError
from lightprobe.errors import UsageError
from lightprobe.evaluate import offline
from lightprobe.evaluate.metrics import Reference, Score
from lightprobe.evaluate.ring_model import RingModel
from lightprobe.imaging import image
from lightprobe.sim.exposure import bracket_us, median_luminance
from lightprobe.sim.scene import PanoramaScene, Scene, has_exact_lamps
from lightprobe.sim.sensor import Sensor, encode_jpeg

SIZE_PX = (1920, 960)
UNCLIPPED_AT = 0.9
MOST_EXPOSURES = 8


@dataclass(frozen=True)
class Input:
    """How a scene reaches the daemon: `float`, `unclipped`, or a number of exposures."""

    name: str

    @classmethod
    def parse(cls, text: str) -> Input:
        """Read one word of `--brackets`; raises UsageError."""
        number = text.isdecimal() and 1 <= int(text) <= MOST_EXPOSURES
        if text in ("float", "unclipped") or number:
            return cls(text)
        raise UsageError(
            f"evaluate: --brackets {text}: expected float, unclipped, or "
            f"1…{MOST_EXPOSURES} exposures"
        )

    def exposures_us(self, radiance: NDArray[np.float32]) -> list[float]:
        """Exposures of the frames; none for floats."""
        if self.name == "float":
            return []
        if self.name == "unclipped":
            return [1e6 * UNCLIPPED_AT / float(radiance.max())]
        median = median_luminance(radiance)
        if median <= 0:
            raise UsageError("evaluate: half of the scene is black: no exposure suits its median")
        return bracket_us(median, int(self.name))


@dataclass(frozen=True)
class Case:
    """One scene, one input, one setting."""

    scene: str
    input: str
    settings: str
    score: Score | None  # None: no estimate
    error: str | None = None


def reference(scene: Scene) -> Reference:
    """Truth of a scene with all lamps at full power."""
    truth = scene.truth(np.ones(len(scene.lamps)))
    lamps = truth.lamps if has_exact_lamps(scene) else None
    return Reference(truth.irradiance(geometry.sphere_normals()), truth.total, lamps)


class Studio:
    """Makes frames of scenes; one sensor (and its noise) for all of them."""

    def __init__(self, seed: int = 0, response: geometry.Array | None = None) -> None:
        """Sensors are made when first needed, one per thread that works.

        `response`: linear light (256, 3) of each code; None: sRGB.
        """
        self._seed, self._response = seed, response
        self._local = threading.local()

    def shoot(self, scene: Scene, how: Input, folder: Path) -> list[float]:
        """Write the frames of a scene into `folder`; returns their exposures."""
        if how.name == "float" and isinstance(scene, PanoramaScene):
            image.write_pfm(folder / "0000.pfm", scene.radiance)
            return []
        radiance = scene.render(*SIZE_PX).compose(np.ones(len(scene.lamps)))
        exposures_us = how.exposures_us(radiance)
        if not exposures_us:
            image.write_pfm(folder / "0000.pfm", radiance)
        for index, exposure_us in enumerate(exposures_us):
            codes = self._sensor().capture(radiance, exposure_us, frame=index)
            (folder / f"{index:04}.jpg").write_bytes(encode_jpeg(codes))
        return exposures_us

    def _sensor(self) -> Sensor:
        if not hasattr(self._local, "sensor"):
            self._local.sensor = Sensor(*SIZE_PX, response=self._response, seed=self._seed)
        sensor: Sensor = self._local.sensor
        return sensor


def evaluate(
    scenes: Sequence[Scene],
    settings: dict[str, offline.Settings],
    inputs: Iterable[Input],
    *,
    seed: int = 0,
    response: geometry.Array | None = None,
    ring_model: RingModel | None = None,
    rings: Mapping[str, RingModel | None] | None = None,
    jobs: int = 2,
    progress: Callable[[Case], None] = lambda case: None,
) -> list[Case]:
    """Run every scene with every input and setting; `progress` is called from worker threads.

    `response`: of the simulated camera, (256, 3); None: sRGB. `ring_model`: every estimate also
    gets a reading of this ring. `rings`: of each of these in turn, or of none, with the first of
    the settings; a case then bears the ring's name in the place of the setting's.
    """
    studio, ways = Studio(seed, response), list(inputs)

    def judge(scene: Scene) -> list[Case]:
        truth = reference(scene)
        cases = []
        choices = _with_rings(settings, {"": ring_model} if rings is None else rings, scene, seed)
        for how in ways:
            with tempfile.TemporaryDirectory(prefix="lightprobe-") as name:
                exposures_us = studio.shoot(scene, how, Path(name))
                for label, choice in choices.items():
                    case = _case(scene, how, label, choice, Path(name), exposures_us, truth)
                    progress(case)
                    cases.append(case)
        return cases

    with ThreadPoolExecutor(jobs) as pool:
        return [case for cases in pool.map(judge, scenes) for case in cases]


def _with_rings(
    settings: dict[str, offline.Settings],
    rings: Mapping[str, RingModel | None],
    scene: Scene,
    seed: int,
) -> dict[str, offline.Settings]:
    """Give all settings the one ring that has no name, or the first of them each ring."""
    reading = {
        name: model.read(scene, seed) if model else offline.Settings()
        for name, model in rings.items()
    }
    if list(rings) == [""]:
        return {name: choice.with_ring_of(reading[""]) for name, choice in settings.items()}
    first = next(iter(settings.values()))
    return {name: first.with_ring_of(ring) for name, ring in reading.items()}


def _case(
    scene: Scene,
    how: Input,
    label: str,
    settings: offline.Settings,
    folder: Path,
    exposures_us: list[float],
    truth: Reference,
) -> Case:
    """Give one score, or the daemon's reason why there is none."""
    try:
        estimate = offline.estimate_folder(folder, exposures_us, settings)
    except UsageError:
        raise  # of no use to try with the next scene
    except DaemonError as error:
        return Case(scene.name, how.name, label, None, str(error))
    return Case(scene.name, how.name, label, truth.score(estimate))
