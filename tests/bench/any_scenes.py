"""The speed of `balanced` scene by scene, still, bracketed and turning: `make bench SCENES=…`.

Scenes that the code was not tuned to say more than those of the whole benchmark. Figures go to
standard output, and to build/bench/scenes.json.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import frames
import numpy as np
import report
import timing
from lightprobe.sim.scene import Scene
from rich.progress import Progress

KINDS = ("equirect_1920x960_420", "equirect_1920x960_422")
STILL = (timing.YARDSTICK, "balanced", "exposures_3", timing.PUBLISHED, "stages")
TURNING = (timing.YARDSTICK, "turning")
STAGES = (
    "stage_map", "stage_detection", "stage_refinement", "stage_reflection_map_32",
    "stage_ring_view", "stage_ring_fusion_16_parts",
)  # fmt: skip
#: Frames of a camera that turns: those that are not timed, and all.
SETTLING, FRAMES = 6, 24

Samples = dict[str, list[int]]


def _still(kind: frames.Kind, file: Path, rounds: int) -> Samples:
    """Nanoseconds of contestants that take turns on one picture."""
    rng, samples = np.random.default_rng(0), {}
    with timing.Program(kind.camera, [file]) as program:
        program.ask("run", 0, *STILL)
        for _ in range(rounds):
            timing.add(samples, program.ask("run", 0, *rng.permutation(STILL)))
    return samples


def _turning(kind: frames.Kind, files: Sequence[Path]) -> Samples:
    """Nanoseconds of contestants that take turns on each frame of a camera that turns."""
    rng, samples = np.random.default_rng(0), {}
    with timing.Program(kind.camera, files) as program:
        for index in range(len(files)):
            times = program.ask("run", index, *rng.permutation(TURNING))
            if index >= SETTLING:
                timing.add(samples, times)
    return samples


def _row(scene: Scene, kind: frames.Kind, still: Samples, turning: Samples) -> dict[str, Any]:
    def median_ms(samples: Samples, name: str) -> float:
        return float(np.median(samples[name])) / 1e6

    plain_ms = median_ms(still, timing.YARDSTICK)
    return {
        "scene": scene.name,
        "chroma": kind.chroma,
        "plain_decode_ms": plain_ms,
        "still": median_ms(still, "balanced") / plain_ms,
        "bracket": median_ms(still, "exposures_3") / plain_ms,
        "turning": median_ms(turning, "turning") / median_ms(turning, timing.YARDSTICK),
        "published": median_ms(still, timing.PUBLISHED) / plain_ms,
        **{f"{name}_ms": median_ms(still, name) for name in STAGES},
    }


def measure(
    scenes: Sequence[Scene], folder: Path, rounds: int, bar: Progress
) -> list[dict[str, Any]]:
    """Ratios to a plain decode, and milliseconds of stages, for each scene and chroma."""
    task = bar.add_task("scenes", total=len(KINDS) * len(scenes))
    rows = []
    for kind in (frames.KINDS[name] for name in KINDS):
        for seed, (scene, file) in enumerate(
            zip(scenes, frames.make(kind, folder, scenes), strict=True)
        ):
            turned = frames.make_turning(kind, folder, scene, seed, FRAMES)
            rows.append(_row(scene, kind, _still(kind, file, rounds), _turning(kind, turned)))
            bar.advance(task)
    return rows


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Markdown: a row for each scene and chroma, and the median of each chroma."""
    stages = [f"{name.removeprefix('stage_').replace('_', ' ')} ms" for name in STAGES]
    head = ["scene", "chroma", "plain decode ms", "balanced, still", "three exposures, still",
            f"balanced, turning at {frames.TURN_DEG_S:g}°/s", "published recipe",
            *stages]  # fmt: skip
    keys = list(rows[0])[2:]
    everything = list(rows)
    for chroma in dict.fromkeys(row["chroma"] for row in rows):
        some = [row for row in rows if row["chroma"] == chroma]
        medians = {key: float(np.median([row[key] for row in some])) for key in keys}
        everything.append({"scene": "**median**", "chroma": chroma, **medians})
    return report.table(
        head,
        [[row["scene"], row["chroma"], *(f"{row[key]:.2f}" for key in keys)] for row in everything],
    )
