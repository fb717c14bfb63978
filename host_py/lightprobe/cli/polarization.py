"""`lightprobe polarization`: how the light is polarized, of a running probe or of pictures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from lightprobe.cli import check
from lightprobe.cli.estimate import CameraName, Film, parse_angles, parse_exposures, parse_film
from lightprobe.client import DEFAULT_URI, Client
from lightprobe.errors import UsageError
from lightprobe.estimate import PolarizationMap
from lightprobe.evaluate import offline
from lightprobe.imaging import stokes
from lightprobe.wire import Subscription

_SCHEMES = ("tcp:", "unix:", "ws:", "wss:", "http:", "https:")


def command(
    what: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[URI|FILE…]",
            help="A running probe (tcp:HOST:PORT, unix:PATH, …), by default that of this machine; "
            "or pictures: HDR, EXR, PFM, JPEG or PNG.",
        ),
    ] = None,
    wheel_deg: Annotated[
        str | None,
        typer.Option(metavar="A,B,C,…", help="Pictures: angle of the polarizer in each file."),
    ] = None,
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
    sweep: Annotated[
        bool,
        typer.Option("--sweep", help="Probe: let the polarizer visit all its angles first."),
    ] = False,
    wait_s: Annotated[
        float,
        typer.Option(
            "--wait",
            callback=check.number(0, 3600, "seconds"),
            help="Probe: seconds to wait for the sweep and for the picture.",
        ),
    ] = 60.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON.")] = False,
) -> None:
    """Write how the light is polarized, as a running probe knows it or as pictures show it.

    s0.pfm (light without the film), dolp.png (white: wholly polarized), aolp.png (hue: angle,
    saturation: degree, value: light) and stokes.npz, a scene for the simulator. What is not known
    is black: pixels that are clipped at all but two angles, or see the film edge-on. A running
    probe gives cells of 3 degrees, of luminance, and only with lightprobed --publish-polarization.
    Of several exposures at each angle, the short ones tell of the lamps and the long ones of the
    dark.
    Example: lightprobe polarization tcp:127.0.0.1:7700 --sweep --out room
    Example: lightprobe polarization a.jpg b.jpg c.jpg d.jpg --wheel-deg 0,45,90,135 --out room
    """
    names = what or [DEFAULT_URI]
    if names[0].startswith(_SCHEMES):
        if len(names) > 1 or wheel_deg is not None:
            raise UsageError(f"polarization: {names[0]}: expected one probe, or pictures alone")
        live = _ask(names[0], sweep, wait_s)
        facts: dict[str, Any] = {"sweeps": live.sweeps}
        facts["capture_time_unix_ns"] = live.capture_time_unix_ns
        _report(as_polarization(live), out, as_json, facts)
        return
    if wheel_deg is None:
        raise UsageError("polarization: pictures need --wheel-deg: the angle of each, like 0,45,90")
    if sweep:
        raise UsageError("polarization: --sweep is for a running probe, not for pictures")
    _report(_measure(names, wheel_deg, exposure_us, camera, film), out, as_json, {})


def _measure(
    names: Sequence[str], wheel_deg: str, exposure_us: str | None, camera: str, film: str | None
) -> stokes.Polarization:
    """Of pictures."""
    angles, sheet = parse_angles(wheel_deg), parse_film(film)
    stokes.check_angles(angles, len(names))
    lens = offline.load_camera(camera)
    files = [Path(name) for name in names]
    pictures = stokes.read(files, lens, parse_exposures(exposure_us))
    found = stokes.measure(pictures, angles, lens, sheet)
    if not np.isfinite(found.dolp).any():
        raise UsageError("polarization: no pixel is known: the pictures are clipped everywhere")
    return found


def _ask(uri: str, sweep: bool, wait_s: float) -> PolarizationMap:
    """Of a running probe."""
    with Client(uri, Subscription(rate_hz=1, sh_order=0, max_lights=0)) as probe:
        if sweep:
            typer.echo(f"{probe.uri}: the polarizer visits its angles…", err=True)
            probe.sweep(wait_s)
        live = probe.polarization(wait_s)
        if not np.isfinite(live.s0).any():
            raise UsageError(
                f"{probe.uri}: polarization: nothing is known yet: let the polarizer visit its "
                "angles with --sweep"
            )
    return live


def as_polarization(live: PolarizationMap) -> stokes.Polarization:
    """Grey pictures of a probe's map, one pixel for each cell."""
    light = np.stack([live.s0, live.s0 * live.q, live.s0 * live.u])
    covariance = np.zeros((*live.s0.shape, 3, 3))
    covariance[..., 1, 1] = covariance[..., 2, 2] = (live.s0 * live.sigma) ** 2
    grey = np.repeat(light[..., None], 3, axis=-1).astype(np.float32)
    return stokes.Polarization(grey, covariance.astype(np.float32))


def _report(found: stokes.Polarization, out: Path, as_json: bool, facts: dict[str, Any]) -> None:
    """Write the pictures and say what is in them."""
    dolp = found.dolp
    known = np.isfinite(dolp)
    written = found.write(out)
    sigma = float(np.median(found.dolp_sigma[known]))
    share, median = float(known.mean()), float(np.median(dolp[known]))
    most = float(np.percentile(dolp[known], 99))
    names = [str(path) for path in written]
    if as_json:
        summary = facts | {
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
