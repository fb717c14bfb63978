"""The daemon's own pipeline over files: what `lightprobe estimate` and `evaluate` run.

The daemon reads JPEG and PFM; everything else becomes one of them first. 8-bit pictures become
JPEG (quality 100, chroma in full) rather than floats, so that the daemon knows them for camera
pictures: it sees what is clipped and merges exposures.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe import daemon
from lightprobe.errors import UsageError
from lightprobe.estimate import Estimate
from lightprobe.imaging import image


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

    def arguments(self) -> list[str]:
        """Options for lightprobed."""
        options = {
            "camera": self.camera,
            "preset": self.preset,
            "panorama-width": self.panorama_width,
            "decode": self.decode,
            "exact-blocks": self.exact_blocks,
            "refine-cells": self.refine_cells,
            "detector": self.detector,
            "sh-order": self.sh_order,
            "lights": self.lights,
        }
        return [f"--{name}={value}" for name, value in options.items() if value is not None]


def write_jpeg(path: Path, codes: NDArray[np.uint8]) -> None:
    """Write RGB codes (height, width, 3) with as little loss as JPEG allows."""
    options = [
        cv2.IMWRITE_JPEG_QUALITY, 100,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    ]  # fmt: skip
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(codes[..., ::-1]), options)
    if not done:
        raise image.ImageError(f"image: {path}: encode: JPEG refused {codes.shape}")
    path.write_bytes(data.tobytes())


def stage(files: Sequence[Path], folder: Path) -> list[str]:
    """Put files into `folder` as frames that the daemon reads, in order; returns notes on them."""
    notes = []
    for index, file in enumerate(files):
        suffix = file.suffix.lower()
        if not file.is_file():
            raise image.ImageError(f"image: {file}: open: no such file")
        if suffix in image.JPEG_SUFFIXES:
            (folder / f"{index:04}.jpg").symlink_to(file.resolve())
            continue
        picture = image.read(file)
        notes += [f"{file}: {note}" for note in picture.notes]
        if picture.bits == 8:
            write_jpeg(folder / f"{index:04}.jpg", image.read_srgb8(file))
        else:
            image.write_pfm(folder / f"{index:04}.pfm", picture.radiance)
    return notes


def check_exposures(files: Sequence[Path], exposures_us: Sequence[float]) -> None:
    """Several files are one bracket and need one exposure each; raises UsageError otherwise."""
    if exposures_us and len(exposures_us) != len(files):
        raise UsageError(
            f"estimate: {len(files)} files and {len(exposures_us)} exposures: one for each file"
        )
    if len(files) > 1 and not exposures_us:
        raise UsageError("estimate: several files are one bracket: give --exposure-us A,B,…")
    if any(not value > 0 or not np.isfinite(value) for value in exposures_us):
        raise UsageError(f"estimate: exposures {list(exposures_us)}: want microseconds above 0")
    if exposures_us and any(file.suffix.lower() in image.HDR_SUFFIXES for file in files):
        raise UsageError("estimate: HDR files are radiance already: leave out --exposure-us")


def estimate_files(
    files: Sequence[Path], exposures_us: Sequence[float] = (), settings: Settings | None = None
) -> tuple[Estimate, list[str]]:
    """Estimate from files (several are one bracket); also returns notes on how they were read.

    Radiance is in the files' own units (HDR), relative to full scale (8 bit without exposure), or
    with exposures such that 1.0 = full scale at one second.
    """
    check_exposures(files, exposures_us)
    with tempfile.TemporaryDirectory(prefix="lightprobe-") as name:
        notes = stage(files, Path(name))
        return estimate_folder(Path(name), exposures_us, settings), notes


def estimate_folder(
    folder: Path, exposures_us: Sequence[float] = (), settings: Settings | None = None
) -> Estimate:
    """Estimate from a folder of frames as :func:`stage` leaves it."""
    query = f"?exposures_us={','.join(f'{value:.9g}' for value in exposures_us)}"
    source = f"--source=file:{folder}{query if len(exposures_us) else ''}"
    return daemon.estimate_once([source, *(settings or Settings()).arguments()])
