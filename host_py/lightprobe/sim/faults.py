"""How the simulated camera misbehaves when asked to, as real ones do unasked."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, fields, replace
from typing import ClassVar, Self
from urllib.parse import parse_qsl, urlencode

import numpy as np

from lightprobe.errors import UsageError


@dataclass(frozen=True)
class PictureFaults:
    """What goes wrong with the pictures of every simulated camera."""

    #: What the numbers may be; 0 or more where nothing else is said.
    RANGES: ClassVar[dict[str, tuple[float, float]]] = {
        **dict.fromkeys(("drop", "corrupt", "truncate", "garbage"), (0, 1)),
        "ignore_exposure": (0, 1),
        "delay_frames": (-1, 100),
    }

    late_ms: float = 0.0  # every frame arrives this late
    jitter_ms: float = 0.0  # and up to this much later still
    drop: float = 0.0  # share of frames lost before the link
    corrupt: float = 0.0  # share of frames with some bytes changed
    truncate: float = 0.0  # share of frames cut short
    garbage: float = 0.0  # share of frames replaced by random bytes
    stall_after: int = 0  # frames until the camera falls silent; 0: never
    stall_s: float = 0.0  # how long it stays silent; 0: for ever
    disconnect_after: int = 0  # frames until it is unplugged, each time; 0: never
    ignore_exposure: int = 0  # 1: exposure commands have no effect
    delay_frames: int = -1  # frames from exposure command to effect; -1: as the camera is

    def merged(self, query: str) -> Self:
        """Give these faults with those of a query string put in; UsageError for an unknown one."""
        known = {field.name: field for field in fields(self)}
        changes = {}
        for key, text in parse_qsl(query, keep_blank_values=True):
            if key not in known:
                raise UsageError(f"faults: unknown option {key}: known are {', '.join(known)}")
            whole = known[key].type == "int"
            low, high = self.RANGES.get(key, (0, math.inf))
            try:
                value = int(text) if whole else float(text)
            except ValueError:
                value = math.nan
            if not (low <= value <= high and math.isfinite(value)):
                kind = "a whole number" if whole else "a number"
                limits = f"{low}…{high}" if math.isfinite(high) else f"{low} or more"
                raise UsageError(f"faults: {key}={text}: expected {kind}, {limits}")
            changes[key] = value
        return replace(self, **changes)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Faults(PictureFaults):
    """Options of `simulate --faults` and of the daemon's `hello` (sim:PATH?KEY=VALUE&…)."""

    RANGES: ClassVar[dict[str, tuple[float, float]]] = {
        **PictureFaults.RANGES,
        **dict.fromkeys(
            (
                "marked",
                "wrong_size",
                "hide_exposure",
                "auto_exposure",
                "hide_orientation",
                "orientation_drop",
            ),
            (0, 1),
        ),
        "breathe_stops": (0, 10),
        "breathe_s": (0.1, math.inf),
        "orientation_late_ms": (-1000, 1000),
        "clock_ahead_ms": (-1e12, 1e12),
        "clock_drift_ppm": (-1e6, 1e6),
    }

    marked: float = 0.0  # share of frames that the driver itself marks corrupt
    wrong_size: float = 0.0  # share of frames whose header tells half the size
    cut_after: int = 0  # frames until it is unplugged in the middle of one; 0: never
    hide_exposure: int = 0  # 1: frames do not report their exposure
    #: 1: the camera exposes by itself (sim/auto_exposure.py) and says that it takes no commands;
    #: with ignore_exposure it says that it takes them.
    auto_exposure: int = 0
    breathe_stops: float = 0.0  # its exposure swings by so much to each side besides
    breathe_s: float = 2.0  # so long for each swing
    hide_orientation: int = 0  # 1: frames do not report their orientation
    orientation_noise_deg: float = 0.0  # about each axis; the sensor states it as its sigma
    orientation_late_ms: float = 0.0  # it is that of so long before; below 0: of later
    orientation_drop: float = 0.0  # share of frames without
    orientation_jump_s: float = 0.0  # so often the sensor's idea of the world jumps; 0: never
    orientation_jump_deg: float = 0.0  # by so much, about an axis drawn each time
    clock_stop_s: float = 0.0  # after so long the time stamps stand still; 0: never
    clock_ahead_ms: float = 0.0  # they are ahead by so much; below 0: behind
    clock_step_s: float = 0.0  # they become so after so long
    clock_drift_ppm: float = 0.0  # and the clock runs faster by so much

    def stamp_ns(self, t_ns: int, start_ns: int) -> int:
        """Give what the camera's clock makes of a time; the simulation began at `start_ns`."""
        since_ns = t_ns - start_ns
        if self.clock_stop_s:
            since_ns = min(since_ns, round(1e9 * self.clock_stop_s))
        ahead_ns = round(1e-6 * self.clock_drift_ppm * since_ns)
        if since_ns >= 1e9 * self.clock_step_s:
            ahead_ns += round(1e6 * self.clock_ahead_ms)
        return start_ns + since_ns + ahead_ns


def split(query: str, box: Collection[str]) -> tuple[str, dict[str, float]]:
    """Part a query string into the camera's faults, still as one, and numbers of the box.

    `box`: names that the box knows. UsageError for one that neither knows, or for no number.
    """
    camera, numbers = [], {}
    known = [field.name for field in fields(Faults)]
    for key, text in parse_qsl(query, keep_blank_values=True):
        if key in known:
            camera.append((key, text))
            continue
        if key not in box:
            more = f"; of the box {', '.join(sorted(box))}" if box else ""
            raise UsageError(f"faults: unknown option {key}: known are {', '.join(known)}{more}")
        try:
            numbers[key] = float(text)
        except ValueError:
            numbers[key] = math.nan
        if not math.isfinite(numbers[key]):
            raise UsageError(f"faults: {key}={text}: expected a number")
    return urlencode(camera), numbers


def describe(kind: type[PictureFaults] = Faults) -> str:
    """Names of all faults of a kind of camera, for --help."""
    return ", ".join(field.name for field in fields(kind))


def spoil(payload: bytes, faults: PictureFaults, rng: np.random.Generator) -> bytes:
    """Break a picture as faults ask for."""
    if rng.random() < faults.garbage:
        return rng.bytes(len(payload))
    if rng.random() < faults.truncate:
        return payload[: int(len(payload) * rng.uniform(0.05, 0.95))]
    if rng.random() < faults.corrupt:
        data = np.frombuffer(payload, np.uint8).copy()
        where = rng.integers(0, len(data), max(1, len(data) // 2000))
        data[where] ^= rng.integers(1, 256, len(where), dtype=np.uint8)
        return data.tobytes()
    return payload
