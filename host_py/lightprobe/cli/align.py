"""What the sub-commands of `lightprobe align` share: the result, and its file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from lightprobe.align import mount
from lightprobe.cli import calibrate, check

Output = Annotated[
    Path | None,
    typer.Option(
        metavar="MOUNT.ini",
        callback=check.new_file(makes_folders=True),
        help="Write the rotation into this file, for lightprobed --mount.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


def finish(
    found: mount.Mount, result: Mapping[str, object], remark: str, output: Path | None,
    as_json: bool,
) -> None:  # fmt: skip
    """Print a result, and write it."""
    if as_json:
        typer.echo(json.dumps(result, indent=2))
    else:
        typer.echo(words(found))
        typer.echo(remark)
    if output is not None:
        kept = mount.save(output, found, calibrate.remark(f"{words(found)}; {remark}"))
        typer.echo(f"written: {output}: [mount]", err=True)
        if kept is not None:
            typer.echo(f"the former one: {kept}", err=True)


def words(found: mount.Mount) -> str:
    """Say how the probe sits."""
    left, up, tilt = found.rotation.as_euler("YXZ", degrees=True)
    x, y, z, w = found.rotation.as_quat(canonical=True)
    return (
        f"probe on the head: turned left {left:.2f}°, up {up:.2f}°, tilted {tilt:.2f}° "
        f"(x y z w = {x:.6f} {y:.6f} {z:.6f} {w:.6f}), ± {found.sigma_deg:.2f}°"
    )
