"""`lightprobe watch`: what the probe sees, live."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated

import typer
from rich.live import Live

from lightprobe import drawn
from lightprobe.cli import check, view
from lightprobe.client import DEFAULT_URI, Client
from lightprobe.errors import ProbeTimeout, UsageError
from lightprobe.estimate import Kind
from lightprobe.wire import Subscription

#: Called at every refresh: a footnote, or None to end.
Step = Callable[[], str | None]

_REFRESH_HZ = 8
_PATIENCE_S = 10.0


def command(
    uri: Annotated[str, typer.Argument(help="tcp:HOST:PORT or unix:PATH.")] = DEFAULT_URI,
    order: Annotated[
        int | None,
        typer.Option(min=0, max=4, help="Highest SH order; default 2, with --draws 4."),
    ] = None,
    lights: Annotated[int, typer.Option(min=0, max=8, help="Maximum number of lamps listed.")] = 8,
    kind: Annotated[
        str, typer.Option(help="AMBIENT: SH without the listed lamps; TOTAL: with them.")
    ] = "AMBIENT",
    rate_hz: Annotated[
        float,
        typer.Option(
            "--rate",
            callback=check.number(0, 1000),
            help="Maximum number of estimates per second; 0: all.",
        ),
    ] = 0.0,
    tolerance: Annotated[
        float,
        typer.Option(
            callback=check.number(0, 1),
            help="Use the smallest model with a predicted error below this.",
        ),
    ] = 0.0,
    draws: Annotated[
        str | None,
        typer.Option(
            metavar="WORD:N%,…",
            help="What is drawn, and the most error of each: the probe chooses the least that "
            "suffices. diffuse, shadows, glossy, mirrors; say diffuse:2%,chrome:10%.",
        ),
    ] = None,
    raw: Annotated[
        bool, typer.Option("--raw", help="Show estimates that are not smoothed in time.")
    ] = False,
    seconds: check.Seconds = None,
    count: check.Count = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON line per estimate.")] = False,
) -> None:
    """Watch a probe: lamps, SH, rate, latency, health, and what is wrong in words.

    A dashboard on a terminal, one line a second elsewhere, every estimate with --json. Ends on
    Ctrl-C. The exit code is 1 when no estimate came (in --seconds, or 10 s with --count).
    """
    things = None if draws is None else drawn.parse(draws, "watch")
    most = 2 if things is None else drawn.MOST_ORDER
    subscription = Subscription(
        rate_hz, most if order is None else order, lights, _kind(kind), tolerance,
        "RAW" if raw else "SMOOTHED", draws=things,
    )  # fmt: skip
    with Client(uri, subscription) as client, suppress(KeyboardInterrupt):
        if as_json:
            print_json(client, seconds, count)
        else:
            show(client, _until(client, seconds, count))
    if client.statistics.estimates == 0 and (seconds or count):
        raise ProbeTimeout(client.last_error or f"{uri}: no estimate came")


def _kind(text: str) -> Kind:
    kinds: dict[str, Kind] = {"AMBIENT": "AMBIENT", "TOTAL": "TOTAL"}
    if text.upper() not in kinds:
        raise UsageError(f"watch: --kind {text}: expected AMBIENT or TOTAL")
    return kinds[text.upper()]


def _until(client: Client, seconds: float | None, count: int | None) -> Step:
    """End after a time, or a number of estimates."""
    started = time.monotonic()

    def step() -> str | None:
        elapsed_s, got = time.monotonic() - started, client.statistics.estimates
        over = seconds is not None and elapsed_s > seconds
        enough = count is not None and (got >= count or (not got and elapsed_s > _PATIENCE_S))
        return None if over or enough else ""

    return step


def show(client: Client, step: Step) -> None:
    """Dashboard on a terminal, a line a second elsewhere; `step` is called often."""
    if sys.stdout.isatty():
        _show_live(client, step)
    else:
        _print_lines(client, step)


def _show_live(client: Client, step: Step) -> None:
    meter = view.RateMeter()
    with Live(refresh_per_second=_REFRESH_HZ) as live:
        while (note := step()) is not None:
            rate_hz = meter.rate_hz(client.statistics.estimates)
            live.update(view.dashboard(client, rate_hz, note))
            time.sleep(1 / _REFRESH_HZ)


def _print_lines(client: Client, step: Step) -> None:
    meter, due, said = view.RateMeter(), 0.0, ""
    while (note := step()) is not None:
        rate_hz = meter.rate_hz(client.statistics.estimates)
        if time.monotonic() >= due:
            due = time.monotonic() + 1
            estimate = client.latest()
            waiting = client.last_error or "no light yet"
            box = view.box_words(estimate, client.health)
            line = f"{rate_hz:.1f}/s {view.plain(estimate)}" if estimate else waiting
            line = f"{line} {view.drawn_words(client)}".rstrip()
            print(f"{line}  {box}".rstrip(), flush=True)
        if note and note != said:
            print(note, flush=True)
        said = note
        time.sleep(0.05)


def print_json(client: Client, seconds: float | None, count: int | None) -> None:
    """Every estimate as a line of JSON."""
    started, printed = time.monotonic(), 0
    while count is None or printed < count:
        left_s = None if seconds is None else seconds - (time.monotonic() - started)
        if left_s is not None and left_s <= 0:
            return
        try:
            estimate = client.receive(_PATIENCE_S if left_s is None else left_s)
        except ProbeTimeout as error:
            if seconds is None and count is not None and not printed:
                raise
            print(error, file=sys.stderr)
            continue
        print(json.dumps(estimate.to_json()), flush=True)
        printed += 1
