"""`lightprobe calibrate ring --from-camera`: turn the box, and its camera calibrates its ring."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import typer
from rich.console import Console
from rich.progress import Progress, TaskID

from lightprobe.calibrate import ring
from lightprobe.calibrate.files import CalibrationError
from lightprobe.calibrate.ring_seats import Found, fit
from lightprobe.calibrate.ring_turning import Samples, Turning
from lightprobe.client import Client
from lightprobe.errors import ProbeTimeout
from lightprobe.estimate import Estimate
from lightprobe.geometry import Array
from lightprobe.mcu import messages as mcu
from lightprobe.mcu.session import Session
from lightprobe.wire import Subscription

#: Five minutes of turning.
SECONDS = 300.0
#: A scale that the user gives has no sigma: that of a lux meter.
_GIVEN_SIGMA = 0.05
_SCANS = 8
#: Until the first estimate.
FIRST_S = 10.0


def calibrate(
    link: Session,
    uri: str,
    seconds: float,
    cd_m2_per_unit: float | None,
    divider_ohm: float,
    plot: Path | None,
) -> Found:
    """Watch probe and ring while somebody turns the box; raises CalibrationError."""
    typer.echo(
        "calibrate: ring: turn the box slowly: around twice, then up, down and around again; stay "
        "behind it, and do not switch lamps",
        err=True,
    )
    samples, scale_sigma = watch(link, uri, seconds, cd_m2_per_unit)
    found = fit(samples, scale_sigma, divider_ohm)
    if plot is not None:
        from lightprobe.calibrate import ring_plot  # matplotlib is slow to load

        ring_plot.draw(samples, found, plot)
        typer.echo(f"plot: {plot}", err=True)
    return found


def watch(
    link: Session, uri: str, seconds: float, cd_m2_per_unit: float | None
) -> tuple[Samples, float]:
    """Samples of so many seconds, and the scale's relative sigma, under a progress bar."""
    seen = Turning()
    with watching(uri, "turn the box", seconds) as (client, bar, task):
        scale, sigma = scale_of(first_of(client, uri), uri, cd_m2_per_unit)
        link.rates(ring_scans=_SCANS)
        started = time.monotonic()
        for event in link.listen(seconds):
            if isinstance(event, mcu.Ring):
                note(seen, event)
                bar.update(
                    task,
                    completed=time.monotonic() - started,
                    description=f"turn the box ({seen.sectors} of 12 directions)",
                )
            with suppress(ProbeTimeout):  # the next event asks again
                while True:
                    seen.estimate(client.receive(0), scale, time.monotonic_ns())
        link.rates()
    return seen.samples(), sigma


@contextmanager
def watching(uri: str, what: str, seconds: float) -> Iterator[tuple[Client, Progress, TaskID]]:
    """Connect to a probe for its raw estimates, under a progress bar of so many seconds."""
    wish = Subscription(smoothing="RAW", sh_order=4, max_lights=8)
    with Client(uri, wish) as client, Progress(
        console=Console(stderr=True), transient=True
    ) as bar:  # fmt: skip
        yield client, bar, bar.add_task(what, total=seconds)


def note(seen: Turning, event: mcu.Ring) -> None:
    """Give a reading; a dead sensor is NaN."""
    levels: Array = ring.levels(event.levels, event.dead)
    seen.ring(event.t_us, levels, time.monotonic_ns())


def first_of(client: Client, uri: str) -> Estimate:
    """Give the first estimate; CalibrationError when none comes."""
    try:
        return client.receive(FIRST_S)
    except ProbeTimeout:
        raise CalibrationError(
            f"calibrate: ring: {uri}: no estimate in {FIRST_S:.0f} s: does its camera give frames? "
            f"(lightprobe watch {uri})"
        ) from None


def scale_of(estimate: Estimate, uri: str, given: float | None) -> tuple[float, float]:
    """Luminance of radiance 1 and its relative sigma: as given, or as the probe is calibrated."""
    if given is not None:
        return given, _GIVEN_SIGMA
    if estimate.cd_m2_per_unit is None:
        raise CalibrationError(
            f"calibrate: ring: {uri}: the probe's scale is relative: run lightprobe calibrate "
            "scale --lux with a lux meter first, or give --cd-m2-per-unit"
        )
    return estimate.cd_m2_per_unit, estimate.cd_m2_per_unit_sigma or _GIVEN_SIGMA
