"""Series of exposures: raw frames written by `lightprobed --series`.

Format: docs/users/camera_calibration.md.
"""

from __future__ import annotations

import json
import re
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe import daemon
from lightprobe.errors import LightprobeError, UsageError

Codes = NDArray[np.uint8]

INDEX = "index.jsonl"
VERSION = 1
_POLL_S = 0.1
_NAME = re.compile("[a-z-]{1,19}")


class SeriesError(LightprobeError):
    """A series that could not be taken or read; names folder or source, and the next step."""


@dataclass(frozen=True)
class Frame:
    """One frame as the camera delivered it, and the command that it came after."""

    path: Path
    format: str
    width_px: int
    height_px: int
    stride_bytes: int
    sequence: int  # the camera's own count; gaps are frames lost
    t_read_ns: int
    corrupt: bool
    step: int  # of the schedule; -1: nothing was commanded
    t_command_ns: int
    commanded_us: float | None  # exposure times gain
    stated_us: float | None  # exposure times gain, as the frame itself says; None: it does not

    def codes(self) -> Codes | None:
        """RGB codes (height, width, 3); None for a frame that is broken."""
        if self.corrupt:
            return None
        try:
            data = self.path.read_bytes()
        except OSError as error:
            raise SeriesError(f"series: {self.path}: read: {error.strerror}") from None
        return decode(data, self.format, (self.width_px, self.height_px), self.stride_bytes)


_SIDE_PX = (1, 16384)
_COUNT = (0, 2**64)
_TIME_NS = (-(2**63), 2**63)
# Fields of Frame that the index has by the same name: text, yes or no, or a number's limits.
_AS_WRITTEN: dict[str, type | tuple[int, int]] = {
    "format": str, "width_px": _SIDE_PX, "height_px": _SIDE_PX, "stride_bytes": (0, 2**30),
    "sequence": _COUNT, "t_read_ns": _TIME_NS, "corrupt": bool, "step": (-1, 2**31),
    "t_command_ns": _TIME_NS, "commanded_us": float,
}  # fmt: skip


@dataclass(frozen=True)
class ExposureSeries:
    """What a camera can do with its exposure, and its frames in order."""

    source: str
    settable: bool
    reports_exposure: bool
    min_us: float | None
    max_us: float | None
    step_us: float | None
    #: What the camera did to its pictures (docs/users/cameras.md); None: it did not tell.
    processing: tuple[str, ...] | None
    frames: tuple[Frame, ...]

    def steps(self) -> list[list[Frame]]:
        """Frames of each command; without commands, neighbours that state the same exposure."""
        groups: list[list[Frame]] = []
        for frame in self.frames:
            last = groups[-1][-1] if groups else None
            same = last is not None and last.step == frame.step
            if same and last is not None and frame.step < 0:
                same = last.stated_us == frame.stated_us
            if same:
                groups[-1].append(frame)
            else:
                groups.append([frame])
        return groups


def decode(data: bytes, kind: str, size_px: tuple[int, int], stride_bytes: int = 0) -> Codes | None:
    """RGB codes (H, W, 3) of a frame; None where its bytes make no picture.

    YCbCr is BT.601, full range, as UVC cameras deliver and the daemon reads it.
    """
    if kind not in ("MJPG", "YUYV", "NV12", "GREY"):
        raise SeriesError(
            f"series: format {kind}: float frames are radiance already and have no codes to "
            f"calibrate"
        )
    width, height = size_px
    raw = np.frombuffer(data, np.uint8)
    if (kind in ("YUYV", "NV12") and width % 2) or (kind == "NV12" and height % 2):
        return None
    if kind == "MJPG":
        try:
            picture = cv2.imdecode(raw, cv2.IMREAD_COLOR) if raw.size else None
        except cv2.error:
            picture = None
        return None if picture is None else np.ascontiguousarray(picture[..., ::-1])
    row_bytes = width * (2 if kind == "YUYV" else 1)
    stride = stride_bytes or row_bytes
    rows = height * 3 // 2 if kind == "NV12" else height
    if stride < row_bytes or raw.size < stride * (rows - 1) + row_bytes:
        return None
    raw = np.pad(raw, (0, max(0, stride * rows - raw.size)))
    plane = raw[: stride * rows].reshape(rows, stride)[:, :row_bytes]
    if kind == "GREY":
        return np.repeat(plane[..., None], 3, axis=2)
    if kind == "YUYV":
        packed = plane.reshape(height, width, 2)
        chroma = packed[..., 1].reshape(height, width // 2, 2).repeat(2, axis=1)
        return _to_rgb(packed[..., 0], chroma)
    chroma = plane[height:].reshape(height // 2, width // 2, 2).repeat(2, 0).repeat(2, 1)
    return _to_rgb(plane[:height], chroma)


def _to_rgb(luma: Codes, chroma: Codes) -> Codes:
    """`chroma` (H, W, 2) is Cb, Cr."""
    planes = np.stack([luma, chroma[..., 1], chroma[..., 0]], axis=-1)
    return np.asarray(cv2.cvtColor(planes, cv2.COLOR_YCrCb2RGB), dtype=np.uint8)


# ---------------------------------------------------------------- reading


def load(folder: Path) -> ExposureSeries:
    """Read the index of a series; raises :class:`SeriesError`."""
    where = f"series: {folder / INDEX}"
    try:
        lines = (folder / INDEX).read_text().splitlines()
        rows = [json.loads(line) for line in lines]
    except OSError as error:
        raise SeriesError(f"{where}: read: {error.strerror}") from None
    except (ValueError, RecursionError):
        raise SeriesError(
            f"{where}: parse: these are not JSON lines: is the series complete?"
        ) from None
    for number, row in enumerate(rows, 1):
        if not isinstance(row, dict):
            raise SeriesError(f"{where}: line {number}: is no JSON object: record the series again")
    if len(rows) < 2 or rows[0].get("lightprobe_series") != VERSION:
        raise SeriesError(f"{where}: not a series of version {VERSION}, or no frame was written")
    if not rows[-1].get("complete"):
        raise SeriesError(f"{where}: the series is incomplete: record it again")
    camera = _Row(rows[0], f"{where}: line 1")
    return ExposureSeries(
        source=camera.take("source", str),
        settable=camera.take("exposure_settable", bool),
        reports_exposure=camera.take("reports_exposure", bool),
        min_us=camera.take("exposure_min_us", float),
        max_us=camera.take("exposure_max_us", float),
        step_us=camera.take("exposure_step_us", float),
        processing=_processing(camera),
        frames=tuple(
            _frame(folder, _Row(row, f"{where}: line {number}"))
            for number, row in enumerate(rows[1:-1], 2)
        ),
    )


@dataclass(frozen=True)
class _Row:
    """One line of the index, and where it stands."""

    fields: dict[str, Any]
    where: str

    def take(self, name: str, kind: type | tuple[int, int]) -> Any:
        """A field: text, yes or no, a finite number or null (float), a whole one within limits."""
        if name not in self.fields:
            raise SeriesError(
                f"{self.where}: {name!r} is missing: was the series written by another version?"
            )
        value = self.fields[name]
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if isinstance(kind, tuple):
            right = number and isinstance(value, int) and kind[0] <= value <= kind[1]
        elif kind is float:
            right = value is None or (number and abs(value) < 1e18)
        else:
            right = isinstance(value, kind)
        if not right:
            raise SeriesError(
                f"{self.where}: {name!r} makes no sense ({value!r:.40}): record the series again"
            )
        return value


def _processing(camera: _Row) -> tuple[str, ...] | None:
    """Names; None also for a series that is older than them."""
    names = camera.fields.get("processing")
    if names is None:
        return None
    if not isinstance(names, list) or not all(
        isinstance(name, str) and _NAME.fullmatch(name) for name in names
    ):
        raise SeriesError(
            f"{camera.where}: 'processing' makes no sense ({names!r:.40}): record the series again"
        )
    return tuple(names)


def _frame(folder: Path, row: _Row) -> Frame:
    stated, gain = row.take("exposure_us", float), row.take("gain", float)
    name = row.take("file", str)
    if Path(name).name != name or "\0" in name:
        raise SeriesError(f"{row.where}: file {name!r:.40}: must be a name in the series' folder")
    return Frame(
        path=folder / name,
        **{field: row.take(field, kind) for field, kind in _AS_WRITTEN.items()},
        stated_us=None if stated is None else stated * (1.0 if gain is None else gain),
    )


# ---------------------------------------------------------------- taking


def shoot(
    source: str,
    folder: Path,
    exposures_us: Sequence[float] = (),
    *,
    frames: int = 12,
    camera: str = "equirect",
    patience_s: float = 15.0,
    progress: Callable[[int], None] = lambda frames: None,
) -> ExposureSeries:
    """Have the daemon take a series into a new folder, and read its index.

    Commands each exposure in turn and takes so many frames after each; without exposures takes the
    frames as they come (0: until the source ends). Gives up when no frame comes for `patience_s`.
    """
    log = folder.with_name(folder.name + ".log")
    arguments = [
        f"--source={source}", f"--camera={camera}", f"--series={folder}",
        f"--series-frames={frames}",
    ]  # fmt: skip
    if exposures_us:
        arguments.append(f"--series-us={','.join(f'{value:.9g}' for value in exposures_us)}")
    with open(log, "wb") as out:
        process = subprocess.Popen(
            [daemon.find(), *arguments], stdin=subprocess.DEVNULL, stdout=out, stderr=out,
            start_new_session=True,
        )  # fmt: skip
    try:
        _watch(process, folder / INDEX, patience_s, progress)
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
    words = daemon.last_words(log)
    log.unlink()
    if process.returncode == 0:
        return load(folder)
    if process.returncode == daemon.USAGE:
        raise UsageError(f"series: {source}:\n{words}")
    silent = "" if words else f"no frame for {patience_s:g} s: does the source send anything?"
    raise SeriesError(f"series: {source}: not complete: {silent}{words}")


def _watch(
    process: subprocess.Popen[bytes],
    index: Path,
    patience_s: float,
    progress: Callable[[int], None],
) -> None:
    """Wait for the end, or until nothing has been written for too long."""
    size, since = -1, time.monotonic()
    while process.poll() is None:
        now = index.stat().st_size if index.exists() else 0
        if now != size:
            size, since = now, time.monotonic()
            progress(index.read_bytes().count(b"\n") - 1 if now else 0)
        if time.monotonic() - since > patience_s:
            return
        time.sleep(_POLL_S)
