"""`lightprobe align poses`: the mount by how head and probe turn together, and see lamps."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from lightprobe import recording
from lightprobe.align import hand_eye, lever, poses
from lightprobe.align.lever import Sightings
from lightprobe.align.mount import Mount
from lightprobe.align.poses import Sample
from lightprobe.align.track import AlignError, Track
from lightprobe.cli import align, check
from lightprobe.client import DEFAULT_URI, Client
from lightprobe.errors import UsageError
from lightprobe.estimate import Estimate, EstimateFlag, LightFlag
from lightprobe.wire import Subscription, decode

_FILES = (".mcap", ".jsonl", ".csv")
_PATIENCE_S = 10.0
_NOT_TOLD = EstimateFlag.MOTION | EstimateFlag.STALE
_NO_ORIENTATION = (
    "the probe does not tell how it is turned: start lightprobed with --orientation=visual, and "
    "let the camera stream"
)


def command(
    head: Annotated[
        str, typer.Argument(metavar="HEAD", help="Poses of the head: a file, or - for stdin.")
    ],
    probe: Annotated[
        str,
        typer.Argument(
            metavar="[PROBE]",
            help="Address of the probe, with HEAD from stdin; or a recording of the same time.",
        ),
    ] = DEFAULT_URI,
    seconds: Annotated[
        float,
        typer.Option(
            callback=check.number(hand_eye.LEAST_S, 600, "seconds"),
            help="Live: look around for so long.",
        ),
    ] = 20.0,
    output: align.Output = None,
    as_json: align.AsJson = False,
) -> None:
    """Find the mount while you look around: left and right, and up and down.

    The head's poses are JSON lines {"time_ns": 1700000000123456789, "rotation_xyzw": [x, y, z, w]}
    or CSV (time_ns,x,y,z,w): head to world, right-handed, by any clock. Live, an app writes them to
    this command's stdin; or record both for 20 seconds and give two files (lightprobe record,
    docs/users/mounting.md). The probe's orientation must be its own: --orientation=visual.
    With "position_m": [x, y, z] (CSV: x_m,y_m,z_m), metres in that world, it also finds where the
    probe is on the head (offset_m): with lamps on, go to and fro while you look around.
    Example: my_app | lightprobe align poses - --output mount.ini
    """
    by_file = Path(probe).suffix.lower() in _FILES
    if head != "-" and not by_file:
        raise UsageError(
            f"align: poses: {head} and {probe}: poses in a file need the probe's orientation of "
            "the same time: record it (lightprobe record room.mcap), or write poses to stdin (-)"
        )
    if by_file:
        poses_of_head = head_track(head)
        poses_of_probe, seen = probe_track(Path(probe))
    else:
        poses_of_head, poses_of_probe, seen = live(probe, seconds)
    found = hand_eye.solve(poses_of_head, poses_of_probe)
    remark = (
        f"{found.turns} turns, {100 * found.agreeing:.0f} % agree within {found.residual_deg:.2f}° "
        f"(RMS); the head's clock shows {found.time_offset_s:+.4f} s (± "
        f"{1000 * found.time_offset_sigma_s:.1f} ms)"
    )
    result, how = found.to_json(), Mount(found.rotation, found.sigma_deg)
    arm = lever.solve(poses_of_head, seen, found.rotation, found.time_offset_s)
    if isinstance(arm, str):
        typer.echo(f"note: offset_m left out: {arm}", err=True)
    else:
        how = Mount(arm.rotation, arm.rotation_sigma_deg, arm.offset_m, arm.sigma_m)
        result |= arm.to_json()
        remark += f"; directions of {arm.lamps} lamps agree within {arm.residual_deg:.2f}° (RMS)"
    align.finish(how, result, remark, output, as_json)


def head_track(head: str) -> Track:
    """Poses of a file, or of stdin to its end."""
    if head == "-":
        return poses.track("stdin", list(poses.samples_of_lines("stdin", sys.stdin)))
    return poses.read(Path(head))


def probe_track(path: Path) -> tuple[Track, Sightings]:
    """Orientations of a probe in a file, and the lamps in it."""
    if path.suffix.lower() != ".mcap":
        return poses.read(path), Sightings.of([])
    notes: list[str] = []
    try:
        messages = (decode(one.message.SerializeToString()) for one in recording.read(path, notes))
        estimates = [one for one in messages if isinstance(one, Estimate)]
    except OSError as error:
        raise AlignError(f"align: {path}: read: {error.strerror}: name a recording") from None
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    samples = samples_of(estimates)
    if not samples:
        raise AlignError(f"align: {path}: {_NO_ORIENTATION}, while you record")
    return poses.track(str(path), samples), sightings_of(estimates)


def samples_of(estimates: Iterable[Estimate]) -> list[Sample]:
    """Orientations that are known, without those that are repeated or the frames did not tell."""
    return [
        Sample(one.capture_time_unix_ns, one.orientation.tolist())
        for one in estimates
        if one.orientation is not None and not one.flags & _NOT_TOLD
    ]


def sightings_of(estimates: Iterable[Estimate]) -> Sightings:
    """Directions of lamps in the probe's frame; area lights have no place."""
    return Sightings.of(
        (one.capture_time_unix_ns, light.id, light.direction, light.direction_sigma_deg)
        for one in estimates
        if one.frame == "PROBE" and not one.flags & _NOT_TOLD
        for light in one.lights
        if LightFlag.EXTENDED not in light.flags
    )


def live(uri: str, seconds: float) -> tuple[Track, Track, Sightings]:
    """Take poses from stdin and estimates from a probe for some time, or to the end of stdin."""
    reader = _Reader()
    reader.start()
    estimates: list[Estimate] = []
    columns = TextColumn("look around"), BarColumn(), TextColumn("{task.description}")
    with (
        Client(uri, Subscription(smoothing="RAW", sh_order=0, max_lights=8)) as probe,
        Progress(
            *columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True
        ) as bar,
        suppress(KeyboardInterrupt),
    ):
        estimates.append(probe.receive(_PATIENCE_S))
        begin_s = time.monotonic()
        task = bar.add_task("", total=seconds)
        while (passed_s := time.monotonic() - begin_s) < seconds and not reader.ended.is_set():
            estimates.append(probe.receive(_PATIENCE_S))
            text = f"{len(reader.samples)} poses, {len(estimates)} estimates"
            bar.update(task, completed=passed_s, description=text)
    if reader.error is not None:
        raise reader.error
    orientations = samples_of(estimates)
    if not orientations:
        raise AlignError(f"align: {uri}: {_NO_ORIENTATION}")
    own = poses.track(uri, orientations)
    return poses.track("stdin", list(reader.samples)), own, sightings_of(estimates)


def _lines(descriptor: int) -> Iterator[str]:
    """Lines without a lock: the program ends while a thread waits for one."""
    rest = b""
    while data := os.read(descriptor, 1 << 16):
        *whole, rest = (rest + data).split(b"\n")
        yield from (line.decode(errors="replace") for line in whole)
    yield rest.decode(errors="replace")


class _Reader(threading.Thread):
    """Reads poses from stdin; a thread of its own, as nothing else can wait for both."""

    def __init__(self) -> None:
        super().__init__(name="poses", daemon=True)
        self.samples: list[Sample] = []
        self.ended = threading.Event()
        self.error: AlignError | None = None

    def run(self) -> None:
        try:
            for sample in poses.samples_of_lines("stdin", _lines(sys.stdin.fileno())):
                self.samples.append(sample)
        except AlignError as error:
            self.error = error
        finally:
            self.ended.set()
