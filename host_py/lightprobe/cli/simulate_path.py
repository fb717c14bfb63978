"""`lightprobe simulate --path`: how the camera moved is in a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer

from lightprobe.errors import UsageError
from lightprobe.sim import track_file
from lightprobe.sim.motion import Track
from lightprobe.sim.room import Room
from lightprobe.sim.scene import Scene


def read(path: Path | None, scenes: Sequence[Scene], has_ring: bool) -> Track | None:
    """Read it; UsageError. Says where nobody leaves their place, for a path that does."""
    if path is None:
        return None
    track = track_file.read(path)
    if not track.moves:
        return track
    if has_ring and any(isinstance(scene, Room) for scene in scenes):
        raise UsageError(
            "simulate: --path: the ring of --firmware cannot walk: leave one of the two out, or "
            "all places in the file the same"
        )
    far = [scene.name for scene in scenes if not isinstance(scene, Room)]
    if far:
        typer.echo(
            f"simulate: --path {path}: all that {far[0]} shows is far away: there the camera "
            "turns, and stays where it is",
            err=True,
        )
    return track
