"""`lightprobe export`: the light of a probe as a file that any renderer reads."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated

import typer

from lightprobe.cli import check, whole_file
from lightprobe.client import DEFAULT_URI, Client
from lightprobe.errors import UsageError
from lightprobe.estimate import Estimate, EstimateFlag, flag_names
from lightprobe.imaging import environment, gltf, image
from lightprobe.wire import Subscription

_SUFFIXES = (".hdr", ".exr", ".pfm", ".glb")


def _file(context: typer.Context, option: typer.CallbackParam, value: Path) -> Path:
    return check.new_file(*_SUFFIXES)(context, option, value) or value


def command(
    file: Annotated[
        Path,
        typer.Argument(callback=_file, metavar="FILE", help="NAME.hdr, .exr, .pfm or .glb."),
    ],
    uri: Annotated[
        str, typer.Option("--from", metavar="URI", help="tcp:HOST:PORT or unix:PATH.")
    ] = DEFAULT_URI,
    width_px: Annotated[
        int,
        typer.Option(
            "--width", min=16, max=8192, help="Width of the map; the height is half of it."
        ),
    ] = 1024,
    order: Annotated[int, typer.Option(min=0, max=4, help="Highest SH order.")] = 2,
    lights: Annotated[int, typer.Option(min=0, max=8, help="Maximum number of lamps listed.")] = 8,
    area_lights: Annotated[
        bool, typer.Option("--area-lights", help="List windows, soft boxes and the like, too.")
    ] = False,
    key_light: Annotated[
        bool,
        typer.Option("--key-light", help="Add KEY, one light for what the listed ones leave."),
    ] = False,
    wait_s: Annotated[
        float,
        typer.Option(
            "--wait",
            callback=check.number(0, 3600, "seconds"),
            help="Seconds to wait for an estimate.",
        ),
    ] = 10.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the estimate as JSON.")] = False,
) -> None:
    """Write the light of a probe, as it is now, for programs that have no client.

    .hdr, .exr and .pfm: an equirectangular environment map, scene-linear, the SH with each lamp as
    a disc of its size; the centre of the picture is forward (−Z). .glb: the lamps as directional
    lights (KHR_lights_punctual, in lux when the probe is calibrated). A former file is replaced.
    Example: lightprobe export room.hdr --from tcp:192.168.1.20:7700 --width 2048
    """
    if width_px % 2:
        raise UsageError(f"export: --width {width_px}: expected an even number")
    wish = Subscription(
        sh_order=order, max_lights=lights, area_lights=area_lights, key_light=key_light
    )
    estimate = receive(uri, wish, wait_s)
    notes = write(estimate, file, width_px)
    scale = "lux and cd/m²" if estimate.cd_m2_per_unit else "relative units: not calibrated"
    typer.echo(
        f"written: {file}: {len(estimate.lights)} lamps, SH of order {estimate.sh.order}; {scale}",
        err=True,
    )
    for note in [*notes, *(f"flag {name}" for name in flag_names(estimate.flags))]:
        typer.echo(f"note: {note}", err=True)
    if as_json:
        typer.echo(json.dumps(estimate.to_json(), indent=2))


def receive(uri: str, wish: Subscription, wait_s: float) -> Estimate:
    """Wait for an estimate that is whole: of the order asked for, from all exposures.

    When none comes in time, the last that came; raises ProbeTimeout when none came at all.
    """
    deadline_s = time.monotonic() + wait_s
    with Client(uri, wish) as client:
        estimate = client.receive(wait_s)
        while not _whole(client, estimate, wish) and time.monotonic() < deadline_s:
            estimate = client.receive(max(0.0, deadline_s - time.monotonic()))
    return estimate


def _whole(client: Client, estimate: Estimate, wish: Subscription) -> bool:
    best = client.hello.max_sh_order if client.hello else wish.sh_order
    incomplete = EstimateFlag.BRACKET_INCOMPLETE in estimate.flags
    return not incomplete and estimate.sh.order >= min(wish.sh_order, best)


def write(estimate: Estimate, file: Path, width_px: int) -> list[str]:
    """Write a file of the kind that its name says, whole or not at all; gives notes on it."""
    notes: list[str] = []
    if file.suffix.lower() == ".glb":
        data = gltf.glb(estimate)
        if estimate.lights or estimate.key:
            notes.append(
                "the ambient light is only in extras: export a map to get all of the light"
            )
    else:
        radiance, notes = environment.environment_map(estimate, width_px)
        # Photometric where the probe is calibrated, as the intensities of .glb are.
        data = image.encode(file.suffix.lower(), radiance * (estimate.cd_m2_per_unit or 1.0))
    whole_file.write("export", file, data)
    return notes
