"""`make accuracy-ring`: what the ring of light sensors adds to a camera; parts of accuracy.md.

Readings with noise alone, and readings with a fault that nobody knows of. With --scenes other
scenes are measured and printed, and nothing is written.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from lightprobe.evaluate import evaluation, offline
from lightprobe.evaluate.evaluation import Case, Input
from lightprobe.evaluate.ring_model import CALIBRATED, COLOUR, UNCALIBRATED, RingModel
from lightprobe.sim import scenes

sys.path.insert(0, str(Path(__file__).parent))
import ring_bound
from page import ACCURACY, put
from recording import markdown as table

#: So often is each scene seen and read, each time with other noise.
READINGS = 5
#: How well the camera's scale and the ring are known; None: no ring.
RINGS: dict[str, RingModel | None] = {
    "without": None,
    "3 %, scale exact": RingModel(0.03, 0.001),
    "3 %, scale within 2 %": RingModel(0.03, 0.02),
    "3 %, scale not known": RingModel(0.03, 1.0, scale_known=False),
    "10 %, scale within 5 %": RingModel(0.1, 0.05),
    "colour sensors, 3 %, scale within 2 %": RingModel(0.03, 0.02, parts=COLOUR),
    "LDRs calibrated, scale within 2 %": RingModel(scale_sigma=0.02, parts=CALIBRATED),
    "LDRs as they come, scale within 2 %": RingModel(scale_sigma=0.02, parts=UNCALIBRATED),
    "LDRs as they come, scale not known": RingModel(
        scale_sigma=1.0, scale_known=False, parts=UNCALIBRATED
    ),
}
#: What nobody knows of; none may make the light worse than the camera alone by more than HARMED.
FAULTS: dict[str, RingModel] = {
    "3 %: scale 10 % too high": RingModel(0.03, 0.02, scale_off=0.1),
    "3 %: scale 10 % too low": RingModel(0.03, 0.02, scale_off=-0.1),
    "3 %: scale 30 % too high": RingModel(0.03, 0.02, scale_off=0.3),
    "3 %: scale 30 % too low": RingModel(0.03, 0.02, scale_off=-0.3),
    "3 %: a hand before one sensor": RingModel(0.03, 0.02, shadowed=3),
    "3 %: ring turned by 45°": RingModel(0.03, 0.02, places_turned=1),
    "10 %: a hand before one sensor": RingModel(0.1, 0.05, shadowed=3),
    "10 %: ring turned by 45°": RingModel(0.1, 0.05, places_turned=1),
}
HARMED = 0.005
EXPOSURES = ("1", "2", "3", "4")
HEAD = ["exposures", "ring: noise of each sensor",
        "relighting MAE, median (worst) of all readings: panoramas", "rooms",
        f"worse than without by more than {HARMED:g} (most)",
        "lamps by the ring: truth within 1σ, 3σ", "their colours"]  # fmt: skip
FAULT_HEAD = ["ring: noise, and what nobody knows", f"worse than without by more than {HARMED:g}",
              "most", "light within 1σ, 3σ of what is stated",
              "relighting MAE, median (worst) with three exposures: panoramas",
              "rooms"]  # fmt: skip


def measure(names: list[str], inputs: tuple[str, ...] = EXPOSURES) -> dict[str, list[Case]]:
    """Cases of every ring and reading; SystemExit when a scene got no estimate."""
    loaded, cases = scenes.load(names), []
    for reading in range(READINGS):
        cases += evaluation.evaluate(
            loaded, {"default": offline.Settings()}, [Input.parse(n) for n in inputs],
            seed=reading, rings={**RINGS, **FAULTS},
        )  # fmt: skip
        print(f"with_ring: reading {reading + 1} of {READINGS}: {len(loaded)} scenes",
              file=sys.stderr, flush=True)  # fmt: skip
    for case in cases:
        if case.score is None:
            raise SystemExit(f"accuracy: no estimate of {case.scene}: {case.error}")
    return {name: [c for c in cases if c.settings == name] for name in (*RINGS, *FAULTS)}


def light(cases: list[Case], exposures: str) -> str:
    """Median and worst relighting error, over scenes and readings."""
    errors = [c.score.relighting_mae for c in cases if c.score and c.input == exposures]
    return f"{np.median(errors):.3f} ({max(errors):.3f})" if errors else "–"


def harms(cases: list[Case], without: list[Case], exposures: str | None = None) -> list[float]:
    """How much worse each reading is than without the ring; None: with any exposures."""
    return [
        a.score.relighting_mae - b.score.relighting_mae
        for a, b in zip(cases, without, strict=True)
        if a.score and b.score and exposures in (None, a.input)
    ]


def harmed(worse: list[float]) -> str:
    """How many are worse by more than HARMED."""
    return f"{sum(one > HARMED for one in worse)} of {len(worse)}"


def stated(cases: list[Case], exposures: str | None = None) -> str:
    """How often the light is within 1 and 3 of the sigmas that packets state of it."""
    ratio = np.array([
        case.score.relighting_relative / case.score.relighting_stated
        for case in cases
        if case.score and case.score.relighting_stated and exposures in (None, case.input)
    ])  # fmt: skip
    within = [100 * float(np.mean(ratio <= limit)) for limit in (1, 3)]
    return f"{within[0]:.0f} %, {within[1]:.0f} % of {len(ratio)}"


def coverage(cases: list[Case], exposures: str) -> str:
    """How often the truth lies within 1 and 3 sigma of a strength that the ring found."""
    # The error is relative to the truth, the sigma to what is stated.
    ratio = np.array([
        abs(match.irradiance_error) / (1 + match.irradiance_error) / match.irradiance_sigma
        for case in cases if case.score and case.input == exposures
        for match in case.score.matches if match.by_ring and match.irradiance_sigma
    ])  # fmt: skip
    if not len(ratio):
        return "–"
    within = [100 * float(np.mean(ratio <= limit)) for limit in (1, 3)]
    return f"{within[0]:.0f} %, {within[1]:.0f} % of {len(ratio)}"


def colour_coverage(cases: list[Case], exposures: str) -> str:
    """The same of the colours of such lamps."""
    ratio = np.array([
        match.colour_error / match.colour_sigma
        for case in cases if case.score and case.input == exposures
        for match in case.score.matches if match.by_ring and match.colour_sigma
    ])  # fmt: skip
    if not len(ratio):
        return "–"
    within = [100 * float(np.mean(ratio <= limit)) for limit in (1, 3)]
    return f"{within[0]:.0f} %, {within[1]:.0f} %"


def rows(panoramas: dict[str, list[Case]], rooms: dict[str, list[Case]]) -> list[list[str]]:
    """One row for each number of exposures and ring."""
    out = []
    for exposures in EXPOSURES:
        for name in RINGS:
            worse = [
                one
                for group in (panoramas, rooms)
                for one in harms(group[name], group["without"], exposures)
            ]
            out.append([
                exposures, name, light(panoramas[name], exposures), light(rooms[name], exposures),
                "–" if name == "without" else f"{harmed(worse)} ({max(*worse, 0):.3f})",
                coverage(rooms[name], exposures), colour_coverage(rooms[name], exposures),
            ])  # fmt: skip
    return out


def fault_rows(panoramas: dict[str, list[Case]], rooms: dict[str, list[Case]]) -> list[list[str]]:
    """One row for each fault, over all exposures."""
    out = []
    for name in FAULTS:
        worse = [
            one for group in (panoramas, rooms) for one in harms(group[name], group["without"])
        ]
        out.append([
            name, harmed(worse), f"{max(*worse, 0):.3f}", stated(panoramas[name] + rooms[name]),
            light(panoramas[name], "3"), light(rooms[name], "3"),
        ])  # fmt: skip
    return out


def parts(count: int = 20) -> dict[str, str]:
    """Measure what the page shows."""
    found = measure(["blender"]), measure([f"procedural:{count}"])
    return {
        "ring": table(HEAD, rows(*found)),
        "ring-bound": table(ring_bound.HEAD, ring_bound.rows(scenes.load(["blender"]))),
        "ring-faults": table(FAULT_HEAD, fault_rows(*found)),
    }


def main() -> None:
    """Measure and write, or print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", action="append", help="FILE or FOLDER of panoramas")
    parser.add_argument("--procedural", type=int, default=20, help="rooms with known lamps")
    options = parser.parse_args()
    if options.scenes:
        found = measure(options.scenes)
        for exposures in EXPOSURES:
            for name, cases in found.items():
                worse = harms(cases, found["without"], exposures)
                print(
                    f"{exposures} exposures, ring {name}: {light(cases, exposures)}; worse than "
                    f"without: {harmed(worse)} ({max(*worse, 0):.3f}); within 1σ, 3σ: "
                    f"{stated(cases, exposures)}"
                )
        return

    put(ACCURACY, parts(options.procedural))


if __name__ == "__main__":
    main()
