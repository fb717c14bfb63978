"""`lightprobe calibrate polarizer`: the film on the wheel, from pictures at several angles."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from lightprobe.calibrate import camera_file, polarizer
from lightprobe.calibrate.polarizer import Found, Region, Target
from lightprobe.cli import calibrate, check
from lightprobe.cli.estimate import CameraName, parse_angles, parse_exposures
from lightprobe.errors import UsageError
from lightprobe.evaluate import offline
from lightprobe.imaging import stokes

#: What the light of each target is known to be.
TARGETS = {
    "screen": Target(dolp=1.0),
    "floor": Target(aolp_deg=0.0),
    "window": Target(aolp_deg=90.0),
    "lamp": Target(dolp=0.0),
}


def command(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE…", help="Pictures through the film, all of one exposure."),
    ],
    wheel_deg: Annotated[
        str, typer.Option(metavar="A,B,C,…", help="Angle of the wheel in each file.")
    ],
    target: Annotated[
        str,
        typer.Option(
            metavar="|".join(TARGETS),
            help="screen: an LCD screen that shows white, tells the extinction; floor: something "
            "bright mirrored in what lies flat, tells the offset; window: the same in what stands "
            "upright straight before the camera; lamp: light that is not polarized, tells the "
            "index off the lens' axis.",
        ),
    ] = "screen",
    at: Annotated[
        str, typer.Option(metavar="AZ,EL", help="Where the target is: degrees to the right, up.")
    ] = "0,0",
    radius: Annotated[
        float,
        typer.Option(
            callback=check.number(0.1, 30, "degrees"), help="How much of it is looked at, degrees."
        ),
    ] = 4.0,
    aolp: Annotated[
        float | None,
        typer.Option(
            callback=check.number(0, 180, "degrees"),
            help="How its light is known to be polarized: 0 horizontally, 90 upright.",
        ),
    ] = None,
    without: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The same without the film: tells the transmission."),
    ] = None,
    exposure_us: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,…",
            help="Exposure of each file in microseconds, of --without last; default: all alike.",
        ),
    ] = None,
    index: Annotated[
        float | None,
        typer.Option(
            callback=check.number(1, 2, ""),
            help="Refractive index of the film, where the target does not tell it; default: that "
            "of the camera file, or 1.5.",
        ),
    ] = None,
    camera: CameraName = "equirect",
    output: calibrate.Output = None,
    as_json: calibrate.AsJson = False,
) -> None:
    """Find the film's extinction ratio, transmission, index and how it sits on the wheel.

    Turn the wheel (lightprobe mcu move) and take a picture at each of four angles or more, the
    first one once more at the end; exposure and white balance fixed, nothing moves. What was found
    goes into the camera file's [polarizer]: run it again with another target for the rest.
    Example: lightprobe calibrate polarizer 0.png 45.png 90.png 135.png --wheel-deg 0,45,90,135
    --target floor --at 0,-34 --output my.camera
    """
    wanted = known(target, aolp)
    azimuth, elevation = parse_direction(at)
    angles = parse_angles(wheel_deg)
    stokes.check_angles(angles, len(files))
    lens = offline.load_camera(camera)
    pictures = stokes.read([*files, *filter(None, [without])], lens, parse_exposures(exposure_us))
    found = polarizer.fit(
        pictures[: len(files)], angles, lens, wanted, Region(azimuth, elevation, radius),
        pictures[-1] if without else None, index,
    )  # fmt: skip
    report(found, as_json)
    if output is not None and found.values():
        height, width, _ = pictures[0].light.shape
        camera_file.save(output, (width, height), "polarizer", found.values())
        typer.echo(f"written: {output}: [polarizer]", err=True)


def known(name: str, aolp_deg: float | None) -> Target:
    """What is known of a target's light; raises UsageError."""
    if name not in TARGETS:
        raise UsageError(
            f"calibrate: polarizer: --target {name}: expected one of {', '.join(TARGETS)}"
        )
    return TARGETS[name] if aolp_deg is None else Target(TARGETS[name].dolp, aolp_deg)


def parse_direction(text: str) -> tuple[float, float]:
    """Read `AZ,EL` in degrees; raises UsageError."""
    try:
        azimuth, elevation = (float(word) for word in text.split(","))
    except ValueError:
        azimuth, elevation = 0.0, 180.0
    if not (abs(azimuth) <= 180 and abs(elevation) <= 90):
        raise UsageError(
            f"calibrate: polarizer: --at {text}: expected azimuth (-180…180) and elevation "
            "(-90…90) in degrees, like 0,-34"
        )
    return azimuth, elevation


def report(found: Found, as_json: bool) -> None:
    """Print the result."""
    if as_json:
        typer.echo(json.dumps(asdict(found) | {"is_turned": found.is_turned}, indent=2))
        return
    typer.echo(
        f"of the target's light {100 * found.modulation:.2f} ± {100 * found.modulation_sigma:.2f} "
        f"% follows the film; the pictures fit within {100 * found.residual:.2f} %"
    )
    if found.extinction_ratio is not None:
        least = "at least " if found.extinction_is_bound else ""
        typer.echo(f"extinction ratio  {least}{found.extinction_ratio:.0f}")
    if found.transmission is not None:
        typer.echo(f"transmission      {found.transmission:.3f} ± {found.transmission_sigma:.3f}")
    if found.offset_deg is not None:
        typer.echo(f"offset            {found.offset_deg:+.2f} ± {found.offset_sigma_deg:.2f}°")
    if found.index is not None:
        typer.echo(f"index             {found.index:.2f} ± {found.index_sigma:.2f}")
    if found.is_turned:
        typer.echo(
            "the film has been put in about a quarter turn wrong: turn it, or go on with this "
            "offset in the camera file"
        )
