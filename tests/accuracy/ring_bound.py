"""How well three exposures and a ring of noisy sensors can know the light at all.

The hidden light of the clipped lamps that are listed, and the scale, are the unknowns; the
Cramér-Rao bound of nine readings says how well any unbiased estimator can know them (Kay 1993,
chapter 3). The error of the light is then that of the noise, beside what is left without any
noise: mostly the colour of clipped lamps. Regions that are no lamps are left out, so that the bound
is a little lower than it need be.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lightprobe import geometry
from lightprobe.calibrate import ring
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, LightFlag
from lightprobe.evaluate import evaluation, metrics, offline
from lightprobe.evaluate.evaluation import Input
from lightprobe.evaluate.ring_model import RingModel
from lightprobe.geometry import Array
from lightprobe.sim.scene import Scene

#: Readings of the same scene, each with other noise; draws of the bound's errors.
READINGS, DRAWS = 10, 400
EXACT = RingModel(0.001, 0.001)  # as exact as a reading may be stated
LISTED = offline.Settings(sh_order=4, lights=8)


@dataclass(frozen=True)
class Errors:
    """Mean absolute relighting errors of one scene."""

    found: float  # mean over readings
    found_exact_scale: float  # the same with a scale that has no error
    without_noise: float
    bound: float  # of noise by the Cramér-Rao bound, colours as the daemon has them
    bound_colours: float  # the same with the true colours


def measure(scene: Scene, exposures: str, ring_sigma: float, scale_sigma: float) -> Errors:
    """Errors of one scene."""
    truth = evaluation.reference(scene)

    def error(light: Array) -> float:
        return metrics.relighting(truth.irradiance, light)[0]

    with tempfile.TemporaryDirectory(prefix="lightprobe-") as name:
        times_us = evaluation.Studio().shoot(scene, Input.parse(exposures), Path(name))

        def estimate(model: RingModel, reading: int = 0) -> Estimate:
            settings = LISTED.with_ring_of(model.read(scene, reading))
            return offline.estimate_folder(Path(name), times_us, settings)

        def found(scale: float) -> float:
            model = RingModel(ring_sigma, scale)
            return float(np.mean([
                error(estimate(model, k).irradiance(geometry.sphere_normals()))
                for k in range(READINGS)
            ]))  # fmt: skip

        best = estimate(EXACT)
        means = found(scale_sigma), found(EXACT.scale_sigma)
    light = best.irradiance(geometry.sphere_normals())
    noises = noise(best, ring_sigma, scale_sigma)
    return Errors(
        *means, error(light),
        float(np.mean([error(light + one) for one in noises])),
        float(np.mean([error(truth.irradiance + one) for one in noises])),
    )  # fmt: skip


def noise(estimate: Estimate, ring_sigma: float, scale_sigma: float) -> Array:
    """Draws of what noise does at least to the irradiance (DRAWS, normals, 3)."""
    lamps = [light for light in estimate.lights if light.flags & LightFlag.RING]
    normals = geometry.sphere_normals()
    if not lamps:
        return np.zeros((1, len(normals), 3))
    towards = np.array([lamp.direction for lamp in lamps])
    weight = np.maximum(ring.directions() @ towards.T, 0)
    reading = luminance(estimate.irradiance(ring.directions()))
    # unknown: each lamp's luminance, and the scale, whose true value is 1 here
    slope = np.column_stack([weight, reading]) / (ring_sigma * reading)[:, None]
    information = slope.T @ slope
    information[-1, -1] += scale_sigma**-2
    # a lamp that no sensor faces: as uncertain as it is strong
    strength = np.array([float(luminance(lamp.irradiance)) for lamp in lamps])
    information[np.arange(len(lamps)), np.arange(len(lamps))] += strength**-2.0
    rng = np.random.default_rng(0)
    drawn = rng.multivariate_normal(np.zeros(len(lamps) + 1), np.linalg.inv(information), DRAWS)
    off = np.maximum(drawn[:, :-1], -strength)
    colours = np.array([lamp.irradiance / luminance(lamp.irradiance) for lamp in lamps])
    return np.asarray(np.einsum("kj,nj,jc->knc", off, np.maximum(normals @ towards.T, 0), colours))


HEAD = ["exposures", f"mean of {READINGS} readings", "the same, scale exact", "without any noise",
        "least possible with noise: Cramér–Rao", "the same with true colours"]  # fmt: skip


def rows(scenes: list[Scene], ring_sigma: float = 0.03, scale_sigma: float = 0.02,
         exposures: tuple[str, ...] = ("3",)) -> list[list[str]]:  # fmt: skip
    """Median (worst) over the scenes."""
    out = []
    for number in exposures:
        errors = [measure(scene, number, ring_sigma, scale_sigma) for scene in scenes]
        columns = [
            [getattr(one, name) for one in errors]
            for name in ("found", "found_exact_scale", "without_noise", "bound", "bound_colours")
        ]
        out.append([number, *(f"{np.median(c):.4f} ({max(c):.3f})" for c in columns)])
    return out
