"""`lightprobe estimate --probe`: a ball or a rod in the pictures of an ordinary camera."""

from __future__ import annotations

import configparser
import dataclasses
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image

from lightprobe import daemon
from lightprobe.calibrate import lens_board
from lightprobe.cli import whole_file
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.estimate import EstimateFlag
from lightprobe.evaluate import offline
from lightprobe.geometry import Array
from lightprobe.imaging import image, metadata
from lightprobe.imaging.ball import Pinhole
from lightprobe.probe import board as boards
from lightprobe.probe import diffuse, find, kinds, mirror, rod
from lightprobe.probe.find import Request, Sight
from lightprobe.probe.kinds import ProbeError

#: Diagonal of 35 mm film.
_FILM_MM = float(np.hypot(36, 24))
#: Of the panorama of what a diffuse ball shows, which is nowhere finer than 8°.
_DIFFUSE_WIDTH = 480
#: Of the panorama of what a rod shows: fine enough for the sun. A lamp of it is found so near.
_ROD_WIDTH, _SAME_LAMP_DEG = 1440, 3.0
#: Sections of a camera file that are about codes, whatever is in the picture.
_OF_CODES = ("response", "photometry")


@dataclass(frozen=True)
class Options:
    """What the command line says of the probe."""

    probe: str
    intrinsics: str | None = None
    board: str = "11x8"
    square_mm: float | None = None
    at: str | None = None
    save_camera: Path | None = None


def estimate(
    files: Sequence[Path],
    exposures_us: Sequence[float],
    settings: offline.Settings,
    options: Options,
) -> daemon.Once:
    """Estimate with a ball or a rod as the probe.

    Raises UsageError, ProbeError, and what estimating does.

    The frame of the estimate is the board's, or without one the camera's.
    """
    kind = kinds.parse(options.probe)
    exposures_us = exposures_us or metadata.exposures_us([metadata.read(file) for file in files])
    size_px = mirror.size_of(files)
    pinhole = pinhole_of(options.intrinsics, files[0], size_px)
    board = None if options.board == "none" else lens_board.parse(options.board)
    if isinstance(kind, kinds.Upright):
        return _with_rod(files, exposures_us, settings, options, kind, pinhole)
    request = Request(kind, pinhole, board, options.square_mm, parse_place(options.at))
    sight = find.find(files, request)
    if not kind.is_mirror:
        if options.save_camera:
            raise UsageError("estimate: --save-camera: is for mirror balls")
        once = _with_diffuse(files, exposures_us, settings, sight, pinhole)
    else:
        once = _with_mirror(files, exposures_us, settings, options, request, sight)
    return dataclasses.replace(once, log=[*sight.notes, *once.log])


def _with_mirror(
    files: Sequence[Path],
    exposures_us: Sequence[float],
    settings: offline.Settings,
    options: Options,
    request: Request,
    sight: Sight,
) -> daemon.Once:
    ball = mirror.ball_of(sight, request.kind, request.pinhole)
    size_px = mirror.size_of(files)
    box = mirror.box_around(sight, request.pinhole, size_px)
    part = dataclasses.replace(ball, pinhole=mirror.moved(request.pinhole, box))
    if not part.is_possible:
        raise ProbeError("the ball is too small in the picture: go nearer")
    tail = _of_codes(settings.camera)
    if options.save_camera:
        text = mirror.camera_text(ball, sight, options.save_camera.stem, size_px) + tail
        whole_file.write("estimate", options.save_camera, text.encode())
    with tempfile.TemporaryDirectory(prefix="lightprobe-ball-") as name:
        folder = Path(name)
        cuts = [mirror.cut(file, box, folder, number) for number, file in enumerate(files)]
        notes = mirror.check_exposure(cuts, part)
        camera = folder / "ball.camera"
        cut_px = box.right - box.left, box.bottom - box.top
        camera.write_text(mirror.camera_text(part, sight, "ball", cut_px) + tail)
        settings = dataclasses.replace(settings, camera=str(camera))
        try:
            once = offline.estimate_pictures(cuts, exposures_us, settings)
        except LightprobeError as error:
            raise type(error)(_in_words(str(error), cuts, files)) from None
    return dataclasses.replace(once, log=notes + [_in_words(row, cuts, files) for row in once.log])


def _with_diffuse(
    files: Sequence[Path],
    exposures_us: Sequence[float],
    settings: offline.Settings,
    sight: Sight,
    pinhole: Pinhole,
) -> daemon.Once:
    """Solve for the light, let the pipeline list its lamps, and put in what is not known."""
    offline.check_exposures(files, exposures_us)
    light = diffuse.solve(diffuse.shading(files, exposures_us, sight, pinhole))
    once = listed(light.panorama(_DIFFUSE_WIDTH), settings)
    return with_sigmas(once, light, sight.rotation_sigma_deg, diffuse.ALBEDO_SIGMA)


class Solved(Protocol):
    """Light that was solved for, and how well it is known."""

    @property
    def relighting_sigma(self) -> float:
        """1 sigma of irradiance, over all normals, relative to its mean."""

    def direction_sigma_deg(self, direction: Array) -> float:
        """1 sigma of the direction of a lamp that is seen along this one."""


def with_sigmas(
    once: daemon.Once, light: Solved, rotation_sigma_deg: float, strength_sigma: float
) -> daemon.Once:
    """The estimate with what is not known of its light; `strength_sigma`: relative, of lamps."""
    found = once.estimate
    lamps = tuple(
        dataclasses.replace(
            lamp,
            direction_sigma_deg=float(np.hypot(
                light.direction_sigma_deg(lamp.direction), rotation_sigma_deg
            )),
            irradiance_sigma=np.hypot(
                0 if lamp.irradiance_sigma is None else lamp.irradiance_sigma,
                strength_sigma * lamp.irradiance,
            ),
        )
        for lamp in found.lights
    )  # fmt: skip
    sigma = float(np.hypot(found.relighting_sigma or 0.0, light.relighting_sigma))
    found = dataclasses.replace(
        found, lights=lamps, flags=found.flags | EstimateFlag.PARTIAL_VIEW, relighting_sigma=sigma
    )
    return dataclasses.replace(once, estimate=found)


def _with_rod(
    files: Sequence[Path],
    exposures_us: Sequence[float],
    settings: offline.Settings,
    options: Options,
    kind: kinds.Upright,
    pinhole: Pinhole,
) -> daemon.Once:
    """Find lamps by their shadows, let the pipeline list them, and put in what is known of them."""
    if options.board == "none" or options.square_mm is None:
        raise UsageError(
            "estimate: --probe rod: needs the printed board: give --square-mm, the side of its "
            "squares as printed"
        )
    if options.save_camera or options.at:
        raise UsageError("estimate: --save-camera and --ball-at: are for balls")
    board = lens_board.parse(options.board)
    stands = rod.stand(kind, board, options.square_mm)
    offline.check_exposures(files, exposures_us)
    pose = find_pose(files, pinhole, board)
    radiance, clipped = diffuse.merged(files, exposures_us)
    found = rod.solve(rod.sheet(radiance, clipped, pinhole, pose, board, stands), stands, pose)
    once = listed(found.panorama(_ROD_WIDTH), settings)
    seen = once.estimate
    lamps = []
    for lamp in seen.lights:
        known = max(found.lamps, key=lambda one: float(one.direction @ lamp.direction))
        told = dataclasses.replace(
            lamp, direction_sigma_deg=known.direction_sigma_deg,
            irradiance_sigma=known.irradiance_sigma * lamp.irradiance,
        )  # fmt: skip
        if known.direction @ lamp.direction > np.cos(np.radians(_SAME_LAMP_DEG)):
            radius_deg = float(np.degrees(known.radius_rad))
            told = dataclasses.replace(
                told, direction=known.direction, angular_radius_deg=radius_deg
            )
        lamps.append(told)
    sigma = float(np.hypot(seen.relighting_sigma or 0.0, found.relighting_sigma))
    seen = dataclasses.replace(
        seen, lights=tuple(lamps), flags=seen.flags | EstimateFlag.PARTIAL_VIEW,
        relighting_sigma=sigma,
    )  # fmt: skip
    return dataclasses.replace(once, estimate=seen, log=[*found.notes, *once.log])


def listed(panorama: NDArray[np.float32], settings: offline.Settings) -> daemon.Once:
    """What the pipeline makes of a panorama (H, 2H, 3) of light that was found otherwise."""
    with tempfile.TemporaryDirectory(prefix="lightprobe-probe-") as name:
        file = Path(name) / "light.pfm"
        image.write_pfm(file, panorama)
        settings = dataclasses.replace(settings, camera="equirect")
        return offline.estimate_pictures([file], (), settings)


def find_pose(files: Sequence[Path], pinhole: Pinhole, board: lens_board.Board) -> boards.Pose:
    """The board in the first picture that shows it; ProbeError."""
    problems = []
    for file in files:
        grey = np.asarray(find.as_codes(file).astype(np.float32) @ find.LUMA, np.uint8)
        try:
            pose = boards.find(grey, pinhole, board)
        except ProbeError as error:
            problems.append(f"{file}: {error}")
            continue
        if pose:
            return pose
        problems.append(
            f"{file}: no board is found: let the picture show most of it, sharp and evenly lit"
        )
    raise ProbeError(problems[0])


def _in_words(text: str, cuts: Sequence[Path], files: Sequence[Path]) -> str:
    """Name the user's files in the place of their parts."""
    for cut, file in zip(cuts, files, strict=True):
        text = text.replace(str(cut), str(file))
    return text


def _of_codes(camera: str) -> str:
    """The sections of a camera file that tell what codes mean, as text."""
    if camera == "equirect":
        return ""
    offline.load_camera(camera)  # says what is wrong with it
    config = configparser.ConfigParser(inline_comment_prefixes=(";", "#"), interpolation=None)
    config.read(camera)
    rows = []
    for section in (name for name in _OF_CODES if config.has_section(name)):
        rows.append(f"[{section}]")
        for key, value in config.items(section):
            beside = key == "table"
            rows.append(f"{key} = {Path(camera).resolve().parent / value if beside else value}")
    return "\n".join(["", *rows]) + "\n"


def pinhole_of(text: str | None, file: Path, size_px: tuple[int, int]) -> Pinhole:
    """The camera by `FX,FY,CX,CY[,K1,K2,P1,P2[,K3]]`, or by the Exif's focal length; UsageError."""
    if text is None:
        focal_px = _focal_px(file, size_px)
        if focal_px is None:
            raise UsageError(
                f"estimate: {file}: no focal length in its Exif: give --intrinsics FX,FY,CX,CY of "
                "the camera, in pixels of these pictures"
            )
        return Pinhole(focal_px, focal_px, size_px[0] / 2, size_px[1] / 2)
    values = _numbers(text)
    if len(values) not in (4, 8, 9) or min(values[:2]) <= 0:
        raise UsageError(
            f"estimate: --intrinsics {text}: expected FX,FY,CX,CY in pixels, or also "
            "K1,K2,P1,P2[,K3]"
        )
    fx_px, fy_px, cx_px, cy_px, *distortion = values
    return Pinhole(fx_px, fy_px, cx_px + 0.5, cy_px + 0.5, tuple(distortion))  # OpenCV's pixels


def _focal_px(file: Path, size_px: tuple[int, int]) -> float | None:
    """Focal length by the equivalent for 35 mm film, which is about the diagonal."""
    try:
        with Image.open(file) as picture:
            exif = picture.getexif().get_ifd(ExifTags.IFD.Exif)
            focal_mm = float(exif.get(ExifTags.Base.FocalLengthIn35mmFilm, 0))
    except (OSError, SyntaxError, ValueError, TypeError, ZeroDivisionError):
        return None
    return focal_mm / _FILM_MM * float(np.hypot(*size_px)) if focal_mm > 0 else None


def parse_place(text: str | None) -> tuple[float, float, float] | None:
    """Read `X,Y,RADIUS` in pixels; raises UsageError."""
    if text is None:
        return None
    values = _numbers(text)
    if len(values) != 3 or values[2] < 1:
        raise UsageError(f"estimate: --ball-at {text}: expected X,Y,RADIUS in pixels")
    return values[0], values[1], values[2]


def _numbers(text: str) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        return []
    return values if np.all(np.isfinite(values)) else []
