"""The mount file: the fixed rotation from probe to head, as `lightprobed --mount` reads it."""

from __future__ import annotations

import configparser
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from lightprobe.align.track import AlignError
from lightprobe.calibrate import files
from lightprobe.geometry import Array


@dataclass(frozen=True, eq=False)
class Mount:
    """How a probe sits on a head."""

    rotation: Rotation  # probe → head
    sigma_deg: float  # 1 sigma about the axis known worst
    offset_m: Array | None = None  # (3,) probe's lens in the head's frame; None: not known
    offset_sigma_m: Array | None = None  # (3,) 1 sigma along each axis; in no file


def save(path: Path, mount: Mount, remark: str) -> Path | None:
    """Write a mount file, completely or not at all; gives where the former one was kept."""
    numbers = ", ".join(f"{value:.9f}" for value in mount.rotation.as_quat(canonical=True))
    text = (
        f"# {remark}\n"
        "# Turns directions of the probe into those of the head: x, y, z, w; +Y up, -Z forward.\n"
        f"[mount]\nrotation_xyzw = {numbers}\nsigma_deg = {mount.sigma_deg:.4g}\n"
    )
    if mount.offset_m is not None:
        place = ", ".join(f"{value:.4f}" for value in mount.offset_m)
        text += "# Where the probe's lens is on the head: metres in the head's axes.\n"
        text += f"offset_m = {place}\n"
    return files.save(path, text)


def load(path: Path) -> Mount:
    """Read a mount file; raises :class:`AlignError`."""
    ini = configparser.ConfigParser(inline_comment_prefixes=("#", ";"))
    try:
        ini.read_string(path.read_text(encoding="utf-8"))
        numbers = [float(word) for word in ini["mount"]["rotation_xyzw"].split(",")]
        sigma_deg = float(ini["mount"]["sigma_deg"])
        words = ini["mount"].get("offset_m")
        place = [float(word) for word in words.split(",")] if words else []
    except OSError as error:
        raise AlignError(f"align: {path}: read: {error.strerror}: name a mount file") from None
    except (configparser.Error, KeyError, ValueError, UnicodeDecodeError):
        numbers, sigma_deg, place = [], 0.0, []
    if len(place) not in (0, 3) or not np.isfinite(place).all():
        numbers = []
    if len(numbers) != 4 or not abs(float(np.linalg.norm(numbers)) - 1) < 0.01 or sigma_deg <= 0:
        raise AlignError(
            f"align: {path}: read: no mount file: expected [mount] with rotation_xyzw = x, y, z, w "
            "and sigma_deg; `lightprobe align` writes one"
        )
    return Mount(Rotation.from_quat(numbers), sigma_deg, np.array(place) if place else None)
