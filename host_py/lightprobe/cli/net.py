"""`lightprobe net`: a probe to print, cut, fold and glue."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from lightprobe.cli import check, whole_file
from lightprobe.errors import UsageError
from lightprobe.probe.dodecahedron import kind, net


def command(
    probe: Annotated[
        str, typer.Argument(metavar="dodecahedron:EDGE", help="As --probe of estimate names it.")
    ],
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE.pdf", callback=check.new_file(".pdf"), help="Two pages of A4, to scale."
        ),
    ],
) -> None:
    """Draw the net of a probe of paper.

    Print it at 100 % on matt white paper, measure the bar of 100 mm, cut, fold and glue it
    (docs/users/probes.md). Then: lightprobe estimate photo.jpg --probe dodecahedron:30mm
    Example: lightprobe net dodecahedron:30mm net.pdf
    """
    found = kind.parse(probe)
    if found.roughness is not None or found.fits_roughness:
        raise UsageError(f"net: {probe}: a net has no roughness: dodecahedron:{found.edge_mm:g}mm")
    edge_mm = found.edge_mm
    if not net.SMALLEST_MM <= edge_mm <= net.LARGEST_MM:
        raise UsageError(
            f"net: {probe}: on A4 an edge is {net.SMALLEST_MM:g} to {net.LARGEST_MM:g} mm; for "
            "others print it and enlarge it: --probe takes any edge"
        )
    with tempfile.TemporaryDirectory(prefix="lightprobe-net-") as folder:
        drawn = Path(folder) / "net.pdf"
        net.write(drawn, edge_mm)
        whole_file.write("net", file, drawn.read_bytes())
    typer.echo(f"written: {file}", err=True)
