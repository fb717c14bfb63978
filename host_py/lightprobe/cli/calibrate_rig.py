"""`lightprobe calibrate rig`: how cameras are turned in one box."""

from __future__ import annotations

import contextlib
import json
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from scipy.spatial.transform import Rotation

from lightprobe.align import hand_eye, poses, rig
from lightprobe.align.rig import Found, RigError
from lightprobe.align.track import AlignError, Track
from lightprobe.calibrate import camera_file, rig_overlap
from lightprobe.calibrate.exposure_series import ExposureSeries
from lightprobe.calibrate.flat_patches import exposure_of, steady_frames
from lightprobe.calibrate.rig_overlap import Shot, View
from lightprobe.cli import calibrate, check
from lightprobe.cli.align_poses import samples_of
from lightprobe.client import Client
from lightprobe.daemon import Daemon, last_words
from lightprobe.errors import LightprobeError, ProbeTimeout, UsageError
from lightprobe.estimate import Estimate
from lightprobe.imaging import camera as cameras
from lightprobe.imaging.camera import Camera
from lightprobe.wire import Subscription

#: From sunlight to a dim room; frames at each.
EXPOSURES_US = (100, 400, 1600, 6400, 25600)
_FRAMES = 10
#: Frames of a still box differ by less: mean over the picture, in codes.
_MOST_UNREST_CODES = 2.0


def command(
    source: Annotated[
        list[str], typer.Option(metavar="URI", help="A camera; once for each: v4l2:port:1-1.2, …")
    ],
    camera: Annotated[
        list[Path],
        typer.Option(metavar="FILE", help="Camera file of each source, in the same order."),
    ],
    seconds: Annotated[
        float,
        typer.Option(
            callback=check.number(hand_eye.LEAST_S, 600, "seconds"), help="Turn the box so long."
        ),
    ] = 30.0,
    turning_only: Annotated[
        bool, typer.Option("--turning-only", help="Take no pictures of the overlap.")
    ] = False,
    as_it_comes: Annotated[
        bool,
        typer.Option("--as-it-comes", help="The exposure of these cameras cannot be set."),
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Leave the camera files as they are.")
    ] = False,
    patience_s: calibrate.Patience = 15.0,
    as_json: calibrate.AsJson = False,
) -> None:
    """Find how the cameras of one box are turned against the first one.

    First the box stands still, while each camera takes pictures; then you turn it in your hands,
    left and right and up and down. Nothing may be nearer than two metres beside the box. The result
    is written into the camera files (docs/users/camera_calibration.md). The daemon must not be
    running on these cameras.
    Example: lightprobe calibrate rig --source v4l2:port:1-1.1 --camera ahead.camera
    --source v4l2:port:1-1.2 --camera back.camera
    """
    lenses = _lenses(source, camera)
    names = [str(path) for path in camera]
    console = Console(stderr=True)
    views: list[View] = []
    if not turning_only:
        console.print("hold the box still: pictures are taken")
        exposures = () if as_it_comes else EXPOSURES_US
        for k, (uri, lens) in enumerate(zip(source, lenses, strict=True)):
            with calibrate.series(
                uri, exposures, frames=_FRAMES, camera=names[k], output=None, keep=None,
                patience_s=patience_s,
            ) as series:  # fmt: skip
                views += rig_overlap.views(k, lens, shots_of(names[k], series))
    console.print(f"now turn the box for {seconds:g} s: left and right, up and down, tilted")
    tracks = turning(source, names, seconds, patience_s)
    found = rig.solve(names, tracks, views)
    if as_json:
        typer.echo(json.dumps(to_json(names, found), indent=2))
    else:
        show(names, found)
    if not dry_run:
        turns = [Rotation.identity(), *(one.turned.rotation for one in found)]
        sigmas = [0.0, *(one.turned.sigma_deg for one in found)]
        number = camera_file.save_rig(camera, turns, sigmas)
        typer.echo(f"written: {', '.join(names)}: rig {number}", err=True)


def _lenses(sources: Sequence[str], paths: Sequence[Path]) -> list[Camera]:
    """Camera files, checked before anything is done."""
    if len(sources) < 2 or len(sources) != len(paths):
        raise UsageError(
            f"calibrate: rig: {len(sources)} --source and {len(paths)} --camera: name two cameras "
            "or more, and the file of each in the same order"
        )
    if len({path.resolve() for path in paths}) < len(paths):
        raise UsageError(
            f"calibrate: rig: {', '.join(map(str, paths))}: one file is named twice: each camera "
            "needs its own, even if the lenses are alike (copy it)"
        )
    lenses = [cameras.load(str(path)) for path in paths]
    for path, lens in zip(paths, lenses, strict=True):
        if lens.is_equirect:
            raise UsageError(
                f"calibrate: rig: {path}: [camera] projection = equirect: its picture has no "
                "lens to turn: describe the lens first (lightprobe calibrate lens)"
            )
    return lenses


def shots_of(name: str, series: ExposureSeries) -> list[Shot]:
    """Mean pictures of a series, one for each exposure; raises :class:`RigError`."""
    shots = []
    for frames in series.steps():
        pictures = steady_frames(frames)
        if not pictures:
            continue
        unrest = float(np.abs(pictures[-1].astype(np.int16) - pictures[0]).mean())
        if unrest > _MOST_UNREST_CODES:
            raise RigError(
                f"rig: {name}: pictures: they differ by {unrest:.1f} codes: hold the box still, "
                "in steady light"
            )
        mean = np.rint(np.mean(np.stack(pictures), axis=0)).astype(np.uint8)
        shots.append((exposure_of(series, frames) or 1.0, mean))
    if not shots:
        raise RigError(f"rig: {name}: pictures: none can be read: is another program using it?")
    return shots


@contextlib.contextmanager
def _probes(
    sources: Sequence[str], names: Sequence[str], patience_s: float
) -> Iterator[list[Client]]:
    """A probe with each camera alone, all of which tell how they turn."""
    with tempfile.TemporaryDirectory(prefix="lp-") as name, contextlib.ExitStack() as stack:
        clients = []
        for k, (source, file) in enumerate(zip(sources, names, strict=True)):
            path = Path(name) / str(k)
            arguments = [
                f"--source={source}", f"--camera={file}", "--orientation=visual",
                f"--publish=unix:{path}",
            ]  # fmt: skip
            daemon = stack.enter_context(Daemon(arguments, path.with_suffix(".log")))
            wish = Subscription(sh_order=0, max_lights=0)
            clients.append(stack.enter_context(Client(f"unix:{path}", wish)))
            try:
                clients[-1].receive(patience_s)
            except ProbeTimeout:
                daemon.check()
                words = last_words(path.with_suffix(".log"))
                raise RigError(
                    f"rig: {file}: turning: no estimate from {source} in {patience_s:g} s: {words}"
                ) from None
        yield clients


def turning(
    sources: Sequence[str], names: Sequence[str], seconds: float, patience_s: float
) -> list[Track]:
    """How each camera turned, by its own pictures."""
    estimates: list[list[Estimate]] = [[] for _ in sources]
    errors: list[LightprobeError] = []
    columns = TextColumn("turn the box"), BarColumn(), TimeElapsedColumn()
    with _probes(sources, names, patience_s) as probes:
        ended = threading.Event()

        def listen(probe: Client, heard: list[Estimate]) -> None:
            try:
                while not ended.is_set():
                    heard.append(probe.receive(patience_s))
            except LightprobeError as error:
                errors.append(error)

        threads = [
            threading.Thread(target=listen, args=pair, daemon=True)
            for pair in zip(probes, estimates, strict=True)
        ]
        for thread in threads:
            thread.start()
        begin_s = time.monotonic()
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task("", total=seconds)
            while (passed_s := time.monotonic() - begin_s) < seconds and not errors:
                bar.update(task, completed=passed_s)
                time.sleep(0.1)
        ended.set()
        for thread in threads:
            thread.join()
    if errors:
        raise errors[0]
    return [track_of(name, heard) for name, heard in zip(names, estimates, strict=True)]


def track_of(name: str, heard: Sequence[Estimate]) -> Track:
    """Give the orientations that a camera's pictures told; raises :class:`RigError`."""
    try:
        return poses.track(name, samples_of(heard))
    except AlignError:
        raise RigError(
            f"rig: {name}: turning: its pictures do not tell how it turns: more light, a "
            "furnished room, slower turns"
        ) from None


def to_json(names: Sequence[str], found: Sequence[Found]) -> dict[str, Any]:
    """Plain values."""
    return {
        "first": names[0],
        "cameras": [
            {
                "camera": name,
                "turn_wxyz": np.roll(one.turned.rotation.as_quat(canonical=True), 1).tolist(),
                "changed_deg": one.changed_deg,
                "sigma_deg": one.turned.sigma_deg,
                "turning_sigma_deg": one.by_turning.sigma_deg,
                "overlap_sigma_deg": one.by_overlap and one.by_overlap.sigma_deg,
                "time_offset_s": one.time_offset_s,
            }
            for name, one in zip(names[1:], found, strict=True)
        ],
    }


def show(names: Sequence[str], found: Sequence[Found]) -> None:
    """Print the result."""
    for name, one in zip(names[1:], found, strict=True):
        overlap = one.by_overlap
        parts = f"turning ± {one.by_turning.sigma_deg:.2f}°"
        if overlap is not None:
            parts += f", overlap ± {overlap.sigma_deg:.2f}°"
        typer.echo(
            f"{name}: turned by {one.changed_deg:.2f}° from what its file said, "
            f"± {one.turned.sigma_deg:.2f}° ({parts})"
        )
