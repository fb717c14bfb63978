"""`lightprobe simulate --help-faults`: what can go wrong, and how to ask for it."""

from __future__ import annotations

import typer

from lightprobe.sim import faults
from lightprobe.sim.osc.faults import OscFaults


def show(context: typer.Context, wanted: bool) -> None:
    """Print all faults, and end; does nothing unless they are wanted."""
    if not wanted or context.resilient_parsing:
        return
    typer.echo(text())
    raise typer.Exit


def text() -> str:
    """Give the tables: each fault as a healthy device has it, what it may be, what it does."""
    box = [(f"{name}={healthy:g}", "", means) for name, (healthy, means) in faults.BOX.items()]
    return "\n".join(
        [
            "Faults, as a healthy device has them. Several are joined by &: drop=0.1&late_ms=40",
            "",
            "Of the camera: --faults, --source='sim:SOCKET?…', lightprobe control inject-fault",
            *_table(list(faults.rows())),
            "",
            "Of the THETA on the network, with --osc: --faults, lightprobe control inject-fault",
            *_table(list(faults.rows(OscFaults))),
            "",
            "Of wheel, ring and serial line, with --firmware: as those of the camera",
            *_table(box),
        ]
    )


def _table(rows: list[tuple[str, str, str]]) -> list[str]:
    first, second = (max(len(row[k]) for row in rows) for k in range(2))
    return [f"  {name:{first}}  {may:{second}}  {means}" for name, may, means in rows]
