"""`lightprobe align marker`: the mount by a printed marker on the probe."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lightprobe.align import marker
from lightprobe.align.mount import Mount
from lightprobe.cli import align, check
from lightprobe.errors import UsageError

_MODULE_PX = 20


def command(
    pictures: Annotated[
        list[Path] | None,
        typer.Argument(metavar="FILE…", help="Pictures by the head's camera that show the marker."),
    ] = None,
    print_to: Annotated[
        Path | None,
        typer.Option(
            "--print",
            metavar="FILE",
            callback=check.new_file(".pdf", ".png", ".svg"),
            help="Write the marker, to be printed at full size, and end.",
        ),
    ] = None,
    size_mm: Annotated[
        float,
        typer.Option(
            callback=check.number(5, 200, "mm"), help="With --print: of the black square."
        ),
    ] = 50.0,
    number: Annotated[
        int, typer.Option("--marker", min=0, max=marker.MARKERS - 1, help="Which marker.")
    ] = 0,
    side: Annotated[
        str,
        typer.Option(
            "--on",
            callback=check.one_of(marker.SIDES),
            help=f"Side of the box that it is on: {', '.join(marker.SIDES)}.",
        ),
    ] = "back",
    intrinsics: Annotated[
        str | None,
        typer.Option(
            metavar="FX,FY,CX,CY[,K1,K2,P1,P2[,K3]]",
            help="Of the camera, in pixels of these pictures, and its distortion as OpenCV has it.",
        ),
    ] = None,
    camera_on_head: Annotated[
        str,
        typer.Option(
            metavar="X,Y,Z,W",
            help="Camera to head, where the camera looks another way than the head's frame.",
        ),
    ] = "0,0,0,1",
    output: align.Output = None,
    as_json: align.AsJson = False,
) -> None:
    """Find the mount with a printed marker on the box that the head's camera sees.

    Print the marker (--print), glue it flat on one side of the box, its top up (on top and bottom:
    forward), and take at least 3 pictures while it is mounted. Seen aslant and large it tells most.
    Its size does not matter. Camera and head have +X right, +Y up, -Z forward.
    More: docs/users/mounting.md.
    Example: lightprobe align marker photo*.png --intrinsics 900,900,640,360 --output mount.ini
    """
    if print_to is not None:
        save_print(print_to, number, size_mm)
        typer.echo(f"written: {print_to}: marker {number}, print it at 100 %", err=True)
        return
    if not pictures or intrinsics is None:
        raise UsageError("align: marker: give pictures and --intrinsics, or --print FILE.pdf")
    camera, eyes = parse_intrinsics(intrinsics), parse_rotation(camera_on_head)
    sights = []
    for path in pictures:
        seen = marker.find(marker.read(path), number, camera, side)
        if isinstance(seen, str):
            typer.echo(f"note: {path}: left out: {seen}", err=True)
        else:
            sights.append(seen)
    found = marker.combine(sights, eyes)
    remark = (
        f"{sum(found.used)} of {len(pictures)} pictures used, which differ by "
        f"{found.residual_deg:.2f}° (RMS)"
    )
    align.finish(Mount(found.rotation, found.sigma_deg), found.to_json(), remark, output, as_json)


def parse_intrinsics(text: str) -> marker.Intrinsics:
    """Read numbers with commas between; raises UsageError."""
    values = _numbers("--intrinsics", text)
    if len(values) not in (4, 8, 9) or min(values[:2]) <= 0:
        raise UsageError(
            f"align: --intrinsics {text}: expected FX,FY,CX,CY in pixels, or also K1,K2,P1,P2[,K3]"
        )
    fx_px, fy_px, cx_px, cy_px, *distortion = values
    return marker.Intrinsics(fx_px, fy_px, cx_px, cy_px, tuple(distortion))


def parse_rotation(text: str) -> Rotation:
    """Read a unit quaternion; raises UsageError."""
    values = _numbers("--camera-on-head", text)
    if len(values) != 4 or not abs(float(np.linalg.norm(values)) - 1) < 0.01:
        raise UsageError(f"align: --camera-on-head {text}: expected a unit quaternion X,Y,Z,W")
    return Rotation.from_quat(values)


def _numbers(option: str, text: str) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = [np.nan]
    if not np.isfinite(values).all():
        raise UsageError(f"align: {option} {text}: expected numbers with commas between")
    return values


def save_print(path: Path, number: int, size_mm: float) -> None:
    """Write the marker with its white edge, in its true size; raises UsageError."""
    from matplotlib.figure import Figure  # slow to load

    picture: NDArray[np.uint8] = marker.draw(number, 6 * _MODULE_PX)
    across_in = size_mm * picture.shape[0] / (6 * _MODULE_PX) / 25.4
    figure = Figure(figsize=(across_in, across_in))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(picture, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    axes.set_axis_off()
    try:
        figure.savefig(path, dpi=600)
    except OSError as error:
        raise UsageError(
            f"align: --print {path}: cannot be written: {error.strerror}: name another file"
        ) from None
