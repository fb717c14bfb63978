"""`lightprobe evaluate`: scenes × settings against the truth."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, fields
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table

from lightprobe import daemon
from lightprobe.cli import check, view
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.evaluate import evaluation, offline, ring_model
from lightprobe.evaluate.evaluation import Case, Input
from lightprobe.evaluate.metrics import Summary, summarize
from lightprobe.evaluate.ring_model import RingModel
from lightprobe.geometry import Array
from lightprobe.sim import response as responses
from lightprobe.sim import scenes
from lightprobe.sim.scene import Scene

Groups = dict[tuple[str, str], Summary]  # (settings, input)


class NoScoreError(LightprobeError):
    """Some scene got no estimate."""


def command(
    scene: Annotated[
        list[str],
        typer.Option(
            "--scenes", metavar="WHAT", help="room, procedural[:N], blender, FILE or FOLDER."
        ),
    ] = ["procedural", "blender"],  # noqa: B006 - typer copies it
    settings: Annotated[
        list[str],
        typer.Option(
            metavar="K=V,…", help="Daemon options to compare; default: the daemon's defaults."
        ),
    ] = ["default"],  # noqa: B006
    brackets: Annotated[
        str,
        typer.Option(metavar="LIST", help="float, unclipped, or a number of 8-bit exposures."),
    ] = "float",
    response: Annotated[
        str,
        typer.Option(metavar="CURVE", help=f"Response of the simulated camera: {responses.HELP}."),
    ] = "srgb",
    ring_sigma: Annotated[
        float | None,
        typer.Option(
            metavar="SIGMA",
            min=0.001,
            max=10,
            help="Also read a ring of light sensors with this relative noise, such as 0.03.",
        ),
    ] = None,
    ring_parts: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(ring_model.PARTS[1:]),
            help="Or read a ring of LDRs as they are built, with this calibration.",
        ),
    ] = None,
    scale_sigma: Annotated[
        float,
        typer.Option(
            metavar="SIGMA",
            min=0,
            max=10,
            help="How well cd/m² per unit is calibrated, relative; 0: not at all.",
        ),
    ] = 0.02,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated camera's noise.")] = 0,
    jobs: Annotated[
        int, typer.Option(min=1, help="Scenes evaluated at the same time.")
    ] = os.cpu_count() or 1,
    per_scene: Annotated[
        bool, typer.Option("--per-scene", help="Also print one row per scene.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print all figures as JSON.")] = False,
    json_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", callback=check.new_file(), help="Also write all figures as JSON."
        ),
    ] = None,
    plot: Annotated[Path | None, check.plot("Draw a plot (png, svg, pdf).")] = None,
) -> None:
    """Measure accuracy: direction, missed and false lamps, relighting and SH error.

    Truth is computed in double precision from the unclipped map (or in closed form). Options may be
    repeated. Keys of --settings: camera, preset, panorama-width, decode, exact-blocks,
    refine-cells, detector, sh-order, lights.
    --brackets float feeds the map itself; unclipped, one 8-bit exposure just below saturation;
    1, 2, 3, 4: that many 8-bit exposures, four stops apart, through the simulated camera.
    Example: lightprobe evaluate --scenes blender --settings preset=fast --settings
    preset=accurate --brackets float,1,2,3
    """
    chosen = {text: parse_settings(text) for text in settings}
    inputs = [Input.parse(word) for word in brackets.split(",")]
    curve = responses.parse(response)
    model = parse_ring(ring_sigma, ring_parts, scale_sigma)
    daemon.find()
    loaded = scenes.load(scene)
    cases = run(loaded, chosen, inputs, seed, curve, jobs, model)
    groups = group(cases)
    unwritten = write_files(cases, groups, json_file, plot)
    if as_json:
        typer.echo(json.dumps(to_json(cases, groups), indent=2))
    else:
        show(cases, groups, per_scene)
    if unwritten:
        raise LightprobeError(unwritten)
    failed = [case for case in cases if case.score is None]
    if failed:
        raise NoScoreError(
            f"evaluate: no estimate for {len(failed)} of {len(cases)}; first {failed[0].scene}: "
            f"{failed[0].error}"
        )


def write_files(
    cases: list[Case], groups: Groups, json_file: Path | None, plot: Path | None
) -> str:
    """Write what was asked for; gives what went wrong, so that the figures are shown all the same.

    The paths were good when the work began, but a disk can be full by now.
    """
    problems = []
    if json_file is not None:
        try:
            json_file.write_text(json.dumps(to_json(cases, groups), indent=2) + "\n")
        except OSError as error:
            problems.append(f"evaluate: {json_file}: write: {error.strerror}")
    if plot is not None:
        from lightprobe.evaluate import plot as evaluate_plot  # matplotlib is slow to load

        try:
            evaluate_plot.draw(cases, plot)
            typer.echo(f"plot: {plot}", err=True)
        except OSError as error:
            problems.append(f"evaluate: {plot}: write: {error.strerror}")
    return "; ".join(problems)


def parse_ring(sigma: float | None, parts: str | None, scale_sigma: float) -> RingModel | None:
    """Give the ring that is asked for, if any; raises UsageError."""
    if parts is None and sigma is None:
        return None
    if parts is not None and sigma is not None and parts != ring_model.COLOUR:
        raise UsageError(
            "evaluate: --ring-sigma: LDRs of --ring-parts have their own: leave one of the two out"
        )
    if parts is not None and parts not in ring_model.PARTS[1:]:
        raise UsageError(
            f"evaluate: --ring-parts {parts}: expected {' or '.join(ring_model.PARTS[1:])}"
        )
    return RingModel(
        0.03 if sigma is None else sigma, scale_sigma or 1.0, scale_known=scale_sigma > 0,
        parts=parts or ring_model.IDEAL,
    )  # fmt: skip


def parse_settings(text: str) -> offline.Settings:
    """Read `key=value,…` (or `default`) as daemon options; raises UsageError."""
    known = {field.name: field.type for field in fields(offline.Settings)}
    values: dict[str, Any] = {}
    for word in [] if text == "default" else text.split(","):
        key, _, value = word.partition("=")
        name = key.strip().replace("-", "_")
        if name not in known or not value:
            keys = ", ".join(name.replace("_", "-") for name in known)
            raise UsageError(f"evaluate: --settings {word}: expected KEY=VALUE, KEY one of {keys}")
        try:
            values[name] = int(value) if "int" in str(known[name]) else value
        except ValueError:
            raise UsageError(f"evaluate: --settings {word}: expected a whole number") from None
    return offline.Settings(**values)


def run(
    loaded: list[Scene],
    settings: dict[str, offline.Settings],
    inputs: list[Input],
    seed: int,
    response: Array,
    jobs: int,
    ring_model: RingModel | None = None,
) -> list[Case]:
    """Evaluate under a progress bar on stderr."""
    console = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        total = len(loaded) * len(settings) * len(inputs)
        task = bar.add_task("evaluating", total=total)

        def advance(case: Case) -> None:
            bar.update(task, advance=1, description=f"{case.scene} {case.input} {case.settings}")

        return evaluation.evaluate(
            loaded,
            settings,
            inputs,
            seed=seed,
            response=response,
            ring_model=ring_model,
            jobs=jobs,
            progress=advance,
        )


def group(cases: list[Case]) -> Groups:
    """Sum up per (settings, input), in the order they were given."""
    keys = dict.fromkeys((case.settings, case.input) for case in cases)
    groups: Groups = {}
    for key in keys:
        scores = [c.score for c in cases if (c.settings, c.input) == key and c.score is not None]
        if scores:
            groups[key] = summarize(scores)
    return groups


def to_json(cases: list[Case], groups: Groups) -> dict[str, Any]:
    """All figures: sums per settings and input, and every case."""
    return {
        "summary": [
            {"settings": settings, "input": name, **summary.to_json()}
            for (settings, name), summary in groups.items()
        ],
        "cases": [asdict(case) for case in cases],
    }


def show(cases: list[Case], groups: Groups, per_scene: bool) -> None:
    """Print tables."""
    console = view.console()
    if per_scene:
        console.print(_scene_table(cases))
    if groups:
        console.print(_accuracy_table(groups))
    if any(s.direction_rmse_deg is not None for s in groups.values()):
        console.print(_coverage_table(groups))
    for case in cases:
        if case.score is None:
            words = f"{case.scene} {case.input} {case.settings}: {case.error}"
            console.print(f"[red]{escape(words)}[/red]")


def _table(title: str, names: list[str]) -> Table:
    table = Table(title=title, title_justify="left", box=None, header_style="bold", pad_edge=False)
    for name in names:
        words = name in ("scene", "settings", "input", "flags")
        table.add_column(name, justify="left" if words else "right", no_wrap=not words)
    return table


def _accuracy_table(groups: Groups) -> Table:
    """One row per settings and input: median / worst over the scenes."""
    table = _table(
        "accuracy: median / worst (direction: RMSE / worst)",
        [
            "settings",
            "input",
            "scenes",
            "relighting MAE",
            "SH error",
            "direction",
            "missed",
            "false",
        ],
    )
    for (settings, name), s in groups.items():
        angles = (s.direction_rmse_deg, s.direction_worst_deg)
        table.add_row(
            settings, name, str(s.scenes),
            f"{s.relighting_mae_median:.4f} / {s.relighting_mae_worst:.4f}",
            f"{100 * s.sh_error_median:.2f}% / {100 * s.sh_error_worst:.2f}%",
            " / ".join("–" if angle is None else f"{angle:.3f}°" for angle in angles),
            str(s.missed), str(s.false),
        )  # fmt: skip
    return table


def _scene_table(cases: list[Case]) -> Table:
    table = _table(
        "scenes",
        ["scene", "settings", "input", "MAE", "SH", "angles", "missed", "false", "flags"],
    )
    for case in cases:
        score = case.score
        if score is None:
            continue
        table.add_row(
            case.scene, case.settings, case.input, f"{score.relighting_mae:.4f}",
            f"{100 * score.sh_error:.2f}%",
            " ".join(f"{match.angle_deg:.2f}°" for match in score.matches),
            str(score.missed), str(score.false), " ".join(score.flags).lower(),
        )  # fmt: skip
    return table


def _coverage_table(groups: Groups) -> Table:
    """How often the truth lies within the stated uncertainty."""
    table = _table(
        "truth lies within the stated sigma",
        ["settings", "input", "direction 1σ", "2σ", "irradiance 1σ", "2σ", "relighting 1σ", "3σ"],
    )
    for (settings, name), s in groups.items():
        shares = (s.direction_within_1_sigma, s.direction_within_2_sigma,
                  s.irradiance_within_1_sigma, s.irradiance_within_2_sigma,
                  s.relighting_within_1_sigma, s.relighting_within_3_sigma)  # fmt: skip
        words = ("–" if share is None else f"{100 * share:.0f}%" for share in shares)
        table.add_row(settings, name, *words)
    return table
