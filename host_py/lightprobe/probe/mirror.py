"""From a mirror ball in pictures to the camera file that the daemon reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from lightprobe.errors import UsageError
from lightprobe.imaging import image
from lightprobe.imaging.ball import SURFACES, Ball, Pinhole
from lightprobe.probe.find import Sight
from lightprobe.probe.kinds import Kind, ProbeError

#: Around the ball, of the pictures that the daemon gets.
_MARGIN_PX = 6
#: Of the ball's pixels, at the top of the scale: a picture of which so many are tells too little.
_MOST_CLIPPED = 0.4


@dataclass(frozen=True)
class Box:
    """A part of a picture, in whole pixels."""

    left: int
    top: int
    right: int
    bottom: int


def ball_of(sight: Sight, kind: Kind, pinhole: Pinhole) -> Ball:
    """Give the ball with its sigmas; lengths in millimetres."""
    radius_mm = kind.diameter_mm / 2
    index, extinction = SURFACES[kind.surface]
    return Ball(
        pinhole, sight.outline.axis * radius_mm / sight.outline.ratio, radius_mm, index, extinction,
        outline_sigma_px=sight.outline.sigma_px, rotation_sigma_deg=sight.rotation_sigma_deg,
    )  # fmt: skip


def camera_text(ball: Ball, sight: Sight, name: str, size_px: tuple[int, int]) -> str:
    """Text of the camera file for pictures of that size."""
    x, y, z, w = Rotation.from_matrix(sight.rotation).as_quat(canonical=True)
    pinhole, centre = ball.pinhole, ball.centre
    distortion = ", ".join(f"{value:.9g}" for value in pinhole.distortion)
    rows = [
        "[camera]", "version = 1", f"name = {name}", "projection = ball",
        f"width_px = {size_px[0]}", f"height_px = {size_px[1]}", "",
        "[lens.0]", f"cx_px = {pinhole.cx_px:.6f}", f"cy_px = {pinhole.cy_px:.6f}",
        f"fx_px = {pinhole.fx_px:.6f}", f"fy_px = {pinhole.fy_px:.6f}",
        f"rotation_wxyz = {w:.9f}, {x:.9f}, {y:.9f}, {z:.9f}", "",
        "[ball]", f"centre = {centre[0]:.6f}, {centre[1]:.6f}, {centre[2]:.6f}",
        f"radius = {ball.radius:.6f}", f"index = {ball.index:g}",
        f"extinction = {ball.extinction:g}", f"rim_px = {ball.rim_px:g}",
        f"outline_sigma_px = {ball.outline_sigma_px:.4f}",
        f"rotation_sigma_deg = {ball.rotation_sigma_deg:.4f}",
        *([f"distortion = {distortion}"] if distortion else []),
    ]  # fmt: skip
    return "\n".join(rows) + "\n"


def box_around(sight: Sight, pinhole: Pinhole, size_px: tuple[int, int]) -> Box:
    """The ball's part of a picture of that size."""
    places = sight.outline.places(pinhole)
    low = np.floor(places.min(axis=0)).astype(int) - _MARGIN_PX
    high = np.ceil(places.max(axis=0)).astype(int) + _MARGIN_PX
    return Box(
        max(int(low[0]), 0), max(int(low[1]), 0), min(int(high[0]), size_px[0]),
        min(int(high[1]), size_px[1]),
    )  # fmt: skip


def moved(pinhole: Pinhole, box: Box) -> Pinhole:
    """Give the camera of that part of its pictures."""
    return replace(pinhole, cx_px=pinhole.cx_px - box.left, cy_px=pinhole.cy_px - box.top)


def size_of(files: Sequence[Path]) -> tuple[int, int]:
    """Width and height that all pictures have; raises UsageError where they differ."""
    sizes = {}
    for file in files:
        if file.suffix.lower() in image.HDR_SUFFIXES:
            shape = np.shape(image.read(file).radiance)
            sizes[file] = (int(shape[1]), int(shape[0]))
        else:
            codes = image.read_srgb8(file)
            sizes[file] = (codes.shape[1], codes.shape[0])
    if len(set(sizes.values())) != 1:
        raise UsageError("estimate: --probe: all pictures of a bracket must have the same size")
    return sizes[files[0]]


def cut(file: Path, box: Box, folder: Path, number: int) -> Path:
    """Write that part of a picture into `folder`, with what its file says of the exposure."""
    rows, columns = slice(box.top, box.bottom), slice(box.left, box.right)
    if file.suffix.lower() in image.HDR_SUFFIXES:
        target = folder / f"{number:04}.pfm"
        image.write_pfm(target, np.asarray(image.read(file).radiance)[rows, columns])
        return target
    target = folder / f"{number:04}.png"
    exif = b""
    try:
        with Image.open(file) as picture:
            exif = picture.info.get("exif", b"")
    except (OSError, SyntaxError, ValueError):
        exif = b""
    codes = np.ascontiguousarray(image.read_srgb8(file)[rows, columns])
    Image.fromarray(codes).save(target, "PNG", exif=exif)
    return target


def check_exposure(files: Sequence[Path], ball: Ball) -> list[str]:
    """Notes on clipped highlights; ProbeError where too much of the ball clips in all pictures.

    `files`: the cut pictures, of which `ball` has the places.
    """
    shares = []
    for file in files:
        if file.suffix.lower() in image.HDR_SUFFIXES:
            return []
        codes = image.read_srgb8(file)
        y, x = np.mgrid[: codes.shape[0], : codes.shape[1]] + 0.5
        _, mirrored = ball.look(np.stack([x, y], axis=-1).reshape(-1, 2))
        on_ball = mirrored.reshape(codes.shape[:2]) > 0
        shares.append(float((codes.max(axis=-1) >= 255)[on_ball].mean()))
    least = min(shares)
    if least > _MOST_CLIPPED:
        raise ProbeError(
            f"{100 * least:.0f} % of the ball is overexposed: expose so that only lamps clip, and "
            "add shorter exposures of the same view"
        )
    if least > 0:
        return [
            f"{100 * least:.1f} % of the ball is overexposed in the shortest exposure: how strong "
            "these lamps are is not known: add a shorter one"
        ]
    return []
