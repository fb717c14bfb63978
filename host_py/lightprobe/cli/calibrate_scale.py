"""`lightprobe calibrate scale`: lux and cd/m² from a camera's relative light."""

from __future__ import annotations

import json
import time
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import Progress

from lightprobe.calibrate import camera_file, scale
from lightprobe.calibrate.files import CalibrationError
from lightprobe.cli import calibrate, check
from lightprobe.client import DEFAULT_URI, Client
from lightprobe.errors import UsageError
from lightprobe.estimate import Estimate
from lightprobe.wire import Subscription

#: Names of directions, in the probe frame.
FACING = {
    "up": (0.0, 1.0, 0.0), "down": (0.0, -1.0, 0.0), "front": (0.0, 0.0, -1.0),
    "back": (0.0, 0.0, 1.0), "right": (1.0, 0.0, 0.0), "left": (-1.0, 0.0, 0.0),
}  # fmt: skip
#: Of the picture, for a camera file that does not exist yet: an equirectangular one is scaled.
_SIZE_PX = (1920, 960)


def command(
    probe: Annotated[str, typer.Argument(metavar="URI", help="The probe.")] = DEFAULT_URI,
    output: calibrate.Output = None,
    lux: Annotated[
        float | None,
        typer.Option(
            callback=check.number(0, 2e5, "lux", above=True),
            help="What a lux meter beside the camera reads; default: the probe's ring.",
        ),
    ] = None,
    facing: Annotated[
        str, typer.Option(metavar="|".join(FACING), help="Where the lux meter looks.")
    ] = "up",
    seconds: Annotated[
        float,
        typer.Option(callback=check.number(0.1, 1e5, "seconds"), help="Average so long."),
    ] = 3.0,
    as_json: calibrate.AsJson = False,
) -> None:
    """Measure the luminance of radiance 1, so that light is sent in lux and cd/m².

    Compares what the camera sees with a lux meter (--lux), or with the ring of light sensors.
    Choose steady light in which nothing clips, and do not stand in it. --output writes the result
    into the camera file of the probe: start the daemon with it (--camera).
    Example: lightprobe calibrate scale --lux 412 --facing up --output my.camera
    """
    if facing not in FACING:
        raise UsageError(
            f"calibrate: scale: --facing {facing}: expected one of {', '.join(FACING)}"
        )
    estimates = listen(probe, seconds, with_ring=lux is None)
    if lux is None:
        found = scale.by_ring(estimates)
    else:
        found = scale.by_meter(estimates, lux, np.array(FACING[facing]))
    report(found, as_json)
    if output is not None:
        values = {"cd_m2_per_unit": f"{found.cd_m2_per_unit:.6g}", "sigma": f"{found.sigma:.3g}"}
        camera_file.save(output, _SIZE_PX, "photometry", values)
        typer.echo(f"written: {output}: [photometry]", err=True)


def listen(uri: str, seconds: float, *, with_ring: bool) -> list[Estimate]:
    """Estimates of so many seconds, under a progress bar on stderr."""
    wish = Subscription(smoothing="RAW", sh_order=4, max_lights=8)
    with Client(uri, wish) as client, Progress(
        console=Console(stderr=True), transient=True
    ) as bar:  # fmt: skip
        task = bar.add_task("light", total=seconds)
        estimates = [client.receive(10)]
        if with_ring and client.hello is not None and not client.hello.has_ring:
            raise CalibrationError(
                f"calibrate: scale: {uri}: the probe has no ring of light sensors: give a lux "
                "meter's reading with --lux"
            )
        started = time.monotonic()
        while (passed := time.monotonic() - started) < seconds:
            bar.update(task, completed=passed)
            estimates.append(client.receive(10))
    return estimates


def report(found: scale.Scale, as_json: bool) -> None:
    """Print the result."""
    if as_json:
        shape = {
            "cd_m2_per_unit": found.cd_m2_per_unit, "sigma": found.sigma,
            "estimates_used": found.estimates_used,
        }  # fmt: skip
        typer.echo(json.dumps(shape, indent=2))
        return
    typer.echo(
        f"radiance 1 is {found.cd_m2_per_unit:.4g} cd/m², within {100 * found.sigma:.1f} % "
        f"(1 sigma; {found.estimates_used} estimates)"
    )
