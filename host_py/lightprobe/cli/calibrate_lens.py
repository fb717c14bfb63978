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
    model: Annotated[
        str,
        typer.Option(
            metavar="|".join(lens_fit.MODELS),
            callback=check.one_of(lens_fit.MODELS),
            help="OpenCV's model. omnidir is rewritten as the polynomial of the other.",
        ),
    ] = "fisheye",
    max_theta_deg: Annotated[
        float | None,
        typer.Option(
            callback=check.number(1, 150, "degrees"),
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
    result = lens_fit.fit(list(found.values()), size_px, model)
    if max_theta_deg is not None:
        refuse_beyond(result, max_theta_deg)
    for path, rms_px in zip(found, result.picture_rms_px, strict=True):
        if np.isnan(rms_px):
            typer.echo(f"note: {path}: left out: it contradicts the others", err=True)
    if as_json:
        typer.echo(json.dumps(to_json(result, max_theta_deg), indent=2))
    else:
        show(result, max_theta_deg)
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


def refuse_beyond(result: Fit, max_theta_deg: float) -> None:
    """Raise UsageError where the fitted radius does not grow so far."""
    grows_deg = lens_fit.grows_to_deg(result.lens, max_theta_deg)
    if grows_deg < max_theta_deg:
        raise UsageError(
            f"calibrate: lens: --max-theta-deg {max_theta_deg:g}: what fits corners up to "
            f"{result.lens.max_theta_deg:.1f} degrees stops growing at {grows_deg:.0f}: take "
            "pictures with the board nearer to the rim, or name a smaller angle"
        )


def to_json(result: Fit, max_theta_deg: float | None) -> dict[str, Any]:
    """Give the result as JSON; sigma to the last corner and to max_theta_deg, of fisheye only."""
    numbers = {key: float(value) for key, value in lens_values(result, max_theta_deg).items()}
    used = sum(not np.isnan(rms) for rms in result.picture_rms_px)
    angles_deg = result.lens.max_theta_deg, numbers["max_theta_deg"]
    known = result.model == "fisheye"
    sigmas = [result.sigma_deg(angle) if known else None for angle in angles_deg]
    return {
        "model": result.model, "lens": numbers, "rms_px": result.rms_px, "corners": result.corners,
        "pictures_used": used, "covered": result.covered,
        "farthest_corner_deg": result.lens.max_theta_deg,
        "sigma_deg": sigmas[0], "sigma_at_max_theta_deg": sigmas[1],
    }  # fmt: skip


def show(result: Fit, max_theta_deg: float | None) -> None:
    """Print the result."""
    for key, value in lens_values(result, max_theta_deg).items():
        typer.echo(f"{key} = {value}")
    used = sum(not np.isnan(rms) for rms in result.picture_rms_px)
    farthest_deg = result.lens.max_theta_deg
    typer.echo(
        f"{result.corners} corners in {used} pictures, off by {result.rms_px:.2f} px (RMS); "
        f"they reach {100 * result.covered:.0f} % of the way to the edge and "
        f"{farthest_deg:.1f} degrees off the axis"
    )
    if result.model == "fisheye":
        beyond_deg = max(max_theta_deg or 0.0, farthest_deg)
        known = f"{result.sigma_deg(farthest_deg):.3f} degrees (1 sigma) up to there"
        if beyond_deg > farthest_deg:
            known += f", to {result.sigma_deg(beyond_deg):.2f} up to {beyond_deg:g} degrees"
        typer.echo(f"where pixels look is known to {known}")
