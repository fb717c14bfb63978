"""`lightprobe polarization`: how every pixel of pictures through a polarizer is polarized."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from lightprobe.cli.estimate import CameraName, Film, parse_angles, parse_exposures, parse_film
from lightprobe.errors import UsageError
from lightprobe.evaluate import offline
from lightprobe.imaging import stokes


def command(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE…", help="HDR, EXR, PFM, JPEG or PNG."),
    ],
    wheel_deg: Annotated[
        str, typer.Option(metavar="A,B,C,…", help="Angle of the polarizer in each file.")
    ],
    exposure_us: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,…",
            help="Exposure of each 8-bit file, in microseconds; default: one for all of them.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where the pictures go.")] = Path(
        "polarization"
    ),
    camera: CameraName = "equirect",
    film: Film = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON.")] = False,
) -> None:
    """Write how the light of pictures through a polarizer is polarized.

    s0.pfm (light without the film), dolp.png (white: wholly polarized), aolp.png (hue: angle,
    saturation: degree, value: light) and stokes.npz, a scene for the simulator. Pixels that are
    clipped at all but two angles, or see the film edge-on, are black. Of several exposures at each
    angle, the short ones tell of the lamps and the long ones of the dark.
    Example: lightprobe polarization a.jpg b.jpg c.jpg d.jpg --wheel-deg 0,45,90,135 --out room
    """
    angles, sheet = parse_angles(wheel_deg), parse_film(film)
    stokes.check_angles(angles, len(files))
    lens = offline.load_camera(camera)
    pictures = stokes.read(files, lens, parse_exposures(exposure_us))
    found = stokes.measure(pictures, angles, lens, sheet)
    dolp = found.dolp
    known = np.isfinite(dolp)
    if not known.any():
        raise UsageError("polarization: no pixel is known: the pictures are clipped everywhere")
    written = found.write(out)
    sigma = float(np.median(found.dolp_sigma[known]))
    share, median = float(known.mean()), float(np.median(dolp[known]))
    most = float(np.percentile(dolp[known], 99))
    names = [str(path) for path in written]
    if as_json:
        summary = {
            "files": names,
            "known_share": round(share, 4),
            "dolp_median": round(median, 4),
            "dolp_sigma_median": round(sigma, 4),
            "dolp_99_percent": round(most, 4),
        }
        typer.echo(json.dumps(summary, indent=2))
        return
    typer.echo(f"wrote {', '.join(names)}")
    typer.echo(
        f"{100 * share:.0f} % of the pixels are known; "
        f"DoLP: median {median:.3f}, 99 % below {most:.3f}, known within {sigma:.3f} (1 sigma)"
    )
