"""`lightprobe tell`: say something to a running simulator."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lightprobe.sim import control


def command(
    path: Annotated[Path, typer.Argument(help="What `simulate --control` was given.")],
    words: Annotated[list[str], typer.Argument(metavar="COMMAND…", help="See above.")],
) -> None:
    """Tell a running simulator how to misbehave, or ask it what is true.

    `faults K=V&…`: from now on (names as for simulate --faults). `status`: counters, world, wheel
    and ring, as JSON. `light LUX`: the same on all nine sensors; `light scene`: as it is. `get
    NAME`: a number of the box.
    """
    typer.echo(control.tell(path, " ".join(words)))
