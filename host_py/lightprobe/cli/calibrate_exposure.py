"""`lightprobe calibrate exposure`: does the camera obey, how many frames late, how exactly?"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from lightprobe.calibrate import camera_file, flat_patches
from lightprobe.calibrate import response_curve as response
from lightprobe.calibrate.exposure_response import ExposureResponse, judge_commands
from lightprobe.calibrate.exposure_series import ExposureSeries
from lightprobe.calibrate.flat_patches import exposure_of, steady_frames, step_of
from lightprobe.calibrate.response_curve import PatchCodes
from lightprobe.cli import calibrate, view
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.geometry import Array
from lightprobe.imaging import camera as cameras

#: Up by four, down by the same but between: every exposure is reached from above and from below.
SCHEDULE_US = (8, 32, 128, 512, 2048, 8192, 32768, 12288, 3072, 768, 192, 48, 12)


class ExposureIgnoredError(LightprobeError):
    """The camera does not do what it is told."""


@dataclass(frozen=True)
class StepLight:
    """Light of one step of the schedule."""

    commanded_us: float
    stated_us: float | None  # by the frames themselves
    effective_us: float | None  # by what the picture shows; None: too dark or bright to tell


@dataclass(frozen=True)
class Report:
    """The whole result."""

    source: str
    obedience: ExposureResponse
    reports_exposure: bool
    steps: tuple[StepLight, ...]
    linearity_error: float | None  # RMS of effective / commanded − 1
    response: str  # which curve the effective exposures rest on, or why there are none

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        f = self.obedience
        return {
            "source": self.source,
            "follows": f.follows,
            "changes_expected": f.expected,
            "changes_seen": f.obeyed,
            "delay_frames": f.delay_frames,
            "delays_frames": f.delays(),
            "gradual": f.gradual,
            "reports_exposure": self.reports_exposure,
            "linearity_error": self.linearity_error,
            "response": self.response,
            "steps": [asdict(step) for step in self.steps],
            "changes": [asdict(change) for change in f.changes],
        }


def command(
    source: Annotated[str, typer.Argument(metavar="SOURCE", help="v4l2:/dev/video0, sim:PATH, …")],
    output: calibrate.Output = None,
    camera: calibrate.SourceCamera = None,
    frames: Annotated[int, typer.Option(min=8, max=200, help="Frames after each command.")] = 12,
    keep: calibrate.Keep = None,
    patience_s: calibrate.Patience = 15.0,
    as_json: calibrate.AsJson = False,
) -> None:
    """Step the exposure up and down, and measure how the camera follows.

    Reports whether the camera obeys, how many frames pass from a command to its effect, and how
    exactly the light follows the command. Point the camera at a lit scene at rest.
    --output writes the delay into a camera file (docs/users/camera_calibration.md). The daemon must
    not be running on the same camera.
    Example: lightprobe calibrate exposure v4l2:/dev/video0 --output my.camera
    """
    if not calibrate.is_source(source) or source.startswith("file:"):
        raise UsageError(
            f"calibrate: {source}: expected a camera, like v4l2:/dev/video0 or sim:PATH"
        )
    with calibrate.series(
        source, SCHEDULE_US, frames=frames, camera=camera, output=output, keep=keep,
        patience_s=patience_s,
    ) as series:  # fmt: skip
        report = judge(source, series, camera or (str(output) if output else None))
        size_px = series.frames[0].width_px, series.frames[0].height_px
    if as_json:
        typer.echo(json.dumps(report.to_json(), indent=2))
    else:
        show(report)
    check(report)
    if output is not None:
        delay = report.obedience.delay_frames
        camera_file.save(output, size_px, "v4l2", {"exposure_delay_frames": str(delay)})
        typer.echo(f"written: {output}: [v4l2] exposure_delay_frames = {delay}", err=True)


def judge(source: str, series: ExposureSeries, camera: str | None) -> Report:
    """Work out the report of a series."""
    steps = series.steps()
    obedience = judge_commands(steps)
    lights, error, how = _effective(series, camera)
    return Report(source, obedience, series.reports_exposure, lights, error, how)


def check(report: Report) -> None:
    """Raise :class:`ExposureIgnoredError` unless the camera follows; says what that costs."""
    f = report.obedience
    if f.ignores:
        raise ExposureIgnoredError(
            f"exposure: {report.source}: the camera ignores exposure commands ({f.expected} "
            "without effect): is automatic exposure on (v4l2-ctl --list-ctrls), or does another "
            "program control the camera? Without exposure control there are no brackets, and "
            "light levels are relative to each frame"
        )
    if not f.follows:
        missed = [f"{c.from_us:g} → {c.to_us:g} us" for c in f.changes if c.expected and not c.seen]
        raise ExposureIgnoredError(
            f"exposure: {report.source}: only {f.obeyed} of {f.expected} commands had an effect; "
            f"none had: {', '.join(missed)}: keep the light constant, and switch automatic "
            f"functions off"
        )
    if f.delay_frames is None:
        raise ExposureIgnoredError(
            f"exposure: {report.source}: the camera follows, but frames were lost around every "
            f"change, so the delay is unknown: use a lower frame rate, or a less busy machine"
        )


def _effective(
    series: ExposureSeries, camera: str | None
) -> tuple[tuple[StepLight, ...], float | None, str]:
    """Effective exposure of each step, relative to the commands; RMS error; which response."""
    steps, commanded = [], []
    for frames in series.steps():
        exposure_us = frames[-1].commanded_us
        step = step_of(exposure_us or 1.0, steady_frames(frames))
        if step is not None and exposure_us is not None:
            steps.append(step)
            commanded.append(
                (exposure_us, exposure_of(series, frames) if series.reports_exposure else None)
            )
    effective: dict[float, float] = {}
    try:
        chosen, _ = flat_patches.collect(steps)
        table, how = _response(chosen, camera)
        errors = response.step_errors(chosen, table)
        effective = {
            us: us * (1 + e)
            for us, e in zip(chosen.exposures_us, errors, strict=True)
            if np.isfinite(e)
        }
    except response.ResponseError as error:
        how = f"unknown: {error}"
    lights = tuple(StepLight(us, stated, effective.get(us)) for us, stated in commanded)
    relative = [value / us - 1 for us, value in effective.items()]
    rms = float(np.sqrt(np.mean(np.square(relative)))) if len(relative) > 2 else None
    return lights, rms, how


def _response(chosen: PatchCodes, camera: str | None) -> tuple[Array, str]:
    """The camera file's curve; without one, what explains these very steps best."""
    if camera is not None and Path(camera).exists():
        given = cameras.load(camera).response
        if given is not None:
            return given, f"of {camera}"
    return response.fit(chosen).table, "fitted to these steps"


def show(report: Report) -> None:
    """Print a report for the eye."""
    console, f = view.console(), report.obedience
    table = Table(box=None)
    for title in ("commanded µs", "stated µs", "effective µs", "error"):
        table.add_column(title, justify="right")
    for step in sorted(report.steps, key=lambda step: step.commanded_us):
        error = None if step.effective_us is None else step.effective_us / step.commanded_us - 1
        table.add_row(
            f"{step.commanded_us:g}",
            "-" if step.stated_us is None else f"{step.stated_us:g}",
            "-" if step.effective_us is None else f"{step.effective_us:.4g}",
            "-" if error is None else f"{100 * error:+.1f} %",
        )
    console.print(table)
    console.print(f"\nfollows commands: {f.obeyed} of {f.expected} changes seen")
    if f.delays():
        console.print(
            f"delay: {f.delay_frames} frames ({min(f.delays())} to {max(f.delays())} over "
            f"{len(f.delays())} changes)" + (", fading over several frames" if f.gradual else "")
        )
    console.print(
        "effective exposure: "
        + ("unknown" if report.linearity_error is None
           else f"within {100 * report.linearity_error:.1f} % (RMS) of what was commanded")
        + f"; response {report.response}"
    )  # fmt: skip
