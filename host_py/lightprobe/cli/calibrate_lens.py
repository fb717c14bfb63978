"""`lightprobe calibrate lens`: where pixels of a fisheye lens look, from pictures of a board."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer

from lightprobe.calibrate import camera_file, lens_board, lens_fit
from lightprobe.calibrate.lens_fit import Fit
from lightprobe.cli import calibrate, check
from lightprobe.errors import UsageError

#: Of the picture of the board: sharp on A3 paper.
_SQUARE_PX = 300


def command(
    pictures: Annotated[
        list[Path] | None,
        typer.Argument(metavar="FILE…", help="Pictures of the board, all of one size."),
    ] = None,
    board: Annotated[
        str, typer.Option(metavar="COLUMNSxROWS", help="Squares of the printed board.")
    ] = "11x8",
    draw: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.png",
            callback=check.new_file(".png"),
            help="Write the board, to be printed, and end.",
        ),
    ] = None,
    max_theta_deg: Annotated[
        float | None,
        typer.Option(
            callback=check.number(1, 180, "degrees"),
            help="Use the lens to this angle off its axis; default: to the farthest corner seen.",
        ),
    ] = None,
    output: calibrate.Output = None,
    as_json: calibrate.AsJson = False,
) -> None:
    """Find centre, focal length and distortion of a fisheye lens, with a printed board.

    Print the board (--draw), glue it on something flat, and take at least 6, better 20 pictures of
    it from near: in the middle, at the edges, tilted. Its size does not matter. --output writes the
    result into a camera file (docs/users/camera_calibration.md).
    Example: lightprobe calibrate lens board*.jpg --output my.camera
    """
    kind = lens_board.parse(board)
    if draw is not None:
        if not cv2.imwrite(str(draw), kind.draw(_SQUARE_PX)):
            raise UsageError(f"calibrate: --draw {draw}: cannot be written: name another file")
        typer.echo(f"written: {draw}", err=True)
        return
    if not pictures:
        raise UsageError("calibrate: lens: give pictures of the board, or --draw FILE.png")
    found, size_px = find_all(pictures, kind)
    result = lens_fit.fit(list(found.values()), size_px)
    for path, rms_px in zip(found, result.picture_rms_px, strict=True):
        if np.isnan(rms_px):
            typer.echo(f"note: {path}: left out: it contradicts the others", err=True)
    if as_json:
        typer.echo(json.dumps(to_json(result), indent=2))
    else:
        show(result)
    if output is not None:
        values = lens_values(result, max_theta_deg)
        camera_file.save_lens(output, size_px, values)
        typer.echo(f"written: {output}: [lens.0]", err=True)


def find_all(
    paths: list[Path], board: lens_board.Board
) -> tuple[dict[Path, lens_board.Corners], tuple[int, int]]:
    """Corners in each picture that shows enough, and the size of all; raises UsageError."""
    found: dict[Path, lens_board.Corners] = {}
    size_px: tuple[int, int] | None = None
    for path in paths:
        picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.is_file() else None
        if picture is None:
            raise UsageError(f"calibrate: {path}: read: no picture: name PNG or JPEG files")
        this_px = (picture.shape[1], picture.shape[0])
        if size_px not in (None, this_px):
            raise UsageError(
                f"calibrate: {path}: {this_px[0]}x{this_px[1]}, the others are "
                f"{size_px[0]}x{size_px[1]}: take all pictures in one size"
            )
        size_px = this_px
        corners = board.find(np.asarray(picture, np.uint8))
        if corners is None:
            typer.echo(f"note: {path}: the board is not found, or too little of it", err=True)
        else:
            found[path] = corners
    assert size_px is not None  # there is at least one picture
    return found, size_px


def lens_values(result: Fit, max_theta_deg: float | None) -> dict[str, str]:
    """Give what a camera file says of the lens."""
    lens = result.lens
    numbers = {
        "cx_px": lens.centre_px[0], "cy_px": lens.centre_px[1],
        "fx_px": lens.focal_px[0], "fy_px": lens.focal_px[1],
        **{f"k{i}": k for i, k in enumerate(lens.k, 1)},
        "max_theta_deg": max_theta_deg or lens.max_theta_deg,
    }  # fmt: skip
    return {key: f"{value:.6g}" for key, value in numbers.items()}


def to_json(result: Fit) -> dict[str, Any]:
    """Give the result as JSON."""
    numbers = {key: float(value) for key, value in lens_values(result, None).items()}
    used = sum(not np.isnan(rms) for rms in result.picture_rms_px)
    return {
        "lens": numbers, "rms_px": result.rms_px, "corners": result.corners,
        "pictures_used": used, "covered": result.covered,
    }  # fmt: skip


def show(result: Fit) -> None:
    """Print the result."""
    for key, value in lens_values(result, None).items():
        typer.echo(f"{key} = {value}")
    used = sum(not np.isnan(rms) for rms in result.picture_rms_px)
    typer.echo(
        f"{result.corners} corners in {used} pictures, off by {result.rms_px:.2f} px (RMS); "
        f"they reach {100 * result.covered:.0f} % of the way to the edge"
    )
