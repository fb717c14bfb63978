"""The daemon's own pipeline over files: what `lightprobe estimate` and `evaluate` run.

The daemon reads JPEG and PFM; everything else becomes one of them first. 8- and 16-bit pictures
become JPEG (quality 100, RGB) rather than floats, so that the daemon knows them for
camera pictures: it sees what is clipped and merges exposures.
"""

from __future__ import annotations

import itertools
import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lightprobe import daemon
from lightprobe.errors import UsageError
from lightprobe.estimate import Estimate
from lightprobe.evaluate import seen_part
from lightprobe.imaging import camera as cameras
from lightprobe.imaging import image, metadata, transparency
from lightprobe.imaging.camera import Camera
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.metadata import WHOLE, Crop, Metadata

#: In one set (LP_PARAM_FLOATS_MAX of the daemon).
MOST_PICTURES = 32
#: How far from two by one an equirectangular picture may be, of its width.
_OFF_SHAPE = 0.01
#: A longer exposure may be darker by this much: noise, and nothing to see.
_DARKER_CODES = 1.0
#: Codes that tell light: above the noise in the shorter picture, below saturation in the longer.
_TELLING_CODES = (6, 245)
_LEAST_TELLING = 0.01
#: Light and exposures may disagree by this factor: no camera's curve is quite sRGB.
_WRONG_RATIO = 2.0
#: Of the daemon's log: a picture did not count; a line's level; a line that sums up the others.
_UNUSED = re.compile(r"^error |left out|not used")
_LEVEL = re.compile(r"^(error|warning) ")
_SEE_ABOVE = re.compile(r"\(see above\)$")


@dataclass(frozen=True)
class Settings:
    """Command line of the pipeline; None leaves the daemon's default."""

    camera: str = "equirect"
    preset: str | None = None
    panorama_width: int | None = None
    decode: str | None = None
    exact_blocks: int | None = None
    refine_cells: int | None = None
    detector: str | None = None
    sh_order: int | None = None
    lights: int | None = None
    area_lights: bool = False
    key_light: bool = False
    reflection_map: int | None = None  # texels along an edge; None: off
    ring_lux: str | None = None  # nine numbers, or nan, separated by commas
    ring_sigma: float | str | None = None  # relative: one number for all, or nine
    ring_rgb: str | None = None  # 27 numbers
    ring_colour_sigma: float | None = None  # relative, of these
    cd_m2_per_unit: float | None = None
    cd_m2_per_unit_sigma: float | None = None  # relative
    wheel_deg: tuple[float, ...] = ()  # of the polarizer in each picture, in turn; empty: none
    film: Sheet | None = None  # of the polarizer; None: as the camera file says

    def with_ring_of(self, reading: Settings) -> Settings:
        """Give these settings with the ring and scale of `reading`, if it has any."""
        names = (
            "ring_lux",
            "ring_sigma",
            "ring_rgb",
            "ring_colour_sigma",
            "cd_m2_per_unit",
            "cd_m2_per_unit_sigma",
        )
        given = {name: getattr(reading, name) for name in names}
        return replace(self, **{name: value for name, value in given.items() if value is not None})

    def arguments(self) -> list[str]:
        """Options for lightprobed."""
        options: dict[str, object] = {
            "camera": self.camera,
            "preset": self.preset,
            "panorama-width": self.panorama_width,
            "decode": self.decode,
            "exact-blocks": self.exact_blocks,
            "refine-cells": self.refine_cells,
            "detector": self.detector,
            "sh-order": self.sh_order,
            "lights": self.lights,
            "area-lights": int(self.area_lights) or None,
            "key-light": int(self.key_light) or None,
            "reflection-map": self.reflection_map,
            "ring-lux": self.ring_lux,
            "ring-sigma": self.ring_sigma,
            "ring-rgb": self.ring_rgb,
            "ring-colour-sigma": self.ring_colour_sigma,
            "cd-m2-per-unit": self.cd_m2_per_unit,
            "cd-m2-per-unit-sigma": self.cd_m2_per_unit_sigma,
        }
        if self.wheel_deg:
            options["polarizer"] = "sweep"
        if self.wheel_deg and self.film:
            options["polarizer-transmission"] = self.film.transmission
            options["polarizer-extinction"] = self.film.extinction_ratio
            options["polarizer-offset"] = self.film.offset_deg
            options["polarizer-index"] = self.film.index
        return [f"--{name}={value}" for name, value in options.items() if value is not None]


def write_jpeg(path: Path, codes: NDArray[np.uint8]) -> None:
    """Write RGB codes (height, width, 3) with as little loss as JPEG allows: as RGB.

    Rounding to luma and chroma would shift the means of dim colours by a code.
    """
    Image.fromarray(codes).save(path, "JPEG", quality=100, subsampling=0, keep_rgb=True)


@dataclass(frozen=True, eq=False)
class Staged:
    """One of the user's files, as the daemon will read it."""

    file: Path
    frame: Path  # in the temporary folder
    size_px: tuple[int, int]
    codes: NDArray[np.uint8] | None  # (height, width, 3) RGB of an 8- or 16-bit picture
    notes: tuple[str, ...] = ()
    says: Metadata = field(default_factory=Metadata)
    unseen: NDArray[np.bool_] | None = None  # (height, width); None: nowhere


def stage(files: Sequence[Path], folder: Path) -> list[Staged]:
    """Put files into `folder` as frames that the daemon reads, in order."""
    return [_stage_one(file, folder / f"{index:04}") for index, file in enumerate(files)]


def _stage_one(file: Path, frame: Path) -> Staged:
    if not file.is_file():
        raise image.ImageError(f"image: {file}: open: no such file")
    says = metadata.read(file)
    if file.suffix.lower() in image.JPEG_SUFFIXES:
        codes, frame = image.read_srgb8(file), frame.with_suffix(".jpg")
        frame.symlink_to(file.resolve())  # the daemon tells of its orientation
        return Staged(file, frame, _size_px(codes), codes, says=says)
    picture = image.read(file)
    notes, unseen = list(picture.notes), picture.unseen
    if says.orientation != 1:
        notes.append(
            f"orientation {says.orientation} is not obeyed: pixels count as they are stored"
        )
    if picture.bits == 32:
        frame, radiance = frame.with_suffix(".pfm"), picture.radiance
        if unseen is not None:
            radiance = transparency.fill(radiance, unseen)
        image.write_pfm(frame, radiance)
        return Staged(file, frame, _size_px(radiance), None, tuple(notes), says, unseen)
    codes, frame = image.read_srgb8(file), frame.with_suffix(".jpg")
    if unseen is not None:
        codes = transparency.fill(codes, unseen)
    write_jpeg(frame, codes)
    if picture.bits == 16:
        notes.append("16 bits a channel are read as 8, and rounded at random")
    return Staged(file, frame, _size_px(codes), codes, tuple(notes), says, unseen)


def _size_px(picture: NDArray[np.generic]) -> tuple[int, int]:
    return picture.shape[1], picture.shape[0]


# ---------------------------------------------------------------- checks


def check_exposures(
    files: Sequence[Path], exposures_us: Sequence[float], wheel_deg: Sequence[float] = ()
) -> None:
    """Several files are one bracket and need one exposure each; raises UsageError otherwise.

    Through a polarizer each needs an angle of the wheel, and may be of one unknown exposure.
    """
    if len(files) > MOST_PICTURES:
        raise UsageError(
            f"estimate: {len(files)} files: at most {MOST_PICTURES} in one bracket: leave some out"
        )
    if wheel_deg and len(wheel_deg) != len(files):
        raise UsageError(
            f"estimate: {len(files)} files and {len(wheel_deg)} angles of the wheel: "
            "one for each file"
        )
    if exposures_us and len(exposures_us) != len(files):
        raise UsageError(
            f"estimate: {len(files)} files and {len(exposures_us)} exposures: one for each file"
        )
    if len(files) > 1 and not exposures_us and not wheel_deg:
        raise UsageError(
            "estimate: several files form one bracket, and not all say in their Exif or XMP how "
            "they were exposed: give their exposures with --exposure-us A,B,…"
        )
    if any(not value > 0 or not np.isfinite(value) for value in exposures_us):
        raise UsageError(f"estimate: exposures {list(exposures_us)}: expected microseconds above 0")
    if exposures_us and any(file.suffix.lower() in image.HDR_SUFFIXES for file in files):
        raise UsageError("estimate: HDR files contain radiance already: leave --exposure-us out")


def check_one_size(pictures: Sequence[Staged]) -> None:
    """Pictures of one bracket have one size; raises UsageError otherwise."""
    first = pictures[0]
    for other in pictures[1:]:
        if other.size_px != first.size_px:
            raise UsageError(
                f"estimate: {other.file}: {_times(other)}, but {first.file}: {_times(first)}: "
                "all pictures of a bracket must have the same size"
            )


def check_shape(picture: Staged, camera: Camera) -> None:
    """An equirectangular picture of all of the sphere is two by one; else UsageError."""
    width, height = picture.size_px
    crop = camera.crop or WHOLE
    sphere = width / crop.width, height / crop.height
    if camera.is_equirect and abs(sphere[0] - 2 * sphere[1]) > _OFF_SHAPE * sphere[0]:
        raise UsageError(
            f"estimate: {picture.file}: {_times(picture)}: an equirectangular picture is twice as "
            "wide as high, unless it or a camera file says that it is a part of one: name another "
            "projection's camera file, --camera FILE "
            "(docs/users/camera_files.md)"
        )


def common_crop(pictures: Sequence[Staged]) -> Crop | None:
    """The part of the sphere that all of them say they show; raises ImageError, UsageError."""
    first = pictures[0]
    for picture in pictures:
        if picture.says.fault:
            raise image.ImageError(
                f"image: {picture.file}: {picture.says.fault}: remove it, or give --camera FILE "
                "with a [crop]"
            )
        if picture.says.crop != first.says.crop:
            raise UsageError(
                f"estimate: {picture.file} and {first.file} show other parts of the sphere "
                "(GPano): all pictures of a bracket must show the same"
            )
    return first.says.crop


def check_colours(pictures: Sequence[Staged], camera: Camera) -> list[str]:
    """Codes are sRGB, unless the camera file has a response; notes, or raises ImageError."""
    notes = []
    for picture in pictures:
        space = picture.says.space
        if space.fault and picture.codes is not None and camera.response is None:
            raise image.ImageError(
                f"image: {picture.file}: {space.fault}: expected sRGB: convert it, or give "
                "--camera FILE with a [response]"
            )
        if space.note and picture.codes is not None:
            notes.append(f"{picture.file}: {space.note}")
    return notes


def common_unseen(pictures: Sequence[Staged]) -> NDArray[np.bool_] | None:
    """Where (height, width) any of them shows nothing; None: nowhere."""
    unseen = [picture.unseen for picture in pictures if picture.unseen is not None]
    return np.any(unseen, axis=0) if unseen else None


def _times(picture: Staged) -> str:
    return f"{picture.size_px[0]}×{picture.size_px[1]}"


def check_bracket(
    pictures: Sequence[Staged], exposures_us: Sequence[float], table: NDArray[np.float64]
) -> list[str]:
    """Compare neighbours of a bracket by what they show; notes on those that do not fit.

    `table`: linear light (256, 3) of each code. Raises UsageError when a picture is darker than one
    of a shorter exposure: the exposures are not in the order of the files.
    """
    notes = []
    order = sorted(range(len(pictures)), key=lambda index: exposures_us[index])
    for i, j in itertools.pairwise(order):
        short, long = pictures[i], pictures[j]
        if short.codes is None or long.codes is None:
            continue
        darker = long.codes.mean() < short.codes.mean() - _DARKER_CODES
        if darker and exposures_us[i] != exposures_us[j]:
            raise UsageError(
                f"estimate: {long.file} ({exposures_us[j]:g} us) is darker than {short.file} "
                f"({exposures_us[i]:g} us): are the exposures in the order of the files?"
            )
        seen = _ratio(short.codes, long.codes, table)
        stated = exposures_us[j] / exposures_us[i]
        if seen is not None and not 1 / _WRONG_RATIO < seen / stated < _WRONG_RATIO:
            notes.append(
                f"{short.file} to {long.file}: the light grows {seen:.3g} times, the exposure "
                f"{stated:.3g} times: is one of the exposures wrong, or is the response of the "
                f"camera not sRGB (--camera FILE with a [response])?"
            )
    return notes


def _ratio(
    short: NDArray[np.uint8], long: NDArray[np.uint8], table: NDArray[np.float64]
) -> float | None:
    """How many times more light the longer exposure shows; None where too little tells."""
    tells = (short >= _TELLING_CODES[0]) & (long <= _TELLING_CODES[1])
    if tells.mean() < _LEAST_TELLING:
        return None
    light = [
        sum(float(table[codes[..., c], c][tells[..., c]].sum()) for c in range(3))
        for codes in (short, long)
    ]
    return light[1] / light[0] if light[0] > 0 else None


# ---------------------------------------------------------------- estimating


def estimate_files(
    files: Sequence[Path], exposures_us: Sequence[float] = (), settings: Settings | None = None
) -> tuple[Estimate, list[str]]:
    """Estimate from files (several are one bracket); also returns notes on how they were read.

    Radiance is in the files' own units (HDR), relative to full scale (8 bit without exposure), or
    with exposures such that 1.0 = full scale at one second. Raises UsageError for files that are no
    bracket, ImageError and DaemonError for those that cannot be used, each with the file's name.
    """
    once = estimate_pictures(files, exposures_us, settings)
    return once.estimate, once.log


def estimate_pictures(
    files: Sequence[Path], exposures_us: Sequence[float] = (), settings: Settings | None = None
) -> daemon.Once:
    """As :func:`estimate_files`, with the reflection map if the settings ask for one."""
    settings = settings or Settings()
    exposures_us = exposures_us or metadata.exposures_us([metadata.read(file) for file in files])
    check_exposures(files, exposures_us, settings.wheel_deg)
    camera = load_camera(settings.camera)
    with (
        tempfile.TemporaryDirectory(prefix="lightprobe-") as name,
        tempfile.TemporaryDirectory(prefix="lightprobe-camera-") as beside,
    ):
        pictures = stage(files, Path(name))
        check_one_size(pictures)
        part = seen_part.Part(
            pictures[0].size_px,
            common_crop(pictures) if camera.is_equirect and not camera.crop else None,
            common_unseen(pictures),
        )
        if part.crop or part.unseen is not None:
            settings = replace(
                settings, camera=seen_part.write(settings.camera, camera, part, Path(beside))
            )
            camera = load_camera(settings.camera)
        check_shape(pictures[0], camera)
        notes = [f"{picture.file}: {note}" for picture in pictures for note in picture.notes]
        notes += check_colours(pictures, camera)
        if exposures_us and not settings.wheel_deg:
            notes += check_bracket(pictures, exposures_us, camera.response_table())
        try:
            once = _estimate_folder(Path(name), exposures_us, settings)
            log = [line for line in once.log if not line.startswith("info ")]
            unused = [line for line in log if _UNUSED.search(line)]
            if unused:
                raise daemon.DaemonError("\n".join(unused))
        except (UsageError, daemon.DaemonError) as error:
            raise type(error)(_in_words(str(error), pictures)) from None
    return replace(once, log=notes + [_in_words(line, pictures) for line in log])


def load_camera(name: str) -> Camera:
    """Load what was asked for; UsageError for what is no camera file."""
    try:
        return cameras.load(name)
    except cameras.CameraError as error:
        raise UsageError(str(error)) from None


def _in_words(log: str, pictures: Sequence[Staged]) -> str:
    """Log lines as one, with the user's files in the place of the temporary ones."""
    lines = log.splitlines()
    lines = [_LEVEL.sub("", line) for line in lines if not line.startswith("info ")] or lines
    text = "; ".join([line for line in lines if not _SEE_ABOVE.search(line)] or lines)
    for picture in pictures:
        text = text.replace(str(picture.frame), str(picture.file))
    text = text.replace(str(pictures[0].frame.parent), "the pictures")
    if not any(str(picture.file) in text for picture in pictures):
        files = ", ".join(str(picture.file) for picture in pictures)
        text = f"{files}: {text}" if len(pictures) == 1 else f"one of {files}: {text}"
    return text


def estimate_folder(
    folder: Path, exposures_us: Sequence[float] = (), settings: Settings | None = None
) -> Estimate:
    """Estimate from a folder of frames as :func:`stage` leaves it."""
    return _estimate_folder(folder, exposures_us, settings or Settings()).estimate


def _estimate_folder(
    folder: Path, exposures_us: Sequence[float], settings: Settings
) -> daemon.Once:
    """The same with all that the daemon gave."""
    lists = {"exposures_us": exposures_us, "wheel_deg": settings.wheel_deg}
    query = "&".join(
        f"{name}={','.join(f'{value:.9g}' for value in values)}"
        for name, values in lists.items()
        if len(values)
    )
    source = f"--source=file:{folder}{'?' if query else ''}{query}"
    return daemon.run_once([source, *settings.arguments()])
