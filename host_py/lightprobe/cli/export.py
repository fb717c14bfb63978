"""`lightprobe export`: the light of a probe as a file that any renderer reads."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from lightprobe.cli import check, whole_file
from lightprobe.cli.cuts import Constellation, ConstellationCut, cut_of
from lightprobe.cli.wishes import Lights, Order, Wait
from lightprobe.client import DEFAULT_URI, Client
from lightprobe.errors import ProbeTimeout, UsageError
from lightprobe.estimate import Estimate, EstimateFlag, flag_names
from lightprobe.imaging import constellation as constellations
from lightprobe.imaging import cube, environment, gltf, image
from lightprobe.reflection_map import SIZES, ReflectionMap
from lightprobe.wire import Subscription

_SUFFIXES = (".hdr", ".exr", ".pfm", ".glb")
_LAYOUTS = ("equirect", "cross")
#: Texels along an edge of the faces in a .glb file, where they show SH.
_FACE_SIZE = 64


def _file(context: typer.Context, option: typer.CallbackParam, value: Path) -> Path:
    return check.new_file(*_SUFFIXES)(context, option, value) or value


def command(
    file: Annotated[
        Path,
        typer.Argument(callback=_file, metavar="FILE", help="NAME.hdr, .exr, .pfm or .glb."),
    ],
    uri: Annotated[
        str, typer.Option("--from", metavar="URI", help="tcp:HOST:PORT or unix:PATH.")
    ] = DEFAULT_URI,
    width_px: Annotated[
        int,
        typer.Option(
            "--width", min=16, max=8192, help="Width of the picture: four faces of a cross."
        ),
    ] = 1024,
    layout: Annotated[
        str,
        typer.Option(
            "--layout",
            metavar="|".join(_LAYOUTS),
            callback=check.one_of(_LAYOUTS),
            help="equirect: height half of the width; cross: six faces of a cube, forward in the "
            "middle, as seen from inside.",
        ),
    ] = "equirect",
    reflection_map: Annotated[
        bool,
        typer.Option(
            "--reflection-map",
            help="Take the probe's picture of the room, instead of SH and discs. A cross then has "
            "faces of the map's size. The daemon must allow it (--reflection-map=64).",
        ),
    ] = False,
    order: Order = 2,
    lights: Lights = 8,
    area_lights: Annotated[
        bool, typer.Option("--area-lights", help="List windows, soft boxes and the like, too.")
    ] = False,
    key_light: Annotated[
        bool,
        typer.Option("--key-light", help="Add KEY, one light for what the listed ones leave."),
    ] = False,
    constellation: Constellation = None,
    cut: ConstellationCut = "variance",
    wait_s: Wait = 10.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the estimate as JSON.")] = False,
) -> None:
    """Write the light of a probe, as it is now, for programs that have no client.

    .hdr, .exr and .pfm: an environment map or the faces of a cube, scene-linear, the SH with each
    lamp as a disc of its size; the centre of the picture is forward (−Z). .glb: the lamps as
    directional lights (KHR_lights_punctual, in lux when the probe is calibrated), and the rest as
    an environment (EXT_lights_image_based), or all of it as lights (--constellation 32). A former
    file is replaced.
    Example: lightprobe export room.hdr --from tcp:192.168.1.20:7700 --width 2048
    """
    if width_px % 2:
        raise UsageError(f"export: --width {width_px}: expected an even number")
    if layout == "cross" and width_px % 4:
        raise UsageError(f"export: --width {width_px}: expected a multiple of 4 for a cross")
    is_glb = file.suffix.lower() == ".glb"
    if is_glb and layout == "cross":
        raise UsageError("export: --layout cross: a .glb file has no layout: leave the option out")
    if is_glb and key_light and reflection_map:
        raise UsageError(
            "export: --key-light and --reflection-map: the map shows the key light, too, so that "
            "reflections would count it twice: leave one of them out"
        )
    if constellation and not is_glb:
        raise UsageError(
            f"export: --constellation: {file} is a picture: lights go into a .glb file"
        )
    wish = Subscription(
        sh_order=order, max_lights=lights, area_lights=area_lights, key_light=key_light,
        reflection_map_size=max(SIZES) if reflection_map else 0,
        reflection_map_kind="AMBIENT" if is_glb else "TOTAL",
    )  # fmt: skip
    estimate, mirrored = receive(uri, wish, wait_s)
    if constellation:
        estimate, notes = constellations.constellation(
            estimate, constellation, cut_of(cut), mirrored
        )
        data = gltf.glb(estimate, cube.cube_map(estimate, _FACE_SIZE, lamps=False)[0])
    elif is_glb:
        data, notes = _glb(estimate, mirrored)
    else:
        radiance, notes = _picture(estimate, mirrored, width_px, layout)
        # Photometric where the probe is calibrated, as the intensities of .glb are.
        data = image.encode(file.suffix.lower(), radiance * (estimate.cd_m2_per_unit or 1.0))
    whole_file.write("export", file, data)
    scale = "lux and cd/m²" if estimate.cd_m2_per_unit else "relative units: not calibrated"
    typer.echo(
        f"written: {file}: {len(estimate.lights)} lamps, SH of order {estimate.sh.order}; {scale}",
        err=True,
    )
    for note in [*notes, *(f"flag {name}" for name in flag_names(estimate.flags))]:
        typer.echo(f"note: {note}", err=True)
    if as_json:
        typer.echo(json.dumps(estimate.to_json(), indent=2))


def receive(uri: str, wish: Subscription, wait_s: float) -> tuple[Estimate, ReflectionMap | None]:
    """Wait for an estimate that is whole: of the order asked for, from all exposures.

    When none comes in time, the last that came; raises ProbeTimeout when none came at all. With it
    the reflection map that was asked for: raises UsageError when the probe sends none.
    """
    deadline_s = time.monotonic() + wait_s
    with Client(uri, wish) as client:
        estimate = client.receive(wait_s)
        _check_reflection_map(client, wish)
        while not _whole(client, estimate, wish) and time.monotonic() < deadline_s:
            estimate = client.receive(max(0.0, deadline_s - time.monotonic()))
        if wish.reflection_map_size and client.reflection_map is None:
            raise ProbeTimeout(
                f"export: {uri}: no reflection map in {wait_s:g} s: try a larger --wait"
            )
        return estimate, client.reflection_map


def _check_reflection_map(client: Client, wish: Subscription) -> None:
    if wish.reflection_map_size and client.hello and not client.hello.max_reflection_map_size:
        raise UsageError(
            "export: --reflection-map: the probe sends none: start lightprobed with "
            "--reflection-map=64, or leave the option out to get the SH"
        )


def _whole(client: Client, estimate: Estimate, wish: Subscription) -> bool:
    best = client.hello.max_sh_order if client.hello else wish.sh_order
    incomplete = EstimateFlag.BRACKET_INCOMPLETE in estimate.flags
    missing = wish.reflection_map_size > 0 and client.reflection_map is None
    return not incomplete and not missing and estimate.sh.order >= min(wish.sh_order, best)


def _glb(estimate: Estimate, mirrored: ReflectionMap | None) -> tuple[bytes, list[str]]:
    if mirrored:
        return gltf.glb(estimate, mirrored.radiance), []
    faces, notes = cube.cube_map(estimate, _FACE_SIZE, lamps=False)
    return gltf.glb(estimate, faces), notes


def _picture(
    estimate: Estimate, mirrored: ReflectionMap | None, width_px: int, layout: str
) -> tuple[NDArray[np.float32], list[str]]:
    if layout == "equirect":
        if mirrored:
            return mirrored.environment_map(width_px), []
        return environment.environment_map(estimate, width_px)
    if mirrored:
        return cube.cross(mirrored.radiance), []
    faces, notes = cube.cube_map(estimate, width_px // 4)
    return cube.cross(faces), notes
