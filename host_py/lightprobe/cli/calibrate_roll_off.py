"""`lightprobe calibrate roll-off`: how much darker a lens is towards its rim."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from lightprobe import geometry
from lightprobe.calibrate import camera_file, roll_off, turned_pictures
from lightprobe.calibrate.exposure_series import Codes, ExposureSeries, Frame
from lightprobe.calibrate.roll_off import RollOff, RollOffError
from lightprobe.cli import calibrate, check
from lightprobe.errors import UsageError
from lightprobe.geometry import Array
from lightprobe.imaging import camera as cameras
from lightprobe.imaging import image
from lightprobe.imaging.camera import Camera

#: Of which the longest that clips little is used for a camera; and when that is.
_LADDER_US = tuple(float(us) for us in 250 * 2 ** np.arange(8))
_CLIPPED_CODE, _MOST_CLIPPED = 243, 0.02
#: Frames of a camera that are used, spread over all that came with the exposure commanded: those
#: that say so within this share, and those that do not say from so long after the command.
_PICTURES, _SAME, _SETTLED_S = 36, 0.2, 1.5


def command(
    what: Annotated[
        list[str],
        typer.Argument(
            metavar="SOURCE|FILE…", help="A camera, or its pictures in the order of turning."
        ),
    ],
    camera: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Camera file with the lens; default: --output."),
    ] = None,
    output: calibrate.Output = None,
    step_deg: Annotated[
        float | None,
        typer.Option(
            callback=check.number(-90, 90, "degrees"),
            help="FILEs: each was turned by so much to the right, on a turntable; default: by what "
            "they show.",
        ),
    ] = None,
    exposure_us: Annotated[
        float | None,
        typer.Option(
            callback=check.number(0, unit="microseconds", above=True),
            help="SOURCE: expose so long; default: as long as little clips.",
        ),
    ] = None,
    frames: Annotated[
        int, typer.Option(min=60, max=10000, help="SOURCE: frames while it is turned.")
    ] = 900,
    keep: calibrate.Keep = None,
    patience_s: calibrate.Patience = 15.0,
    as_json: calibrate.AsJson = False,
) -> None:
    """Find the roll-off (vignetting) of a lens: relative light by the angle off its axis.

    Turn the camera slowly once around while it takes frames, or give pictures, each turned by about
    15 degrees. The light must be steady. It need not be even: large plain walls are best, with some
    detail to see the turning by. The camera file must have the lens (calibrate lens), and the
    response if that is not sRGB (docs/users/camera_calibration.md).
    Example: lightprobe calibrate roll-off turned*.jpg --output my.camera
    """
    path = camera or output
    if path is None:
        raise UsageError("calibrate: roll-off: name the camera file: --output FILE, or --camera")
    lens = cameras.load(str(path))
    if lens.is_equirect:
        raise UsageError(
            f"calibrate: roll-off: {path}: it has no lens: run lightprobe calibrate lens first"
        )
    if len(what) == 1 and calibrate.is_source(what[0]):
        if step_deg is not None:
            raise UsageError("calibrate: --step-deg is for files only: leave it out for a camera")
        pictures, names = of_source(what[0], str(path), exposure_us, frames, keep, patience_s)
    else:
        pictures, names = of_files([Path(name) for name in what])
    if len(pictures) < roll_off.LEAST_PICTURES:
        raise RollOffError(
            f"calibrate: roll-off: {len(pictures)} pictures, at least {roll_off.LEAST_PICTURES} "
            "are needed: 24, each turned by 15 degrees, are better"
        )
    if step_deg is None:
        pictures, turned = placed(pictures, lens, names)
    else:
        turned = on_turntable(step_deg, len(pictures))
    found = [roll_off.fit(pictures, turned, lens, k) for k in range(len(lens.lenses))]
    if as_json:
        typer.echo(json.dumps([to_json(one) for one in found], indent=2))
    else:
        for number, one in enumerate(found):
            show(number, lens, one)
    if output is not None:
        for number, one in enumerate(found):
            value = ", ".join(f"{a:.6g}" for a in one.rolloff)
            size_px = lens.width_px, lens.height_px
            camera_file.save(output, size_px, f"lens.{number}", {"rolloff": value})
            typer.echo(f"written: {output}: [lens.{number}] rolloff", err=True)


def of_files(paths: Sequence[Path]) -> tuple[list[Codes], list[str]]:
    """Read pictures, and their names; raises UsageError when their sizes differ."""
    pictures = []
    for path in paths:
        if not path.is_file():
            raise image.ImageError(f"image: {path}: open: no such file")
        pictures.append(image.read_srgb8(path))
        if pictures[-1].shape != pictures[0].shape:
            sizes = [f"{p.shape[1]}x{p.shape[0]}" for p in (pictures[-1], pictures[0])]
            raise UsageError(
                f"calibrate: {path}: {sizes[0]}, the others are {sizes[1]}: take all pictures in "
                "one size"
            )
    return pictures, [str(path) for path in paths]


def of_source(
    source: str,
    camera: str,
    exposure_us: float | None,
    frames: int,
    keep: Path | None,
    patience_s: float,
) -> tuple[list[Codes], list[str]]:
    """Pictures of a camera that is turned, and what to call them in messages."""
    if exposure_us is None:
        with calibrate.series(
            source, _LADDER_US, frames=8, camera=camera, output=None, keep=None,
            patience_s=patience_s,
        ) as ladder:  # fmt: skip
            exposure_us = longest(ladder)
        typer.echo(f"exposure: {exposure_us:g} us", err=True)
    typer.echo("turn the camera slowly, once around, and a little up and down", err=True)
    with calibrate.series(
        source, [exposure_us], frames=frames, camera=camera, output=None, keep=keep,
        patience_s=patience_s,
    ) as series:  # fmt: skip
        whole = [frame for frame in series.frames if not frame.corrupt and _settled(frame)]
        if len(whole) < roll_off.LEAST_PICTURES:
            raise RollOffError(
                f"calibrate: roll-off: {source}: only {len(whole)} of {len(series.frames)} frames "
                f"are whole and have the exposure commanded, {exposure_us:g} us: give "
                "--exposure-us a value that the camera can set, or more --frames"
            )
        chosen = [whole[k] for k in np.linspace(0, len(whole) - 1, _PICTURES).astype(int)]
        return _pictures(chosen)


def _settled(frame: Frame) -> bool:
    """Whether a frame was taken with the exposure that was commanded, as far as can be known."""
    if frame.commanded_us is None:  # a file: nothing was commanded
        return True
    if frame.stated_us is not None:
        return abs(frame.stated_us / frame.commanded_us - 1) < _SAME
    return frame.t_read_ns - frame.t_command_ns > _SETTLED_S * 1e9


def _pictures(frames: Sequence[Frame]) -> tuple[list[Codes], list[str]]:
    both = [
        (codes, f"frame {frame.sequence}")
        for frame in frames
        if (codes := frame.codes()) is not None
    ]
    return [codes for codes, _ in both], [name for _, name in both]


def longest(ladder: ExposureSeries) -> float:
    """The longest exposure in microseconds at which little of the picture clips."""
    best = None
    for group in ladder.steps():
        codes, us = group[-1].codes(), group[-1].commanded_us
        if codes is None or us is None:
            continue
        if np.mean(codes.max(axis=2) >= _CLIPPED_CODE) <= _MOST_CLIPPED:
            best = max(us, best or 0.0)
    if best is None:
        raise RollOffError(
            f"calibrate: roll-off: {ladder.source}: the picture clips at every exposure from "
            f"{_LADDER_US[0]:g} us: choose less light"
        )
    return best


def placed(
    pictures: Sequence[Codes], lens: Camera, names: Sequence[str]
) -> tuple[list[Codes], list[Array]]:
    """Pictures whose turn they show themselves, and their turns; says which are left out."""
    numbers, turned = turned_pictures.rotations(pictures, lens, names)
    for number, name in enumerate(names):
        if number not in numbers:
            typer.echo(f"left out: {name}: it shows too little to see how it was turned", err=True)
    return [pictures[number] for number in numbers], turned


def on_turntable(step_deg: float, count: int) -> list[Array]:
    """From the probe frame of each picture to that of the first: turned to the right about +Y."""
    half = -np.radians(step_deg) * np.arange(count) / 2
    return [geometry.rotation_matrix([np.cos(h), 0, np.sin(h), 0]) for h in half]


def to_json(found: RollOff) -> dict[str, Any]:
    """Give the result of one lens as JSON."""
    return {
        "rolloff": found.rolloff, "at_rim": found.at_rim, "sigma": found.sigma,
        "misfit": found.misfit, "seen_deg": found.seen_deg, "scatter": found.scatter,
        "places": found.cells,
    }  # fmt: skip


def show(number: int, camera: Camera, found: RollOff) -> None:
    """Print the result of one lens."""
    a1, a2, a3 = found.rolloff
    typer.echo(f"lens.{number}: rolloff = {a1:.6g}, {a2:.6g}, {a3:.6g}")
    typer.echo(
        f"  {100 * found.at_rim:.0f} % of the light at {camera.lenses[number].max_theta_deg:g} "
        f"degrees off the axis; known to {100 * found.sigma:.1f} % (1 sigma), the polynomial "
        f"misses by at most {100 * found.misfit:.1f} %; {found.cells} places, seen up to "
        f"{found.seen_deg:.0f} degrees, differ by {100 * found.scatter:.1f} % between pictures"
    )
