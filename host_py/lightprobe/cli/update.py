"""`lightprobe update`: another version of the whole system, for a probe from a card."""

from __future__ import annotations

import json
import signal
import subprocess
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from lightprobe.errors import LightprobeError
from lightprobe.setup import card


def command(
    file: Annotated[
        Path | None, typer.Argument(help="The update, NAME.raucb; without: say what runs.")
    ] = None,
    restart: Annotated[
        bool, typer.Option("--restart", help="Then restart this machine, with the update.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Say what runs as JSON.")] = False,
) -> None:
    """Update a probe that runs from a card of `make image`, or say which version runs.

    The update is written to the half of the card that does not run, and starts once. It is kept
    when it has run well for 20 seconds; otherwise the former version starts again. Settings and
    calibration stay. Example: sudo lightprobe update lightprobe-pi4.raucb --restart
    """
    if file is None:
        if card.version() is None:
            raise LightprobeError(
                "update: this machine was not started from a card of `make image`"
            )
        _tell(card.halves(), as_json)
        return
    last = -1

    def progress(percent: int, step: str) -> None:
        nonlocal last
        if percent != last:
            print(f"{percent:3d} %  {step}", flush=True)
        last = percent

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # RAUC's service would go on without us
    card.install(file, progress)
    print("update: written; it starts at the next start, and is kept if it runs well", flush=True)
    if restart:
        print("update: the probe restarts now", flush=True)
        done = subprocess.run(["systemctl", "--no-block", "reboot"], capture_output=True, text=True)
        if done.returncode:
            raise LightprobeError(f"update: restart: {done.stderr.strip()}: restart it yourself")


def _tell(halves: card.Halves, as_json: bool) -> None:
    if as_json:
        print(json.dumps(asdict(halves)))
        return
    print(f"version {halves.version}, half {halves.running} of the card")
    if not halves.kept:
        print("a trial: it is kept when it has been well for a while")
    if halves.starts_next != halves.running:
        print(f"at the next start: half {halves.starts_next}")
