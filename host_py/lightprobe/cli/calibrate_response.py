"""`lightprobe calibrate response`: what the camera's codes mean, from a bracket."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from lightprobe.calibrate import camera_file, flat_patches
from lightprobe.calibrate import response_curve as response
from lightprobe.calibrate.exposure_series import ExposureSeries, SeriesError
from lightprobe.calibrate.flat_patches import Step, exposure_of, steady_frames, step_of
from lightprobe.calibrate.response_curve import CHANNELS, PatchCodes, Response
from lightprobe.cli import calibrate, check, view
from lightprobe.errors import UsageError
from lightprobe.imaging import image

#: Neighbours at ratios of 1.5 and 2.2 in turn: with one ratio alone, a curve with ripples that
#: repeat at that ratio would explain the pictures as well (Grossberg and Nayar 2003).
SCHEDULE_US = tuple(round(8 * f, 3) for f in np.cumprod([1.0] + [1.5, 2.2] * 7).tolist())


def command(
    what: Annotated[
        list[str],
        typer.Argument(metavar="SOURCE|FILE…", help="A camera, or pictures of one scene."),
    ],
    exposures: Annotated[
        str | None,
        typer.Option(metavar="A,B,…", help="Exposure of each FILE, in microseconds."),
    ] = None,
    output: calibrate.Output = None,
    camera: calibrate.SourceCamera = None,
    plot: Annotated[Path | None, check.plot("Draw curve and residuals (png, svg, pdf).")] = None,
    frames: Annotated[int, typer.Option(min=8, max=200, help="Frames after each command.")] = 12,
    keep: calibrate.Keep = None,
    patience_s: calibrate.Patience = 15.0,
    as_json: calibrate.AsJson = False,
) -> None:
    """Find the response: the linear light of each of the 256 codes, per channel.

    Needs one scene at rest, with large even surfaces from dark to bright, at many exposures: from
    a camera that obeys (check with `calibrate exposure`), or as pictures with known exposures.
    --output writes the table beside a camera file and names it there
    (docs/users/camera_calibration.md).
    Example: lightprobe calibrate response v4l2:/dev/video0 --output my.camera --plot curve.png
    """
    if len(what) == 1 and calibrate.is_source(what[0]):
        if exposures is not None:
            raise UsageError("calibrate: --exposures is for files only: leave it out for a camera")
        with calibrate.series(
            what[0], SCHEDULE_US, frames=frames, camera=camera, output=output, keep=keep,
            patience_s=patience_s,
        ) as series:  # fmt: skip
            steps, processing = of_series(series), series.processing
    else:
        steps, processing = of_files([Path(name) for name in what], exposures), None
    chosen, notes = flat_patches.collect(steps)
    result = response.fit(chosen)
    for note in notes + left_out(chosen, result):
        typer.echo(f"note: {note}", err=True)
    if as_json:
        typer.echo(json.dumps(to_json(chosen, result), indent=2))
    else:
        show(chosen, result)
    if plot is not None:
        from lightprobe.calibrate import plot as calibrate_plot  # matplotlib is slow to load

        calibrate_plot.draw(chosen, result, plot)
        typer.echo(f"plot: {plot}", err=True)
    if output is not None:
        rows, columns, _ = steps[0].mean.shape
        size_px = columns * flat_patches.BLOCK_PX, rows * flat_patches.BLOCK_PX
        residual = 100 * result.residual_full_scale.max()
        note = calibrate.remark(f"response, residual {residual:.2f} % of full scale")
        table = camera_file.save_response(output, size_px, result.table, note, processing)
        typer.echo(f"written: {output}: [response] table = {table.name}", err=True)
        if processing:
            typer.echo(
                f"note: the camera alters the light: {', '.join(processing)}: this response holds "
                "only as long as it does so",
                err=True,
            )


def of_series(series: ExposureSeries) -> list[Step]:
    """Steps of a series."""
    steps = []
    for group in series.steps():
        exposure_us = exposure_of(series, group)
        if exposure_us is None:
            raise SeriesError(
                "response: the frames do not report their exposure: give it as "
                "file:FOLDER?exposures_us=A,B,…"
            )
        step = step_of(exposure_us, steady_frames(group))
        if step is not None:
            steps.append(step)
    return steps


def of_files(files: Sequence[Path], exposures: str | None) -> list[Step]:
    """Steps of pictures, one each; raises UsageError when exposures and files do not fit."""
    try:
        exposures_us = [float(word) for word in exposures.split(",")] if exposures else []
    except ValueError:
        raise UsageError(
            f"calibrate: --exposures {exposures}: expected numbers, like 8,16,32"
        ) from None
    if len(exposures_us) != len(files) or not all(0 < us < np.inf for us in exposures_us):
        raise UsageError(
            f"calibrate: {len(files)} files and exposures {exposures_us}: expected microseconds "
            "above 0, one for each file: --exposures A,B,…"
        )
    steps = []
    for file, exposure_us in zip(files, exposures_us, strict=True):
        if not file.is_file():
            raise image.ImageError(f"image: {file}: open: no such file")
        step = step_of(exposure_us, [image.read_srgb8(file)])
        assert step is not None  # it has a picture
        steps.append(step)
    return steps


def left_out(chosen: PatchCodes, result: Response) -> list[str]:
    """Say which exposures the fit does not rest on."""
    return [
        f"{exposure_us:g} us left out: its light differs by {100 * error:+.0f} % from what "
        "the other exposures predict"
        for exposure_us, used, error in zip(
            chosen.exposures_us, result.used, result.step_errors, strict=True
        )
        if not used
    ]


def to_json(chosen: PatchCodes, result: Response) -> dict[str, Any]:
    """Plain values."""
    return {
        "table": result.table.tolist(),
        "residual_codes": result.residual_codes.tolist(),
        "residual_full_scale": result.residual_full_scale.tolist(),
        "exposures_us": chosen.exposures_us.tolist(),
        "exposure_errors": [None if np.isnan(e) else float(e) for e in result.step_errors],
        "used": result.used.tolist(),
        "observations": result.observations,
        "top_code": result.top,
        "lowest_code": result.lowest_code,
        "highest_code": result.highest_code,
    }


def show(chosen: PatchCodes, result: Response) -> None:
    """Print the result for the eye."""
    console = view.console()
    table = Table(box=None)
    for title in ("channel", "code 64", "code 128", "code 192", "residual codes", "of full scale"):
        table.add_column(title, justify="right")
    for c, name in enumerate(CHANNELS):
        table.add_row(
            name,
            *(f"{result.table[code, c]:.4f}" for code in (64, 128, 192)),
            f"{result.residual_codes[c]:.2f}",
            f"{100 * result.residual_full_scale[c]:.2f} %",
        )
    console.print(table)
    errors = np.abs(result.step_errors[result.used & np.isfinite(result.step_errors)])
    console.print(
        f"\n{result.observations} observations at {result.used.sum()} exposures of "
        f"{len(chosen.exposures_us)}, codes {result.lowest_code} to {result.highest_code}; "
        f"exposures within {100 * errors.max(initial=0):.1f} % of each other"
    )
