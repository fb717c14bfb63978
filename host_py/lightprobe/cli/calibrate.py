"""What the sub-commands of `lightprobe calibrate` share: taking a series, and its camera file."""

from __future__ import annotations

import contextlib
import re
import tempfile
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from lightprobe import __version__
from lightprobe.calibrate.exposure_series import ExposureSeries, shoot
from lightprobe.cli import check
from lightprobe.errors import UsageError

_SOURCE = re.compile(r"[a-z][a-z0-9_]*:")

SourceCamera = Annotated[
    str | None,
    typer.Option(
        "--camera",
        metavar="equirect|FILE",
        help="Camera file with settings for the driver; default: --output, if it exists.",
    ),
]
Output = Annotated[
    Path | None,
    typer.Option(
        metavar="CAMERA.camera",
        callback=check.new_file(makes_folders=True),
        help="Write the result into this camera file.",
    ),
]
Keep = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        callback=check.new_folder,
        help="Keep the frames here; default: they are deleted.",
    ),
]
Patience = Annotated[
    float,
    typer.Option(
        callback=check.number(0, unit="seconds", above=True),
        help="Seconds without a frame after which to give up.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


def is_source(text: str) -> bool:
    """Tell a source (v4l2:/dev/video0) from a file name."""
    return _SOURCE.match(text) is not None


@contextlib.contextmanager
def series(
    source: str,
    exposures_us: Sequence[float],
    *,
    frames: int,
    camera: str | None,
    output: Path | None,
    keep: Path | None,
    patience_s: float,
) -> Iterator[ExposureSeries]:
    """A series of a source, under a progress bar on stderr; its frames last as long as the block.

    A source that ends (file:) gives its frames as they come.
    """
    if keep is not None and keep.exists() and any(keep.iterdir()):
        raise UsageError(f"calibrate: --keep {keep}: not empty: name a new folder")
    if camera is None:
        camera = str(output) if output is not None and output.exists() else "equirect"
    finite = source.startswith("file:")
    total = None if finite else frames * len(exposures_us)
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    with tempfile.TemporaryDirectory(prefix="lightprobe-") as name:
        folder = keep or Path(name) / "series"
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(f"frames of {source}", total=total)
            taken = shoot(
                source, folder, () if finite else exposures_us, frames=0 if finite else frames,
                camera=camera, patience_s=patience_s,
                progress=lambda count: bar.update(task, completed=count),
            )  # fmt: skip
        yield taken


def remark(what: str) -> str:
    """Say for a file when and by what it was made."""
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    return f"{what}, lightprobe {__version__}, {now}"
