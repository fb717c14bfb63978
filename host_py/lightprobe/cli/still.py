"""`lightprobe still`: a set of stills now, from a probe with a camera for stills (ptp:)."""

from __future__ import annotations

from typing import Annotated

import typer

from lightprobe.cli import check
from lightprobe.client import DEFAULT_URI, Client


def command(
    uri: Annotated[str, typer.Argument(help="tcp:HOST:PORT or unix:PATH.")] = DEFAULT_URI,
    timeout_s: Annotated[
        float,
        typer.Option(
            "--timeout",
            callback=check.number(0, 600, "seconds", above=True),
            help="Wait for the probe for so long.",
        ),
    ] = 10.0,
) -> None:
    """Have the probe's cameras for stills (--source=ptp:) take a set of exposures now.

    The set counts when the camera has developed it, some seconds later. Example:
    lightprobe still tcp:127.0.0.1:7700
    """
    with Client(uri) as probe:
        cameras = probe.take_stills(timeout_s)
    typer.echo(
        f"still: {cameras} camera{'s' if cameras > 1 else ''} asked: a set counts in some seconds"
    )
