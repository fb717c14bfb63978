"""Options of commands that take one estimate of a probe: what is wanted, and how long to wait."""

from __future__ import annotations

from typing import Annotated

import typer

from lightprobe.cli import check

Order = Annotated[int, typer.Option(min=0, max=4, help="Highest SH order.")]
Lights = Annotated[int, typer.Option(min=0, max=8, help="Maximum number of lamps listed.")]
Wait = Annotated[
    float,
    typer.Option(
        "--wait",
        callback=check.number(0, 3600, "seconds"),
        help="Seconds to wait for an estimate.",
    ),
]
