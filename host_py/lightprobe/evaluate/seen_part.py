"""The camera file of pictures that say themselves which part of the sphere they show."""

from __future__ import annotations

import configparser
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe.imaging.camera import Camera
from lightprobe.imaging.metadata import Crop


@dataclass(frozen=True, eq=False)
class Part:
    """What pictures of one size say."""

    size_px: tuple[int, int]
    crop: Crop | None  # of equirectangular ones; None: they do not say
    unseen: NDArray[np.bool_] | None  # (height, width); None: nowhere


def write(name: str, camera: Camera, part: Part, folder: Path) -> str:
    """Write a camera file like `name`, which `camera` is from, of that part; gives its path."""
    config = configparser.ConfigParser(inline_comment_prefixes=(";", "#"), interpolation=None)
    if name != "equirect":
        config.read(name)
        _name_from_everywhere(config, Path(name).resolve().parent)
        if not config.has_option("camera", "name"):
            config["camera"]["name"] = Path(name).stem
    if camera.is_equirect:
        _be_equirect(config, part)
    if part.unseen is not None:
        _mask(config, camera, part.unseen, folder)
    path = folder / "seen.camera"
    with path.open("w") as file:
        config.write(file)
    return str(path)


def _name_from_everywhere(config: configparser.ConfigParser, folder: Path) -> None:
    for section in config.sections():
        for key in ("mask", "stuck_pixels", "table"):
            if config.has_option(section, key):
                config[section][key] = str(folder / config[section][key])


def _be_equirect(config: configparser.ConfigParser, part: Part) -> None:
    width, height = part.size_px
    if not config.has_section("camera"):
        config["camera"] = {"projection": "equirect"}
    if not config.has_option("camera", "mask") and not config.has_section("crop"):
        config["camera"].update(width_px=str(width), height_px=str(height))
    if part.crop:
        # The numbers of a mask and of a crop refer to one size.
        width, height = int(config["camera"]["width_px"]), int(config["camera"]["height_px"])
        full_width, full_height = round(width / part.crop.width), round(height / part.crop.height)
        config["crop"] = {
            "full_width_px": str(full_width),
            "full_height_px": str(full_height),
            "left_px": str(round(part.crop.left * full_width)),
            "top_px": str(round(part.crop.top * full_height)),
        }


def _mask(
    config: configparser.ConfigParser, camera: Camera, unseen: NDArray[np.bool_], folder: Path
) -> None:
    """Add to every lens' mask what shows nothing."""
    size = int(config["camera"]["width_px"]), int(config["camera"]["height_px"])
    seen = np.where(unseen, 0, 255).astype(np.uint8)
    seen = np.asarray(cv2.resize(seen, size, interpolation=cv2.INTER_NEAREST), dtype=np.uint8)
    lenses = {f"lens.{number}": lens.mask for number, lens in enumerate(camera.lenses)}
    for section, mask in (lenses or {"camera": camera.mask}).items():
        path = folder / f"{section}.pgm"
        cv2.imwrite(str(path), seen if mask is None else np.minimum(seen, mask))
        config[section]["mask"] = str(path)
