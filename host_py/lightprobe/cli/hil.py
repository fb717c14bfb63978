"""`lightprobe hil`: check a box with its microcontroller, and write down the evidence."""

from __future__ import annotations

import datetime
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from lightprobe.cli import check, view, whole_file
from lightprobe.errors import LightprobeError
from lightprobe.hil import report as reports
from lightprobe.hil import run as hil
from lightprobe.hil.bench import Bench
from lightprobe.hil.box import Box, open_box
from lightprobe.hil.check import CannotTellError, Check, Finding, Group, Verdict
from lightprobe.mcu.session import DEFAULT_PORT, ENVIRONMENT

_COLOURS = {Verdict.PASS: "green", Verdict.FAIL: "red", Verdict.SKIPPED: "dim"}


class CannotRunError(LightprobeError):
    """No box could be checked: that is not the same as a box that failed."""

    exit_code = 2


def command(
    port: Annotated[
        str,
        typer.Argument(
            metavar="PORT",
            envvar=ENVIRONMENT,
            help="serial:DEVICE[?baud=N], i2c:DEVICE[?address=N] or can:CHANNEL.",
        ),
    ] = DEFAULT_PORT,
    moves: Annotated[
        bool, typer.Option("--moves", help="Turn the wheel, and set a parameter and put it back.")
    ] = False,
    cover: Annotated[
        bool, typer.Option("--cover", help="Ask you to cover each light sensor with a finger.")
    ] = False,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="This check alone, of any kind; may be repeated."),
    ] = None,
    seconds: Annotated[
        float,
        typer.Option(callback=check.number(1, 600, "seconds"), help="How long traffic is watched."),
    ] = 5.0,
    json_file: Annotated[
        Path | None,
        typer.Option(
            "--json",
            metavar="FILE",
            callback=check.new_file(),
            help="Write the report for programs.",
        ),
    ] = None,
    html_file: Annotated[
        Path | None,
        typer.Option(
            "--html",
            metavar="FILE",
            callback=check.new_file(),
            help="Write the report as a page with plots.",
        ),
    ] = None,
    list_only: Annotated[
        bool, typer.Option("--list", help="List the checks and their bounds, and do nothing.")
    ] = False,
) -> None:
    """Check a box with its microcontroller, and write down the evidence that it works.

    Without options it only asks: versions, answers, damaged messages, lost ones, latency, clocks,
    parameters, light sensors, supply. With --moves it also homes and turns the wheel: take your
    fingers out. With --cover it asks you to cover one sensor after the other. Nothing is saved, and
    what was changed is put back, also after Ctrl-C. lightprobed must not be using the box. The
    exit code is 0 when all passed, 1 when something failed, 2 when the box could not be checked.
    Example: lightprobe hil serial:/dev/ttyUSB0 --moves --html box.html
    """
    if list_only:
        _print_list()
        return
    groups = [Group.READ, *([Group.MOVES] if moves else []), *([Group.COVER] if cover else [])]
    checks = hil.choose(groups, only or [])
    console = view.console()
    started = datetime.datetime.now(datetime.UTC).astimezone()
    box = _open(port)
    try:
        bench = Bench(box, seconds, _ask_to_cover(console))
        facts = reports.facts_of(bench, serial_number(port), started)
        console.print(escape(", ".join(f"{k} {v}" for k, v in list(facts.items())[:6])))
        findings = hil.run(bench, checks, _progress(console))
    finally:
        box.close()
    report = reports.Report(checks, findings, facts, bench.series, bench.unrestored)
    if json_file is not None:
        whole_file.write("hil", json_file, reports.as_json(report).encode())
    if html_file is not None:
        whole_file.write("hil", html_file, reports.as_html(report).encode())
    console.print(f"\n[bold]{escape(report.words)}[/]")
    raise typer.Exit(1 if report.failed else 0)


def _open(port: str) -> Box:
    try:
        return open_box(f"serial:{port}" if port.startswith("/") else port)
    except LightprobeError as error:
        raise CannotRunError(str(error).replace("mcu: ", "hil: ", 1)) from None


def serial_number(port: str) -> str:
    """Give the number of the USB adapter behind a serial line; empty where it has none."""
    from serial.tools import list_ports

    device = port.partition(":")[2].partition("?")[0] if ":" in port else port
    real = os.path.realpath(device)
    return next(
        (one.serial_number or "" for one in list_ports.comports() if one.device == real), ""
    )


def _print_list() -> None:
    table = Table("check", "with", "asks", "bound", "the bound is of", box=None)
    for one in hil.ALL:
        option = "" if one.group is Group.READ else f"--{one.group.value}"
        table.add_row(one.name, option, escape(one.asks), escape(one.bound), one.source.file)
    view.console().print(table)


def _progress(console: Console) -> hil.Progress:
    status = console.status("")

    def told(one: Check, finding: Finding | None) -> None:
        if finding is None:
            status.update(f"{one.name}: {escape(one.asks)}")
            status.start()
            return
        status.stop()
        colour = _COLOURS[finding.verdict]
        console.print(
            f"[{colour}]{finding.verdict.value:8}[/] [bold]{one.name:13}[/]"
            f"{escape(finding.measured)} [dim](bound: {escape(one.bound)})[/]"
        )
        if finding.next_step:
            console.print(f"                       → {escape(finding.next_step)}")

    return told


def _ask_to_cover(console: Console) -> Callable[[int], None]:
    def ask(sensor: int) -> None:
        where = "8 (up)" if sensor == 8 else f"{sensor} ({45 * sensor}° from +X)"
        what = "Uncover all sensors" if sensor < 0 else f"Cover sensor {where} with a finger"
        console.print(f"{what}, then press Enter.")
        if not sys.stdin.readline():
            raise CannotTellError("nobody pressed Enter: input has ended")

    return ask
