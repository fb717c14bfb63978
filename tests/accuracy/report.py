"""`make accuracy`: the generated parts of docs/users/accuracy.md and README.md, and the plot.

Parts stand between `<!-- generated: NAME -->` and `<!-- end -->`; what is around them is written by
hand. All figures go to build/accuracy/accuracy.json besides.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from lightprobe.cli import evaluate
from lightprobe.evaluate import evaluation, offline
from lightprobe.evaluate import plot as evaluate_plot
from lightprobe.evaluate.evaluation import Case, Input
from lightprobe.evaluate.metrics import Summary
from lightprobe.sim import scenes

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/extremes"))
sys.path.insert(0, str(ROOT / "tests/files"))
import automatic  # noqa: E402
import changes  # noqa: E402
import files  # noqa: E402
import fisheye  # noqa: E402
import live  # noqa: E402
import several  # noqa: E402
import with_ring  # noqa: E402
from cases import CASES  # noqa: E402
from page import ACCURACY, put  # noqa: E402
from recording import markdown as table  # noqa: E402
from recording import to_json  # noqa: E402

#: What the daemon grants the response and white balance of a camera; what the wire resolves.
CAMERA_SIGMA, LEAST_SIGMA = 0.02, 0.001
PRESETS = ("fast", "balanced", "accurate")
SETTINGS = {f"preset={name}": offline.Settings(preset=name) for name in PRESETS}
#: What a numerical trial on 21 maps found possible for a camera without a ring: median (worst)
#: relighting MAE by number of exposures, four stops apart.
POSSIBLE = {"1": "0.25 (0.37)", "2": "0.17 (0.32)", "3": "0.12 (0.28)", "4": "0.05 (0.22)"}


def percent(share: float | None) -> str:
    """A share, or a dash."""
    return "–" if share is None else f"{100 * share:.0f} %"


def own_terms(cases: list[Case], preset: str, name: str) -> tuple[float, float]:
    """Irradiances within 1 and 2 sigma, the share left out that no simulated camera has."""
    left_out = 0.0 if name == "float" else CAMERA_SIGMA
    matches = [
        match
        for case in cases
        if (case.settings, case.input) == (preset, name) and case.score
        for match in case.score.matches
        if match.irradiance_sigma is not None
    ]
    error = np.abs([match.irradiance_error for match in matches])
    stated = np.array([match.irradiance_sigma for match in matches], float)
    sigma = np.sqrt(np.maximum(stated**2 - left_out**2, LEAST_SIGMA**2))
    return float(np.mean(error <= sigma)), float(np.mean(error <= 2 * sigma))


def lamps_table(cases: list[Case], groups: evaluate.Groups) -> str:
    """Directions and strengths: procedural scenes."""
    rows = [
        [preset.partition("=")[2], name, f"{s.direction_rmse_deg:.4f}°",
         f"{s.direction_worst_deg:.3f}°", f"{s.missed}", f"{s.false}",
         percent(s.direction_within_1_sigma), percent(s.direction_within_2_sigma),
         percent(s.irradiance_within_1_sigma), percent(s.irradiance_within_2_sigma),
         *map(percent, own_terms(cases, preset, name))]
        for (preset, name), s in groups.items()
    ]  # fmt: skip
    head = ["preset", "input", "direction RMSE", "worst", "missed", "false", "direction within 1σ",
            "2σ", "irradiance within 1σ", "2σ", "without the camera's 2 %: 1σ", "2σ"]  # fmt: skip
    return table(head, rows)


def light_row(preset: str, name: str, s: Summary, possible: bool) -> list[str]:
    """Relighting and SH of one group."""
    row = [
        preset.partition("=")[2], name,
        f"{s.relighting_mae_median:.4f} ({s.relighting_mae_worst:.4f})",
        f"{s.relighting_rmse_median:.4f}",
        f"{100 * s.sh_error_median:.2f} % ({100 * s.sh_error_worst:.2f} %)",
    ]  # fmt: skip
    return [*row, POSSIBLE.get(name, "–")] if possible else row


def light_table(groups: evaluate.Groups, possible: bool = False) -> str:
    """Light on a sphere, and SH."""
    head = ["preset", "input", "relighting MAE, median (worst)", "RMSE, median",
            "SH error, median (worst)"]  # fmt: skip
    rows = [light_row(preset, name, s, possible) for (preset, name), s in groups.items()]
    return table([*head, "MAE possible for a camera alone"] if possible else head, rows)


#: What README.md shows of the preset that is the daemon's default, by input.
SHOWN = {
    "3": "three 8-bit exposures: the default",
    "unclipped": "one 8-bit exposure just below saturation",
    "float": "all of the light, without a camera",
}


def readme_table(rooms: evaluate.Groups, panoramas: evaluate.Groups) -> str:
    """The default beside the best, and the worst scene beside the median."""

    def light(groups: evaluate.Groups, name: str) -> str:
        s = groups.get(("preset=balanced", name))
        if s is None:
            return "–"
        median, worst = (
            f"{100 * mae:.2f} %" if mae < 0.01 else f"{100 * mae:.1f} %"
            for mae in (s.relighting_mae_median, s.relighting_mae_worst)
        )
        return f"{median} ({worst})"

    rows = []
    for name, words in SHOWN.items():
        s = rooms["preset=balanced", name]
        lamps = f"{s.direction_rmse_deg:.3f}° ({s.direction_worst_deg:.2f}°)"
        counts = f"{s.missed}, {s.false}"
        rows.append([words, lamps, counts, light(rooms, name), light(panoramas, name)])
    head = ["simulated input", "lamp direction, RMSE (worst)", "missed, made up",
            "light on a white sphere: rooms", "panoramas"]  # fmt: skip
    return table(head, rows)


def extremes_table() -> str:
    """Run every case of tests/extremes."""
    rows = []
    for case in CASES:
        with tempfile.TemporaryDirectory(prefix="lightprobe-") as folder:
            result = case.measure(Path(folder))
        flags = ", ".join(f"`{name}`" for name in sorted(result.flags)) or "–"
        rows.append([case.name, case.error, f"{result.error:.2g}", f"{case.bound:g}", flags])
    return table(["input", "error", "found", "bound", "flags"], rows)


def evaluated(names: list[str], inputs: list[str]) -> tuple[list[Case], evaluate.Groups]:
    """Scenes x presets x inputs; SystemExit when a scene got no estimate."""
    loaded = scenes.load(names)
    cases = evaluation.evaluate(loaded, SETTINGS, [Input.parse(name) for name in inputs])
    for case in cases:
        if case.score is None:
            raise SystemExit(f"accuracy: no estimate of {case.scene}: {case.error}")
    return cases, evaluate.group(cases)


#: A few births in a minute tell how restless a list is: turning cameras are judged for so long.
MOVING_S = 60.0


def live_figures(out: Path, page: Path) -> dict[str, str]:
    """Measure turning cameras, troubles and changing lamps; the parts of the page."""
    moving = live.all_figures(
        [*live.cases(live.SCENES, judged_s=MOVING_S), *live.lens_cases(judged_s=MOVING_S)]
    )
    troubled = live.all_figures(live.cases(live.TROUBLED_SCENES, tuple(live.TROUBLES)))
    told = live.all_figures(live.told_cases())
    ringed = live.all_figures(live.ring_cases(judged_s=MOVING_S))
    exposing = automatic.all_figures(automatic.cases(automatic.SCENES))
    modules = several.all_figures(several.cases(several.SCENES))
    changing = changes.all_figures(changes.cases(changes.SCENES))
    (out / "live.json").write_text(to_json([*moving, *troubled, *told, *ringed]) + "\n")
    (out / "changes.json").write_text(to_json(changing) + "\n")
    (out / "automatic.json").write_text(to_json(exposing) + "\n")
    (out / "several.json").write_text(to_json(modules) + "\n")
    live.draw(moving, page.with_name("live.png"))
    put(ROOT / "README.md", {"live": table(live.README_HEAD, live.readme_rows(moving))})
    return {
        "live": table(live.HEAD, live.rows(moving)),
        "live-sigmas": table(live.COVERAGE_HEAD, live.coverage_rows(moving)),
        "orientations": table(live.TOLD_HEAD, live.told_rows(told)),
        "live-ring": table(live.HEAD, live.ring_rows(moving, ringed)),
        "automatic": table(automatic.HEAD, automatic.rows(exposing)),
        "several": table(several.HEAD, several.rows(modules)),
        "troubles": table(live.HEAD, live.rows(troubled)),
        "troubles-sigmas": table(live.COVERAGE_HEAD, live.coverage_rows(troubled)),
        "steps": table(changes.STEP_HEAD, changes.step_rows(changing)),
        "flicker": table(changes.FLICKER_HEAD, changes.flicker_rows(changing)),
    }


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--procedural", type=int, default=60, help="scenes with known lamps")
    parser.add_argument(
        "--only-live", action="store_true", help="only what live.py and changes.py measure"
    )
    options = parser.parse_args()
    count = options.procedural
    out, page = ROOT / "build/accuracy", ACCURACY
    out.mkdir(parents=True, exist_ok=True)
    live_parts = live_figures(out, page)
    if options.only_live:
        put(page, live_parts)
        return
    lamp_cases, lamps = evaluated([f"procedural:{count}"], ["float", "unclipped", "3"])
    panorama_cases, panoramas = evaluated(["blender"], ["float", "1", "2", "3", "4"])
    parts = {
        "lamps": f"{count} scenes:\n\n{lamps_table(lamp_cases, lamps)}",
        "light": light_table(panoramas, possible=True),
        "light-procedural": light_table(lamps),
        "fisheye": table(fisheye.HEAD, fisheye.rows(fisheye.all_figures(fisheye.ROOMS))),
        **with_ring.parts(),
        "extremes": extremes_table(),
        "files": table(files.HEAD, [files.row(file) for file in files.FILES]),
    }
    put(page, parts | live_parts)
    put(ROOT / "README.md", {"figures": readme_table(lamps, panoramas)})
    figures = {
        "procedural": evaluate.to_json(lamp_cases, lamps),
        "panoramas": evaluate.to_json(panorama_cases, panoramas),
    }
    (out / "accuracy.json").write_text(json.dumps(figures, indent=2) + "\n")
    evaluate_plot.draw(lamp_cases, ROOT / "docs/users/accuracy.png")


if __name__ == "__main__":
    main()
