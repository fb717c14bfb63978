"""Options of commands that give all light as a number of lights."""

from __future__ import annotations

from typing import Annotated

import typer

from lightprobe.errors import UsageError
from lightprobe.imaging.constellation import CUTS, MOST, Cut

Constellation = Annotated[
    int | None,
    typer.Option(
        metavar="N", min=1, max=MOST,
        help="Give all of the light as N lights, for renderers without SH: the lamps, and the rest "
        "cut into regions.",
    ),
]  # fmt: skip
ConstellationCut = Annotated[
    str, typer.Option("--cut", metavar="|".join(CUTS), help="How the rest is cut.")
]


def cut_of(text: str) -> Cut:
    """Read `--cut`; raises UsageError."""
    for cut in CUTS:
        if text == cut:
            return cut
    raise UsageError(f"--cut {text}: expected {' or '.join(CUTS)}")
