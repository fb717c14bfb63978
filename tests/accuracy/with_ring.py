"""`make accuracy-ring`: what the ring of light sensors adds to a camera; a part of accuracy.md.

With --scenes other scenes are measured and printed, and nothing is written.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from lightprobe.cli import evaluate
from lightprobe.evaluate import evaluation, offline
from lightprobe.evaluate.evaluation import Case, Input, RingModel
from lightprobe.sim import scenes

sys.path.insert(0, str(Path(__file__).parent))
from recording import markdown as table

#: How well the camera's scale and the ring are known; None: no ring.
RINGS: dict[str, RingModel | None] = {
    "without": None,
    "3 %, scale within 2 %": RingModel(0.03, 0.02),
    "3 %, scale not known": RingModel(0.03, 1.0, scale_known=False),
    "10 %, scale within 5 %": RingModel(0.1, 0.05),
}
EXPOSURES = ("1", "2", "3", "4")
HEAD = ["exposures", "ring: noise of each sensor", "relighting MAE, median (worst): panoramas",
        "rooms", "worse than without, most", "lamps by the ring: truth within 1σ, 3σ"]  # fmt: skip


def measure(names: list[str], inputs: tuple[str, ...] = EXPOSURES) -> dict[str, list[Case]]:
    """Cases of every ring; SystemExit when a scene got no estimate."""
    loaded = scenes.load(names)
    found = {}
    for name, model in RINGS.items():
        found[name] = evaluation.evaluate(
            loaded, {"default": offline.Settings()}, [Input.parse(n) for n in inputs],
            ring_model=model,
        )  # fmt: skip
        for case in found[name]:
            if case.score is None:
                raise SystemExit(f"accuracy: no estimate of {case.scene}: {case.error}")
    return found


def light(cases: list[Case], exposures: str) -> str:
    """Median and worst relighting error."""
    summary = evaluate.group(cases).get(("default", exposures))
    if summary is None:
        return "–"
    return f"{summary.relighting_mae_median:.3f} ({summary.relighting_mae_worst:.3f})"


def harm(cases: list[Case], without: list[Case], exposures: str) -> float:
    """How much worse the worst scene is than without the ring."""
    pairs = zip(cases, without, strict=True)
    return max(
        a.score.relighting_mae - b.score.relighting_mae
        for a, b in pairs
        if a.score and b.score and a.input == exposures
    )


def coverage(cases: list[Case], exposures: str) -> str:
    """How often the truth lies within 1 and 3 sigma of a strength that the ring found."""
    ratio = np.array([
        abs(match.irradiance_error) / match.irradiance_sigma
        for case in cases if case.score and case.input == exposures
        for match in case.score.matches if match.by_ring and match.irradiance_sigma
    ])  # fmt: skip
    if not len(ratio):
        return "–"
    within = [100 * float(np.mean(ratio <= limit)) for limit in (1, 3)]
    return f"{within[0]:.0f} %, {within[1]:.0f} % of {len(ratio)}"


def rows(panoramas: dict[str, list[Case]], rooms: dict[str, list[Case]]) -> list[list[str]]:
    """One row for each number of exposures and ring."""
    out = []
    for exposures in EXPOSURES:
        for name in RINGS:
            worse = max(
                harm(group[name], group["without"], exposures) for group in (panoramas, rooms)
            )
            out.append([
                exposures, name, light(panoramas[name], exposures), light(rooms[name], exposures),
                "–" if name == "without" else f"{max(worse, 0):.3f}",
                coverage(rooms[name], exposures),
            ])  # fmt: skip
    return out


def part(count: int = 10) -> str:
    """Measure what the page shows."""
    return table(HEAD, rows(measure(["blender"]), measure([f"procedural:{count}"])))


def main() -> None:
    """Measure and write, or print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", action="append", help="FILE or FOLDER of panoramas")
    parser.add_argument("--procedural", type=int, default=10, help="rooms with known lamps")
    options = parser.parse_args()
    if options.scenes:
        found = measure(options.scenes)
        for exposures in EXPOSURES:
            for name, cases in found.items():
                print(f"{exposures} exposures, ring {name}: {light(cases, exposures)}")
        return
    import report  # it imports this module

    page = report.ROOT / "docs/users/accuracy.md"
    report.put(page, {"ring": part(options.procedural)})


if __name__ == "__main__":
    main()
