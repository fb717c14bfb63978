"""A recording, frame by frame, as a live client would have shown it. No bpy here."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from lightprobe import recording
from lightprobe.errors import LightprobeError
from lightprobe.estimate import Estimate
from lightprobe.geometry import Array
from lightprobe.wire import WireError, decode

from .fade import Fader, ShownLamp
from .suns import suns, there

#: A recording longer than this many frames is refused: it would take hours and gigabytes.
MOST_FRAMES = 20_000


@dataclass(frozen=True, eq=False)
class TimedEstimate:
    """A packet and when it came."""

    time_s: float  # since the first one
    estimate: Estimate


@dataclass(frozen=True, eq=False)
class FrameLight:
    """What one frame of the timeline shows."""

    frame: int
    lamps: list[ShownLamp]
    world_gain: float
    estimate: Estimate  # the newest that had come, however old


def read(path: Path) -> tuple[list[TimedEstimate], list[str]]:
    """Estimates of a recording, and notes on what is cut off or left out.

    Raises :class:`LightprobeError` for a file that cannot be read or holds no estimate.
    """
    notes: list[str] = []
    found: list[TimedEstimate] = []
    first_ns: int | None = None
    try:
        for one in recording.read(path, notes):
            if one.message.WhichOneof("message") != "estimate":
                continue
            first_ns = one.time_ns if first_ns is None else first_ns
            estimate = decode(one.message.SerializeToString())
            assert isinstance(estimate, Estimate)
            found.append(TimedEstimate((one.time_ns - first_ns) / 1e9, estimate))
    except OSError as error:
        raise LightprobeError(f"{path}: read: {error.strerror}: is the path right?") from None
    except WireError as error:
        raise LightprobeError(
            f"{path}: read: packet {len(found) + 1}: {error}: record it again"
        ) from None
    if not found:
        reason = f" ({'; '.join(notes)})" if notes else ""
        raise LightprobeError(
            f"{path}: read: holds no estimate{reason}: record one with `lightprobe record`"
        )
    return found, notes


def frames(
    packets: list[TimedEstimate],
    start: int,
    frames_per_s: float,
    steady: bool,
    position_m: Array | None = None,
) -> Iterator[FrameLight]:
    """Give the frames from `start` to the end of the recording, at least one.

    `position_m`: the place whose light it is; see :func:`.suns.there`.

    Each shows the newest packet that had come by then. After its time to live without another
    one, everything fades out. The first frame is at full strength: the light had been there.
    """
    count = 1 + int(packets[-1].time_s * frames_per_s + 1e-6)
    if count > MOST_FRAMES:
        raise LightprobeError(
            f"keyframe: the recording lasts {count} frames, more than {MOST_FRAMES}: record a "
            "shorter one (lightprobe record --seconds)"
        )
    fader, newest = Fader(), 0
    shown, light = packets[0], there(packets[0].estimate, steady, position_m)
    for index in range(count):
        now_s = index / frames_per_s + 1e-9
        while newest + 1 < len(packets) and packets[newest + 1].time_s <= now_s:
            newest += 1
        packet = packets[newest]
        fresh = 1000 * (now_s - packet.time_s) <= (packet.estimate.ttl_ms or float("inf"))
        boot_id = packet.estimate.boot_id if fresh else None
        elapsed_s = 1 / frames_per_s if index else float("inf")
        if packet is not shown:
            shown, light = packet, there(packet.estimate, steady, position_m)
        fader.step(elapsed_s, boot_id, suns(light, steady))
        yield FrameLight(start + index, fader.lamps, fader.world_gain, light)
