"""How the simulated camera misbehaves when asked to, as real ones do unasked."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Self, TypeVar, cast
from urllib.parse import parse_qsl, urlencode

import numpy as np

from lightprobe.errors import UsageError

Number = TypeVar("Number", int, float)


def fault(healthy: Number, means: str, low: float = 0, high: float = math.inf) -> Number:
    """Declare a fault: what a healthy camera has, what it does, and what it may be."""
    return field(default=healthy, metadata={"means": means, "range": (low, high)})


class Knobs:
    """Numbers by name (:func:`fault`), as a query string gives them."""

    _what: ClassVar[str] = "faults"  # that errors speak of

    def merged(self, query: str) -> Self:
        """Give these with those of a query string put in; UsageError for an unknown one."""
        known = {one.name: one for one in fields(cast(Any, self))}
        changes = {}
        for key, text in parse_qsl(query, keep_blank_values=True):
            if key not in known:
                raise UsageError(
                    f"{self._what}: unknown option {key}: known are {', '.join(known)}"
                )
            whole = known[key].type == "int"
            low, high = known[key].metadata["range"]
            try:
                value = int(text) if whole else float(text)
            except ValueError:
                value = math.nan
            if not (low <= value <= high and math.isfinite(value)):
                kind = "a whole number" if whole else "a number"
                raise UsageError(
                    f"{self._what}: {key}={text}: expected {kind}, {limits(low, high)}"
                )
            changes[key] = value
        return cast(Self, replace(cast(Any, self), **changes))


class Spell(Knobs):
    """Knobs that hold from `from_s` to `to_s` of the world's time; to 0: for ever."""

    from_s: float
    to_s: float

    def is_on(self, t_s: float) -> bool:
        """Tell whether they hold at a time of the world."""
        return t_s >= self.from_s and not 0 < self.to_s <= t_s


@dataclass(frozen=True)
class PictureFaults(Knobs):
    """What goes wrong with the pictures of every simulated camera."""

    late_ms: float = fault(0.0, "every frame arrives this late")
    jitter_ms: float = fault(0.0, "and up to this later still")
    drop: float = fault(0.0, "share of frames lost before the link", 0, 1)
    corrupt: float = fault(0.0, "share of frames with some bytes changed", 0, 1)
    truncate: float = fault(0.0, "share of frames cut short", 0, 1)
    garbage: float = fault(0.0, "share of frames replaced by random bytes", 0, 1)
    stall_after: int = fault(0, "frames until the camera falls silent; 0: never")
    stall_s: float = fault(0.0, "how long it stays silent; 0: for ever")
    disconnect_after: int = fault(0, "frames until it is unplugged, each time; 0: never")
    ignore_exposure: int = fault(0, "1: exposure commands have no effect", 0, 1)
    delay_frames: int = fault(
        -1, "frames from exposure command to effect; -1: as the camera is", -1, 100
    )


@dataclass(frozen=True)
class Faults(PictureFaults):
    """Options of `simulate --faults` and of the daemon's `hello` (sim:PATH?KEY=VALUE&…)."""

    marked: float = fault(0.0, "share of frames that the driver itself marks corrupt", 0, 1)
    wrong_size: float = fault(0.0, "share of frames whose header tells half the size", 0, 1)
    cut_after: int = fault(0, "frames until it is unplugged in the middle of one; 0: never")
    hide_exposure: int = fault(0, "1: frames do not report their exposure", 0, 1)
    auto_exposure: int = fault(
        0, "1: it exposes by itself, and takes commands only with ignore_exposure", 0, 1
    )
    breathe_stops: float = fault(
        0.0, "automatic exposure swings by so many stops to each side", 0, 10
    )
    breathe_s: float = fault(2.0, "seconds of each swing", 0.1)
    hide_orientation: int = fault(0, "1: frames do not report their orientation", 0, 1)
    orientation_noise_deg: float = fault(
        0.0, "noise about each axis, 1 sigma, as the sensor states it"
    )
    place_noise_m: float = fault(
        0.0, "noise along each axis, 1 sigma, of where a camera that goes says it is"
    )
    orientation_late_ms: float = fault(
        0.0, "the orientation is that of so long before; below 0: after", -1000, 1000
    )
    orientation_drop: float = fault(0.0, "share of frames without an orientation", 0, 1)
    orientation_jump_s: float = fault(
        0.0, "seconds until the sensor's idea of the world jumps, each time; 0: never"
    )
    orientation_jump_deg: float = fault(0.0, "by this angle, about an axis drawn each time")
    clock_stop_s: float = fault(0.0, "seconds until the time stamps stand still; 0: never")
    clock_ahead_ms: float = fault(
        0.0, "time stamps are ahead by this; below 0: behind", -1e12, 1e12
    )
    clock_step_s: float = fault(0.0, "seconds until they become so")
    clock_drift_ppm: float = fault(0.0, "the camera's clock runs faster by this", -1e6, 1e6)

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
    known = [one.name for one in fields(Faults)]
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


#: Numbers of the box that are faults; firmware/board/host/world.h has all of its numbers.
BOX = {
    "stuck": (0, "1: the servo does not turn"),
    "slow": (1, "factor on its speed"),
    "slip_deg": (0, "the angle by which the wheel has slipped in total"),
    "lie_deg": (0, "the sensors of the comb see the wheel ahead by this angle"),
    "index_a_forced": (-1, "0: sensor A of the comb is never on a tooth; 1: always"),
    "index_b_forced": (-1, "0: sensor B of the comb is never on a tooth; 1: always"),
    "index_glitches": (0, "number of false changes of sensor A that still come"),
    "feedback_forced": (-1, "the servo's feedback, as a share of the supply"),
    "supply_mv": (4700, "the supply, in millivolts"),
    **{
        f"ldr{k}_forced": (
            -1,
            f"sensor {k} of the ring, as a share of the supply: 0 open, 1 shorted",
        )
        for k in range(9)
    },
    **{
        f"ldr{k}_noise": (0, f"noise of sensor {k} of the ring, as a share of the supply")
        for k in range(9)
    },
    "select_stuck": (0, "1 to 4: select line S0 to S3 of the multiplexer stays low"),
    "line_noise": (0, "share of the serial line's bytes that are changed"),
    "line_cut": (0, "1: no byte passes"),
    "line_unplugged": (0, "1: the serial device is not there"),
    "reset": (0, "any value: the microcontroller starts again"),
}


def limits(low: float, high: float) -> str:
    """Give a range in words."""
    return f"{low:g}…{high:g}" if math.isfinite(high) else f"{low:g} or more"


def rows(kind: type[Knobs] = Faults) -> Iterator[tuple[str, str, str]]:
    """Each fault of a kind of camera: healthy value, what it may be, what it does."""
    for one in fields(cast(Any, kind)):
        yield f"{one.name}={one.default:g}", limits(*one.metadata["range"]), one.metadata["means"]


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
