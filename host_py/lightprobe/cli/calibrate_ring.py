"""`lightprobe calibrate ring`: what the nine LDRs' voltages mean."""

from __future__ import annotations

import json
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from lightprobe.calibrate import files as calibration
from lightprobe.calibrate import ring
from lightprobe.calibrate.files import CalibrationError
from lightprobe.calibrate.ring_fit import fit
from lightprobe.calibrate.ring_pairs import Watch
from lightprobe.calibrate.ring_seats import Found
from lightprobe.cli import calibrate, calibrate_ring_camera, check, view
from lightprobe.cli.mcu import Port, read_ring
from lightprobe.client import Client
from lightprobe.errors import ProbeTimeout, UsageError
from lightprobe.geometry import Array
from lightprobe.mcu import messages as mcu
from lightprobe.mcu.session import DEFAULT_PORT, Session, session

#: LDRs take up to 30 ms; a lamp or a hand much longer.
_REST_S = 0.5
_LEVEL_S, _WATCH_S = 1.0, 60.0
_METER_SIGMA, _CAMERA_SIGMA = 0.03, 0.1


def command(
    levels: Annotated[
        str | None,
        typer.Option(metavar="LUX,LUX,…", help="Known illuminances, the same on every sensor."),
    ] = None,
    against: Annotated[
        str | None,
        typer.Option(metavar="URI", help="A probe (lightprobed without --ring) to compare with."),
    ] = None,
    from_camera: Annotated[
        str | None,
        typer.Option(
            metavar="URI", help="A probe (lightprobed without --ring): turn the box before it."
        ),
    ] = None,
    port: Port = DEFAULT_PORT,
    output: Annotated[
        Path,
        typer.Option(
            metavar="FILE", callback=check.new_file(makes_folders=True), help="Write it here."
        ),
    ] = Path("ring.ini"),
    seconds: Annotated[
        float | None,
        typer.Option(
            callback=check.number(0.1, 1e5, "seconds"),
            help="Average so long per level (1); with --against (60), --from-camera (300): watch.",
        ),
    ] = None,
    cd_m2_per_unit: Annotated[
        float | None,
        typer.Option(
            callback=check.number(1e-9, 1e9), help="With a probe: its scale, if it has none."
        ),
    ] = None,
    divider_ohm: Annotated[
        float,
        typer.Option(
            callback=check.number(*ring.ALIKE_LIMITS["divider_ohm"], "ohms"),
            help="Resistor from each LDR's pin to ground.",
        ),
    ] = ring.DIVIDER_OHM,
    light_sigma: Annotated[
        float | None,
        typer.Option(
            callback=check.number(0, 10), help="Relative 1 sigma of the light; 0.03, camera 0.1."
        ),
    ] = None,
    plot: Annotated[Path | None, check.plot("With --from-camera: draw what was found.")] = None,
    as_json: calibrate.AsJson = False,
) -> None:
    """Find R10, gamma and series resistance of each sensor, from known light or from the camera.

    --levels 10,100,1000,20000 asks to set each level, all nine sensors alike (a light box, a
    luxmeter beside them), and to press Enter. Levels far apart tell gamma; one above 10000 lx (the
    sun) tells the multiplexer's resistance, without which sunlight is hardly measured. --against
    tcp:127.0.0.1:7700 takes the probe's own estimates while the light changes: let lamps be
    switched, for --seconds 60.
    --from-camera tcp:127.0.0.1:7700 needs a room with ordinary lamps and five minutes of turning
    the box: it finds where each sensor looks, too. The file is for lightprobed
    --ring='mcu:…?calibration=FILE'. The former one is kept.
    """
    if sum(way is not None for way in (levels, against, from_camera)) != 1:
        raise UsageError(
            "calibrate: ring: expected --levels LUX,LUX,… or --against URI or --from-camera URI"
        )
    if plot is not None and from_camera is None:
        raise UsageError("calibrate: ring: --plot: only with --from-camera")
    levels_lux = parse_levels(levels) if levels is not None else []
    with session(port) as link:
        if from_camera is not None:
            turned = calibrate_ring_camera.calibrate(
                link, from_camera, seconds or calibrate_ring_camera.SECONDS, cd_m2_per_unit,
                divider_ohm, plot,
            )  # fmt: skip
            save_turned(turned, output, as_json)
            return
        if against is not None:
            lux, level = pairs_with_camera(link, against, seconds or _WATCH_S, cd_m2_per_unit)
        else:
            lux, level = pairs_at_levels(link, levels_lux, seconds or _LEVEL_S)
    default = _CAMERA_SIGMA if against is not None else _METER_SIGMA
    found = fit(lux, level, default if light_sigma is None else light_sigma, divider_ohm)
    remark = calibrate.remark("lightprobe calibrate ring")
    former = calibration.save(output, f"; {remark}\n{found.text()}")
    report(found, len(lux), output, former, as_json)


def save_turned(found: Found, output: Path, as_json: bool) -> None:
    """Write the ring file, and say what is in it."""
    remark = calibrate.remark("lightprobe calibrate ring --from-camera")
    former = calibration.save(output, f"; {remark}\n{found.ring.text()}")
    seats = {
        "seat_right_deg": found.ring.seat_right_deg.tolist(),
        "seat_up_deg": found.ring.seat_up_deg.tolist(),
        "seat_sigma_deg": found.seat_sigma_deg.tolist(),
        "rms": found.rms.tolist(),
    }
    report(found.ring, found.samples, output, former, as_json, seats)


def parse_levels(text: str) -> list[float]:
    """Read `10,100,1000`; UsageError for what are no illuminances."""
    try:
        levels = [float(word) for word in text.split(",")]
    except ValueError:
        levels = []
    if not levels or not all(0 < level <= 2e5 for level in levels):
        raise UsageError(
            f"calibrate: ring: --levels {text}: expected lux above 0, like 10,100,1000,20000"
        )
    return levels


def pairs_at_levels(link: Session, levels: list[float], seconds: float) -> tuple[Array, Array]:
    """Ask for each level and read it: illuminances and levels (N, 9)."""
    rows = []
    for number, level in enumerate(levels, 1):
        print(f"{number}/{len(levels)}: {level:g} lux on all sensors, then Enter ", end="",
              file=sys.stderr, flush=True)  # fmt: skip
        if not sys.stdin.readline():
            raise CalibrationError("calibrate: ring: input ended: nobody sets the light; stopped")
        read_ring(link, _REST_S)
        values, dead, _ = read_ring(link, seconds)
        rows.append(np.where(dead, np.nan, values))
    return np.repeat(np.array(levels)[:, None], ring.SENSORS, axis=1), np.array(rows)


def pairs_with_camera(
    link: Session, uri: str, seconds: float, cd_m2_per_unit: float | None
) -> tuple[Array, Array]:
    """Watch the probe's estimates and the ring together; pairs (N, 9) of steady moments."""
    seen = Watch()
    watching = calibrate_ring_camera.watching(uri, "camera and ring", seconds)
    with watching as (client, bar, task):
        scale = _scale(client, uri, cd_m2_per_unit)
        link.rates(ring_scans=80)
        started = time.monotonic()
        for event in link.listen(seconds):
            bar.update(task, completed=time.monotonic() - started)
            if isinstance(event, mcu.Ring):
                seen.ring(event.t_us, ring.levels(event.levels, event.dead), time.monotonic_ns())
                with suppress(ProbeTimeout):  # what is there; the ring's next reading asks again
                    seen.estimate(client.receive(0), scale, time.monotonic_ns())
        link.rates()
    lux, level = seen.pairs()
    if not len(lux):
        raise CalibrationError(
            f"calibrate: ring: {uri}: no steady moment in {seconds:g} s: hold camera and light "
            "still for three seconds at a time"
        )
    return lux, level


def _scale(client: Client, uri: str, given: float | None) -> float:
    """Luminance of radiance 1: as given, or as the probe is calibrated."""
    estimate = calibrate_ring_camera.first_of(client, uri)
    scale = estimate.cd_m2_per_unit if given is None else given
    if scale is None:
        raise CalibrationError(
            f"calibrate: ring: {uri}: the probe's scale is relative: give --cd-m2-per-unit"
        )
    return scale


def report(
    found: ring.Ring,
    pairs: int,
    output: Path,
    former: Path | None,
    as_json: bool,
    more: dict[str, list[float]] | None = None,
) -> None:
    """Print the result; `more`: nine numbers each."""
    more = more or {}
    if as_json:
        told = {name: getattr(found, name).tolist() for name in ring.LIMITS}
        told |= {"drift_sigma": found.drift_sigma, "pairs": pairs}
        told |= {"drift_common_sigma": found.drift_common_sigma, **more}
        print(json.dumps(told | {"file": str(output), "former": former and str(former)}, indent=2))
        return
    shown = (10.0, 1000.0, 1e5)
    table = Table(
        "sensor", "R10", "gamma", "in series", *(f"± at {e:g} lx" for e in shown), *more, box=None
    )
    sigmas = found.total_sigma_of(
        found.level(np.repeat(np.array(shown)[:, None], ring.SENSORS, axis=1))
    )
    for k in range(ring.SENSORS):
        series = f"{found.series_ohm[k]:.0f} ± {found.series_sigma_ohm[k]:.0f} Ω"
        at = (f"{100 * sigma:.0f} %" for sigma in sigmas[:, k])
        rest = (f"{values[k]:.2g}" for values in more.values())
        row = (f"{found.r10_ohm[k]:.0f} Ω", f"{found.gamma[k]:.3f}", series, *at, *rest)
        table.add_row(str(k), *row)
    view.console().print(table)
    kept = f" (the former one is {former})" if former else ""
    drift = f"{100 * np.hypot(found.drift_sigma, found.drift_common_sigma):.0f} %"
    print(f"{pairs} pairs; {drift} of each ± is drift with temperature and former light")
    print(f"written: {output}{kept}")
