"""`lightprobe bake`: how the light of a probe falls on a mesh that shades itself."""

from __future__ import annotations

import json
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from lightprobe.bake import Bake, mesh
from lightprobe.cli import check, whole_file
from lightprobe.cli.export import receive
from lightprobe.cli.wishes import Lights, Order, Wait
from lightprobe.client import DEFAULT_URI
from lightprobe.errors import UsageError
from lightprobe.estimate import Estimate, flag_names
from lightprobe.geometry import Array
from lightprobe.wire import Subscription

_BAKED = ".npz"
#: Bytes that the visibility of a mesh may take.
_MOST_BYTES = 1 << 30


def _file(context: typer.Context, option: typer.CallbackParam, value: Path) -> Path:
    return check.new_file(_BAKED, *mesh.WRITTEN)(context, option, value) or value


def command(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="MESH", help=f"{', '.join(mesh.READ)}, in metres; or a .npz baked before."
        ),
    ],
    file: Annotated[
        Path,
        typer.Argument(callback=_file, metavar="OUT", help="NAME.npz, .ply or .glb."),
    ],
    uri: Annotated[
        str, typer.Option("--from", metavar="URI", help="tcp:HOST:PORT or unix:PATH.")
    ] = DEFAULT_URI,
    place: Annotated[
        str | None,
        typer.Option(
            "--at", metavar="X,Y,Z", help="Where the mesh stands, metres from the probe, its frame."
        ),
    ] = None,
    albedo: Annotated[float, typer.Option(min=0.0, max=1.0, help="Of the mesh's surface.")] = 0.5,
    directions: Annotated[
        int,
        typer.Option(min=64, max=8192, help="Directions in which visibility is known; even."),
    ] = 1024,
    flip: Annotated[
        bool, typer.Option("--flip", help="The mesh's triangles face inward: turn them round.")
    ] = False,
    order: Order = 2,
    lights: Lights = 8,
    wait_s: Wait = 10.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Light a mesh by a probe, with the shadows that the mesh casts on itself.

    OUT.npz: how light from each direction reaches each vertex, for programs that light the mesh
    with every packet (lightprobe.bake.Bake); no probe is needed. OUT.ply, OUT.glb: the mesh as it
    is lit now, in the colours of its vertices; .ply has the irradiance, too. A former file is
    replaced.
    Example: lightprobe bake vase.glb vase.npz; lightprobe bake vase.npz lit.ply
    """
    if directions % 2:
        raise UsageError(f"bake: --directions {directions}: expected an even number")
    position_m = _parse_place(place)
    bake, summary, notes = _prepared(source, directions, flip)
    summary |= {
        "vertices": len(bake.vertices), "triangles": len(bake.triangles),
        "directions": len(bake.directions),
    }  # fmt: skip
    if file.suffix.lower() == _BAKED:
        whole_file.write("bake", file, bake.encode())
    else:
        wish = Subscription(sh_order=order, max_lights=lights, area_lights=True)
        estimate = receive(uri, wish, wait_s)[0]
        lit, more = _lit(bake, estimate if position_m is None else estimate.at(position_m))
        data, white = mesh.encode(file.suffix.lower(), bake, lit, albedo)
        whole_file.write("bake", file, data)
        unit = "cd/m²" if estimate.cd_m2_per_unit else "of the packet's units"
        white *= estimate.cd_m2_per_unit or 1.0
        summary |= more | {"white_radiance": white, "flags": flag_names(estimate.flags)}
        notes += [f"a vertex colour of 1 is a radiance of {white:.4g} {unit}"]
        notes += [f"flag {name}" for name in flag_names(estimate.flags)]
    typer.echo(f"written: {file}: {len(bake.vertices)} vertices", err=True)
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    if as_json:
        typer.echo(json.dumps(summary, indent=2))


def _parse_place(text: str | None) -> list[float] | None:
    if text is None:
        return None
    with suppress(ValueError):
        place = [float(part) for part in text.split(",")]
        if len(place) == 3 and np.all(np.isfinite(place)):
            return place
    raise UsageError(f"bake: --at {text}: expected X,Y,Z in metres")


def _prepared(
    source: Path, directions: int, flip: bool
) -> tuple[Bake, dict[str, object], list[str]]:
    """Load or bake a mesh, with what is to be said of it."""
    if source.suffix.lower() == _BAKED:
        if flip:
            raise UsageError(f"bake: --flip: {source} is baked: give it with the mesh itself")
        return Bake.load(source), {}, []
    read = mesh.read(source, flip)
    if len(read.vertices) * directions > _MOST_BYTES:
        raise UsageError(
            f"bake: {source}: {len(read.vertices)} vertices × {directions} directions need more "
            f"than {_MOST_BYTES >> 20} MB: fewer --directions, or a mesh of fewer vertices"
        )
    began_s = time.monotonic()
    bake = Bake.of_mesh(
        read.vertices, read.normals, read.triangles, directions,
        _show if sys.stderr.isatty() else None,
    )  # fmt: skip
    took_s = time.monotonic() - began_s
    inward = int(bake.inward.sum())
    if inward > len(read.vertices) / 2:
        advice = "without --flip" if flip else "--flip"
        raise UsageError(
            f"bake: {source}: {inward} of {len(read.vertices)} vertices are of triangles that face "
            f"inward: try {advice}"
        )
    notes = []
    if inward:
        notes.append(
            f"{inward} of {len(read.vertices)} vertices are of triangles that face inward: they "
            "are lit as if their back were in front"
        )
    if read.open_edges:
        notes.append(
            f"the mesh is open along {read.open_edges} edges: light enters there, and what is "
            "seen from its back is lit as its front"
        )
    return bake, {"prepared_s": took_s, "inward": inward, "open_edges": read.open_edges}, notes


def _show(done: int, whole: int) -> None:
    if done == whole or done % 16 == 0:
        end = "\n" if done == whole else ""
        print(f"\rbake: {100 * done // whole} %", end=end, file=sys.stderr, flush=True)


def _lit(bake: Bake, estimate: Estimate) -> tuple[Array, dict[str, object]]:
    """Irradiance of the vertices, and what it took."""
    bake.irradiance(estimate)  # prepares what a packet does not change
    began_s = time.perf_counter()
    lit = bake.irradiance(estimate)
    took_ms = 1e3 * (time.perf_counter() - began_s)
    return lit, {"packet_ms": took_ms, "mean_irradiance": [float(c) for c in lit.mean(axis=0)]}
