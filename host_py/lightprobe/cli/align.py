"""What the sub-commands of `lightprobe align` share: the result, and its file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from lightprobe.align import mount
from lightprobe.align.track import AlignError
from lightprobe.cli import calibrate, check
from lightprobe.geometry import Array

Output = Annotated[
    Path | None,
    typer.Option(
        metavar="MOUNT.ini",
        callback=check.new_file(makes_folders=True),
        help="Write rotation and offset into this file, for lightprobed --mount.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


def finish(
    found: mount.Mount, result: Mapping[str, object], remark: str, output: Path | None,
    as_json: bool,
) -> None:  # fmt: skip
    """Print a result, and write it; where it tells no offset, that of the former file stays."""
    if as_json:
        typer.echo(json.dumps(result, indent=2))
    else:
        typer.echo(words(found))
        typer.echo(remark)
    if output is not None:
        if found.offset_m is None and (former := _former_offset(output)) is not None:
            found = replace(found, offset_m=former)
            typer.echo(f"note: offset_m stays as it was in {output}", err=True)
        kept = mount.save(output, found, calibrate.remark(f"{words(found)}; {remark}"))
        typer.echo(f"written: {output}: [mount]", err=True)
        if kept is not None:
            typer.echo(f"the former one: {kept}", err=True)


def _former_offset(path: Path) -> Array | None:
    """Offset (3,) in metres of a mount file that is to be replaced; None: none is known."""
    try:
        return mount.load(path).offset_m if path.is_file() else None
    except AlignError:
        return None


def words(found: mount.Mount) -> str:
    """Say how the probe sits, and where if it is measured."""
    left, up, tilt = found.rotation.as_euler("YXZ", degrees=True)
    x, y, z, w = found.rotation.as_quat(canonical=True)
    place = ""
    if found.offset_m is not None and found.offset_sigma_m is not None:
        axes = ((f"{100 * m:.1f} ± {100 * sigma:.1f}") for m, sigma in
                zip(found.offset_m, found.offset_sigma_m, strict=True))  # fmt: skip
        place = f"; its lens is at x, y, z = {', '.join(axes)} cm"
    return (
        f"probe on the head: turned left {left:.2f}°, up {up:.2f}°, tilted {tilt:.2f}° "
        f"(x y z w = {x:.6f} {y:.6f} {z:.6f} {w:.6f}), ± {found.sigma_deg:.2f}°{place}"
    )
