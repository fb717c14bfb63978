"""Change values in camera files (docs/users/camera_files.md) and leave everything else as it was.

Files appear whole or not at all, and the former one is kept (:mod:`lightprobe.calibrate.files`).
Response tables get a new name each (NAME.response-2.txt), so that every camera file, also a former
one, names the whole table that it was made with.
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lightprobe.calibrate import files as calibration
from lightprobe.geometry import Array
from lightprobe.imaging import camera
from lightprobe.imaging.camera import CameraError, Glare

_SECTION = re.compile(r"\s*\[([^]]+)\]")


def edited(text: str, section: str, values: Mapping[str, str | None]) -> str:
    """Give INI text with values set in a section, or left out (None).

    Comments and order of the rest are kept.
    """
    lines = text.splitlines()
    start, end = _extent(lines, section)
    if start is None:
        lines += ["", f"[{section}]"] if lines else [f"[{section}]"]
        start = end = len(lines)
    for key, value in values.items():
        pattern = re.compile(rf"\s*{re.escape(key)}\s*[=:]")
        at = next((i for i in range(start, end) if pattern.match(lines[i])), None)
        if value is None:
            if at is not None:
                del lines[at]
                end -= 1
        elif at is None:
            lines.insert(end, f"{key} = {value}")
            end += 1
        else:
            lines[at] = f"{key} = {value}"
    return "\n".join(lines) + "\n"


def _extent(lines: list[str], section: str) -> tuple[int | None, int]:
    """First line after a section's heading, and the line after its last that is not empty."""
    start = None
    for number, line in enumerate(lines):
        heading = _SECTION.match(line)
        if heading and start is not None:
            return start, _without_blank(lines, start, number)
        if heading and heading[1].strip() == section:
            start = number + 1
    return start, _without_blank(lines, start or 0, len(lines))


def _without_blank(lines: list[str], start: int, end: int) -> int:
    while end > start and not lines[end - 1].strip():
        end -= 1
    return end


def read_or_new(path: Path, size_px: tuple[int, int]) -> str:
    """Text of a camera file; that of a new equirectangular one when there is none."""
    try:
        return path.read_text()
    except FileNotFoundError:
        width, height = size_px
        return (
            f"[camera]\nversion = {camera.VERSION}\nname = {path.stem}\nprojection = equirect\n"
            f"width_px = {width}\nheight_px = {height}\n"
        )
    except (OSError, UnicodeDecodeError) as error:
        raise CameraError(f"camera: {path}: read: {error}") from None


def save(
    path: Path, size_px: tuple[int, int], section: str, values: Mapping[str, str | None]
) -> None:
    """Set values in a camera file, which is made when there is none; it must be valid after."""
    if path.exists():
        camera.load(str(path))  # a broken file is the user's to mend first
    calibration.save(path, edited(read_or_new(path, size_px), section, values))


def save_lens(path: Path, size_px: tuple[int, int], values: Mapping[str, str]) -> None:
    """Set values of the lens in a camera file, which becomes one of a fisheye camera."""
    if path.exists():
        known = camera.load(str(path))
        if (known.width_px, known.height_px) != size_px:
            raise CameraError(
                f"camera: {path}: its numbers refer to {known.width_px}x{known.height_px}, the "
                f"pictures are {size_px[0]}x{size_px[1]}: take pictures of that size, or name "
                "another file"
            )
    text = edited(read_or_new(path, size_px), "camera", {"projection": "fisheye"})
    calibration.save(path, edited(text, "lens.0", values))


def save_response(
    path: Path,
    size_px: tuple[int, int],
    table: Array,
    remark: str,
    processing: Sequence[str] | None = None,
) -> Path:
    """Write a response table (256, 3) beside a camera file and name it there; returns its path.

    `processing`: what the camera did to its pictures meanwhile; None: it did not tell.
    """
    number = 1
    while (target := path.with_name(f"{path.stem}.response-{number}.txt")).exists():
        number += 1
    rows = "".join(f"{r:.8f} {g:.8f} {b:.8f}\n" for r, g, b in table)
    calibration.save(target, rows + f"# {remark}\n")
    on = None if processing is None else ", ".join(processing) or "none"
    save(path, size_px, "response", {"table": target.name, "processing": on})
    return target


def save_stuck(path: Path, size_px: tuple[int, int], places_px: NDArray[np.intp]) -> Path:
    """Write places (n, 2) of stuck pixels beside a camera file and name them there.

    They are in pixels of `size_px` (width, height), and so must the camera file be. Returns their
    path.
    """
    if path.exists():
        known = camera.load(str(path))
        sized = re.search(r"(?m)^\s*width_px\s*[=:]", path.read_text()) is not None
        if sized and (known.width_px, known.height_px) != size_px:
            raise CameraError(
                f"camera: {path}: its numbers refer to {known.width_px}x{known.height_px}, the "
                f"pictures are {size_px[0]}x{size_px[1]}: take pictures of that size, or name "
                "another file"
            )
        if not sized:
            size = {"width_px": str(size_px[0]), "height_px": str(size_px[1])}
            save(path, size_px, "camera", size)
    number = 1
    while (target := path.with_name(f"{path.stem}.stuck-{number}.txt")).exists():
        number += 1
    rows = "".join(f"{x} {y}\n" for x, y in places_px.tolist())
    calibration.save(target, rows)
    save(path, size_px, "camera", {"stuck_pixels": target.name})
    return target


def save_glare(path: Path, size_px: tuple[int, int], glare: Glare) -> None:
    """State veiling glare in a camera file."""
    values = {
        "even": f"{glare.even:.4f}", "around": f"{glare.around:.4f}",
        "width_deg": f"{glare.width_deg:g}",
    }  # fmt: skip
    save(path, size_px, "glare", values)


def save_rig(paths: Sequence[Path], turns: Sequence[Rotation], sigmas_deg: Sequence[float]) -> str:
    """Turn the lenses of the cameras of one rig, and mark their files as belonging together.

    `turns`: from the frame of each file as it is to that of the first; returns the rig's id.
    """
    rig = secrets.token_hex(4)
    texts = []
    for number, (path, turn, sigma) in enumerate(zip(paths, turns, sigmas_deg, strict=True), 1):
        text = read_or_new(path, (0, 0))
        for k, lens in enumerate(camera.load(str(path)).lenses):
            w, x, y, z = lens.rotation_wxyz
            x, y, z, w = (turn * Rotation.from_quat([x, y, z, w])).as_quat(canonical=True)
            values = {"rotation_wxyz": f"{w:.7f}, {x:.7f}, {y:.7f}, {z:.7f}"}
            text = edited(text, f"lens.{k}", values)
        values = {"id": rig, "camera": str(number), "sigma_deg": f"{sigma:.3f}"}
        texts.append(edited(text, "rig", values))
    for path, text in zip(paths, texts, strict=True):
        calibration.save(path, text)
    return rig
