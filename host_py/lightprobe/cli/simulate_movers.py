"""`lightprobe simulate`: options of people and things that move around the probe."""

from __future__ import annotations

from typing import Annotated

import typer

from lightprobe.cli import check
from lightprobe.errors import UsageError
from lightprobe.sim.movers import Movers

_degrees = check.number(0, 90, "degrees")

Walkers = Annotated[
    int, typer.Option(min=0, max=16, help="So many people walk to and fro around the probe.")
]
Distance = Annotated[
    float,
    typer.Option(callback=check.number(0.26, 100, "metres"), help="They pass it so near."),
]
Speed = Annotated[
    float,
    typer.Option(callback=check.number(0.01, 10, "metres a second"), help="At this speed."),
]
Bearing = Annotated[
    float,
    typer.Option(
        callback=check.number(-360, 360, "degrees"),
        help="Azimuth at which the first is nearest, to the right of forward; others: all around.",
    ),
]
Height = Annotated[
    float,
    typer.Option(callback=check.number(0.5, 3, "metres"), help="So tall; the probe is at 1.4 m."),
]
Albedo = Annotated[
    str, typer.Option(metavar="SHARE,…", help="Of light that jackets reflect; 1st walker, 2nd, …")
]
Stand = Annotated[
    float,
    typer.Option(
        callback=check.number(0, 3600, "seconds"), help="They stand so long where they are nearest."
    ),
]
DoorPeriod = Annotated[
    float,
    typer.Option(
        callback=check.number(0, 3600, "seconds"),
        help="A door opens, and closes half of this later, again and again; 0: there is none.",
    ),
]
DoorGain = Annotated[
    float, typer.Option(callback=check.number(0, 100), help="So much brighter it is behind it.")
]
LeavesSize = Annotated[
    float,
    typer.Option(callback=_degrees, help="Leaves flutter in a square so wide; 0: there are none."),
]
LeavesRate = Annotated[
    float, typer.Option(callback=check.number(0, 20, "Hz"), help="To and fro so often.")
]
ScreenWidth = Annotated[
    float,
    typer.Option(callback=_degrees, help="A screen so wide plays a film; 0: there is none."),
]


def albedos(text: str) -> tuple[float, ...]:
    """Parse albedos with commas between; raises UsageError."""
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = (-1.0,)
    if not all(0 <= one <= 1 for one in found):
        raise UsageError(f"simulate: --walker-albedo {text}: expected 0…1, as 0.05,0.7")
    return found


DEFAULT = Movers()
ALBEDO = ",".join(map(str, DEFAULT.walker_albedo))
