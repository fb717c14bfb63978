"""Accuracy of presets and baselines on scenes with known truth, as `lightprobe evaluate` has it.

Directions are judged on procedural scenes: one 8-bit JPEG, 1920 x 960, 4:2:0, exposed so that
nothing clips. Relighting and SH are judged on panoramas: one JPEG exposed for the scene's median,
as an automatic camera does; lamps clip, whatever the method. Ours may also have a bracket.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from lightprobe import sh
from lightprobe.colour import srgb_table
from lightprobe.estimate import Estimate, EstimateFlag, SphericalHarmonics
from lightprobe.evaluate import evaluation, offline
from lightprobe.evaluate.evaluation import Case, Input, Studio
from lightprobe.evaluate.metrics import summarize
from lightprobe.sim import scenes
from lightprobe.sim.scene import Scene
from published import as_estimate, published
from rich.progress import Progress
from timing import DIVISORS, PRESETS

UNCLIPPED, AUTOMATIC, BRACKET = Input("unclipped"), Input("1"), Input("3")
#: Name of `balanced` with BRACKET.
BRACKETED = "exposures_3"
LIGHTS = 8
#: An SH order that the baseline is given; lamps are in it.
ORDER = 2


def _settings() -> dict[str, offline.Settings]:
    chosen = {name: offline.Settings(preset=name, lights=LIGHTS) for name in PRESETS}
    for name in DIVISORS:
        divisor = int(name.rpartition("_")[2])
        chosen[name] = offline.Settings(decode=divisor, lights=LIGHTS)
    return chosen


def _published(jpeg: np.ndarray, exposure_us: float) -> Estimate:
    """Its largest regions, as many as the daemon lists lights."""
    return as_estimate(published(jpeg)[:LIGHTS], evaluation.SIZE_PX, exposure_us)


def _projected(jpeg: np.ndarray, exposure_us: float) -> Estimate:
    """All pixels, order 2, no lamps: what any public SH projector gives."""
    codes = cv2.imdecode(jpeg, cv2.IMREAD_COLOR)[..., ::-1]
    linear = srgb_table()[codes] / (exposure_us * 1e-6)
    total = SphericalHarmonics("TOTAL", ORDER, sh.project(linear, ORDER))
    return Estimate(
        sequence=1, boot_id=1, capture_time_unix_ns=0, send_delay_us=0, ttl_ms=0,
        flags=EstimateFlag(0), lights=(), sh=total, predicted_error=None,
        exposure_us=exposure_us, exposure_count=1, cd_m2_per_unit=None,
    )  # fmt: skip


METHODS: dict[str, Callable[[np.ndarray, float], Estimate]] = {
    "published": _published,
    "sh_full_resolution": _projected,
}


def _baselines(scene: Scene, how: Input) -> list[Case]:
    truth = evaluation.reference(scene)
    with tempfile.TemporaryDirectory(prefix="lightprobe-") as name:
        (exposure_us,) = Studio().shoot(scene, how, Path(name))
        jpeg = np.fromfile(Path(name) / "0000.jpg", np.uint8)
        return [
            Case(scene.name, how.name, label, truth.score(method(jpeg, exposure_us)))
            for label, method in METHODS.items()
        ]


def _figures(cases: list[Case]) -> dict[str, dict[str, Any]]:
    """Sum up per method; SystemExit when one gave no estimate."""
    for case in cases:
        if case.score is None:
            raise SystemExit(f"bench: no estimate of {case.scene}: {case.error}")
    names = dict.fromkeys(case.settings for case in cases)
    return {
        name: summarize(c.score for c in cases if c.settings == name and c.score).to_json()
        for name in names
    }


def measure(quick: bool, bar: Progress) -> dict[str, dict[str, Any]]:
    """Give {"procedural", "panoramas"} -> method -> figures as in metrics.Summary."""
    parts = {
        "procedural": (scenes.load([f"procedural:{3 if quick else 25}"]), UNCLIPPED),
        "panoramas": (scenes.load(["blender"])[: 1 if quick else None], AUTOMATIC),
    }
    settings, bracketed = (
        _settings(),
        {BRACKETED: offline.Settings(preset="balanced", lights=LIGHTS)},
    )
    per_scene = len(settings) + 1
    task = bar.add_task("accuracy", total=sum(len(s) for s, _ in parts.values()) * per_scene)
    result = {}
    for part, (loaded, how) in parts.items():
        cases = evaluation.evaluate(loaded, settings, [how], progress=lambda _: bar.advance(task))
        for scene in loaded:
            cases += _baselines(scene, how)
            bar.advance(task)
        if how is AUTOMATIC:
            cases += evaluation.evaluate(loaded, bracketed, [BRACKET])
        result[part] = _figures(cases)
    return result
