"""`lightprobe control`: questions and faults to a running simulator (proto/sim.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lightprobe.sim import control

SocketPath = Annotated[Path, typer.Argument(help="Socket given to `simulate --control`.")]

app = typer.Typer(
    help="Steer a running simulator: faults, light, status.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command("status")
def status(path: SocketPath) -> None:
    """Print counters, and what is true now of world, wheel and ring, as JSON."""
    typer.echo(control.send(path, "status"))


@app.command("inject-fault")
def inject_fault(
    path: SocketPath,
    faults: Annotated[str, typer.Argument(metavar="K=V&…", help="As for simulate --faults.")],
) -> None:
    """Inject faults from now on; a fault ends with its neutral value (mostly 0)."""
    typer.echo(control.send(path, f"faults {faults}"))


@app.command("light")
def light(
    path: SocketPath,
    lux: Annotated[
        str,
        typer.Argument(
            metavar="LUX|scene",
            help="Illuminance in lux, or `scene`: the light of the scene again.",
        ),
    ],
) -> None:
    """Put the same light on all nine sensors, like a light box."""
    typer.echo(control.send(path, f"light {lux}"))


@app.command("scene")
def scene(
    path: SocketPath,
    which: Annotated[
        str,
        typer.Argument(metavar="N|all", help="Its place among --scenes; all: in turn again."),
    ],
) -> None:
    """Keep one scene from now on."""
    typer.echo(control.send(path, f"scene {which}"))


@app.command("card")
def card(
    path: SocketPath,
    where: Annotated[
        str,
        typer.Argument(
            metavar="AZ,EL,RADIUS[,R,G,B]|none",
            help="Direction and size in degrees; its albedo, else black. 0,0,180: a lens cap.",
        ),
    ],
) -> None:
    """Hold a round card before the lens from now on: a shade, a coloured thing, or a cap."""
    typer.echo(control.send(path, f"card {where}"))


@app.command("get")
def get(
    path: SocketPath,
    name: Annotated[str, typer.Argument(help="Name of the number, like wheel_deg.")],
) -> None:
    """Print a number of the simulated box."""
    typer.echo(control.send(path, f"get {name}"))


@app.command("press")
def press(
    path: SocketPath,
    button: Annotated[
        str, typer.Argument(metavar="BUTTON", help="shutter, mode, playback or capture.")
    ],
) -> None:
    """Press a button of the simulated THETA (simulate --osc)."""
    typer.echo(control.send(path, f"press {button}"))
