"""The command `lightprobe`: one sub-command per file of this package."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from lightprobe import __version__
from lightprobe.cli import (
    calibrate_exposure,
    calibrate_response,
    calibrate_ring,
    calibrate_supply,
    calibrate_wheel,
    control,
    demo,
    doctor,
    estimate,
    evaluate,
    mcu,
    simulate,
    watch,
)
from lightprobe.errors import LightprobeError

app = typer.Typer(
    help="Measure real light for augmented reality: client, simulator and tool box of the probe.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("estimate")(estimate.command)
app.command("evaluate")(evaluate.command)
app.command("simulate")(simulate.command)
app.add_typer(mcu.app, name="mcu")
app.add_typer(control.app, name="control")
app.command("watch")(watch.command)
app.command("demo")(demo.command)
app.command("doctor")(doctor.command)
calibrate = typer.Typer(
    help="Camera (exposure, response), polarizer wheel, ring of light sensors, supply."
)
calibrate.command("supply")(calibrate_supply.command)
calibrate.command("wheel")(calibrate_wheel.command)
calibrate.command("ring")(calibrate_ring.command)
calibrate.command("exposure")(calibrate_exposure.command)
calibrate.command("response")(calibrate_response.command)
app.add_typer(calibrate, name="calibrate", no_args_is_help=True)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"lightprobe {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print it.")
    ] = False,
) -> None:
    """Take options that stand before the sub-command."""


def main() -> None:
    """Run; an error is one message on stderr and an exit code: 1 failed, 2 makes no sense."""
    try:
        app()
    except LightprobeError as error:
        print(f"lightprobe: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
