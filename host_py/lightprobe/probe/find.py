"""Find ball and board in the pictures of a bracket."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lightprobe.calibrate.lens_board import Board
from lightprobe.geometry import Array
from lightprobe.imaging import image
from lightprobe.imaging.ball import Pinhole
from lightprobe.probe import board as boards
from lightprobe.probe import outline as outlines
from lightprobe.probe.kinds import Kind, ProbeError
from lightprobe.probe.outline import Outline

#: Shares of red, green and blue in the grey picture.
LUMA = (0.299, 0.587, 0.114)
#: Codes that a picture for finding should have in the mean.
_BEST_MEAN = 105.0
#: Outlines whose middles are nearer than this share of the radius are one.
_SAME = 0.25
#: A second ball is one whose edges are nearly as clear.
_AS_CLEAR = 0.85
#: An outline around the clearest one is the ball's if it is nearly as clear, and not far around.
_CLEAR_AROUND, _MOST_LARGER = 0.6, 1.6
_SMALLEST_RADIUS_PX = 12.0
#: Stated and measured diameter may differ by this share.
_WRONG_DIAMETER = 0.15


@dataclass(frozen=True, eq=False)
class Sight:
    """The ball in the pictures, and where the camera stands."""

    outline: Outline
    rotation: Array  # (3, 3) camera frame → probe frame; the identity without a board
    rotation_sigma_deg: float
    has_board: bool
    notes: tuple[str, ...] = field(default=())


@dataclass(frozen=True)
class Request:
    """What the user says of the pictures."""

    kind: Kind
    pinhole: Pinhole
    board: Board | None = None  # None: look for none
    square_mm: float | None = None  # of the board
    at_px: tuple[float, float, float] | None = None  # x, y, radius: about where the ball is


def as_codes(path: Path) -> NDArray[np.uint8]:
    """Codes (H, W, 3) of a picture file; of one of high range, its mid tones."""
    if path.suffix.lower() not in image.HDR_SUFFIXES:
        return image.read_srgb8(path)
    radiance = np.nan_to_num(np.asarray(image.read(path).radiance, np.float64), posinf=1e30)
    radiance = np.clip(radiance, 0, 1e30)
    middle = float(np.median(radiance.mean(axis=-1))) or float(radiance.mean()) or 1.0
    shown = radiance / (radiance + 2 * middle)
    return np.asarray(np.round(255 * shown ** (1 / 2.2)), np.uint8)


def find(files: Sequence[Path], request: Request) -> Sight:
    """Find ball and board; raises ProbeError with what to do where they are not to be found.

    Pictures of a bracket are tried in turn, those of medium brightness first.
    """
    pictures = sorted(
        ((file, as_codes(file)) for file in files),
        key=lambda pair: abs(float(pair[1].mean()) - _BEST_MEAN),
    )
    problems = []
    for file, codes in pictures:
        try:
            return find_in(codes, request)
        except ProbeError as error:
            problems.append(f"{file}: {error}")
    raise ProbeError(problems[0])


def find_in(codes: NDArray[np.uint8], request: Request) -> Sight:
    """Find ball and board in one picture (H, W, 3)."""
    grey = np.asarray(codes.astype(np.float32) @ LUMA, np.uint8)
    outline = find_outline(codes, grey, request)
    pose = boards.find(grey, request.pinhole, request.board) if request.board else None
    if request.board and pose is None:
        raise ProbeError(
            "no board is found: let the picture show most of it, sharp and evenly lit, or give "
            "--board none (then directions are in the frame of the camera)"
        )
    if pose is None:
        return Sight(outline, np.eye(3), 0.0, False)
    notes = check_diameter(outline, pose, request)
    return Sight(outline, pose.rotation, pose.sigma_deg, True, notes)


def find_outline(codes: NDArray[np.uint8], grey: NDArray[np.uint8], request: Request) -> Outline:
    """Find the outline of the ball; raises ProbeError."""
    picture = codes.astype(np.float32)
    guesses = [request.at_px] if request.at_px else outlines.guesses(grey)
    found = [
        outlines.refine(picture, request.pinhole, guess, request.kind.is_mirror)
        for guess in guesses
    ]
    likely = sorted(
        (one for one in found if one and one.support >= outlines.LEAST_SUPPORT),
        key=lambda one: -_clearness(one),
    )
    if not likely:
        raise ProbeError(
            "no outline of a ball is found: put it before a background that differs from it, let "
            "it be sharp, or say where it is: --ball-at X,Y,RADIUS in pixels"
        )
    best = _around(likely[0], likely)
    check_frame(best, request.pinhole, (codes.shape[1], codes.shape[0]))
    if best.radius_px < _SMALLEST_RADIUS_PX:
        raise ProbeError(f"the ball is {2 * best.radius_px:.0f} pixels across: go nearer")
    others = [one for one in likely[1:] if _is_other(one, best)]
    if others and _clearness(others[0]) > _AS_CLEAR * _clearness(best):
        at = [request.pinhole.places(one.axis[None])[0] for one in (best, others[0])]
        raise ProbeError(
            "two outlines may be the ball, at "
            + " and ".join(f"({x:.0f}, {y:.0f})" for x, y in at)
            + ": say which one: --ball-at X,Y,RADIUS in pixels"
        )
    return best


def _around(best: Outline, likely: Sequence[Outline]) -> Outline:
    """The largest outline around the clearest: what a ball mirrors may be a ring, too."""
    around = [
        one for one in likely
        if one.radius_px > best.radius_px and _clearness(one) > _CLEAR_AROUND * _clearness(best)
        and float(np.arccos(np.clip(one.axis @ best.axis, -1, 1))) + best.half_angle_rad
        < one.half_angle_rad * (1 + _SAME)
        and one.radius_px < _MOST_LARGER * best.radius_px
    ]  # fmt: skip
    return max(around, key=lambda one: one.radius_px) if around else best


def _clearness(outline: Outline) -> float:
    """What speaks for an outline: how much of it is seen, how clearly, and how well it fits."""
    return float(outline.support**4 * np.sqrt(outline.strength * outline.radius_px))


def _is_other(one: Outline, best: Outline) -> bool:
    """Tell whether it is another ball, and not the same or a ring within it."""
    apart = float(np.arccos(np.clip(one.axis @ best.axis, -1, 1)))
    return apart > best.half_angle_rad * (1 - _SAME) + one.half_angle_rad * _SAME


def check_frame(outline: Outline, pinhole: Pinhole, size_px: tuple[int, int]) -> None:
    """All of the ball must be in the picture; else ProbeError."""
    places = outline.places(pinhole)
    beyond = np.any((places < 0) | (places > np.array(size_px)), axis=1).mean()
    if beyond > 0:
        raise ProbeError(
            f"{100 * beyond:.0f} % of the ball's outline is outside of the picture: aim so that "
            "all of it is seen"
        )


def check_diameter(outline: Outline, pose: boards.Pose, request: Request) -> tuple[str, ...]:
    """A note where a ball of that diameter would not stand on the board."""
    if request.square_mm is None:
        return ()
    up = pose.rotation[1]
    # The centre is D along the axis, and its height over the board is the radius, D times ratio.
    height = float(-(pose.corner @ up))
    sinks = float(-(outline.axis @ up))
    distance = height / (sinks + outline.ratio) * request.square_mm
    measured_mm = 2 * distance * outline.ratio
    stated_mm = request.kind.diameter_mm
    if sinks + outline.ratio > 0 and abs(measured_mm - stated_mm) < _WRONG_DIAMETER * stated_mm:
        return ()
    return (
        f"by the board, a ball that stands on it is {measured_mm:.0f} mm across, not "
        f"{stated_mm:.0f}: is the diameter right, and --square? Directions do not depend on it",
    )
