"""Orientations, and perhaps places, from files: of a head (an app's poses), or of a probe.

JSON lines, one object for each pose, as `lightprobe simulate --headset` writes them:

    {"time_ns": 1700000000123456789, "rotation_xyzw": [0, 0.38268343, 0, 0.92387953]}

or CSV with a header line: `time_ns,x,y,z,w`. Instead of `time_ns` there may be `time_s`. Where the
head is may be there, too, in metres in the same world: `"position_m": [x, y, z]`, or the columns
`x_m,y_m,z_m`. More keys and columns are left alone. Times are of any one clock; rotations turn the
frame of the head (+X right, +Y up, −Z forward) to any fixed frame of the world, right-handed.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lightprobe.align.track import AlignError, Track, make

_NEXT_STEP = 'expected {"time_ns": …, "rotation_xyzw": [x, y, z, w]} (or time_s)'
_NO_PLACE = [float("nan")] * 3


class Sample(NamedTuple):
    """One pose."""

    time_ns: int
    rotation_xyzw: list[float]
    position_m: list[float] | None = None  # metres in the world; None: not told


def read(path: Path) -> Track:
    """Read a file, by its name's ending; raises :class:`AlignError` that names file and line."""
    try:
        with open(path, encoding="utf-8", newline="") as file:
            if path.suffix.lower() == ".csv":
                samples = list(_csv_samples(str(path), file))
            else:
                samples = list(samples_of_lines(str(path), file))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is no text"
        raise AlignError(f"align: {path}: read: {reason}: name a file of poses") from None
    return track(str(path), samples)


def track(name: str, samples: list[Sample]) -> Track:
    """Make a track of samples."""
    places = None
    if any(one.position_m is not None for one in samples):
        places = np.array([one.position_m or _NO_PLACE for one in samples])
    times, rotations = [one.time_ns for one in samples], [one.rotation_xyzw for one in samples]
    return make(name, times, rotations, places)


def samples_of_lines(name: str, lines: Iterable[str]) -> Iterator[Sample]:
    """Samples of JSON lines, one by one; empty lines are left out."""
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            value = json.loads(line)
            place = value.get("position_m")
            yield Sample(
                _time_ns(value), _numbers(value["rotation_xyzw"], 4),
                None if place is None else _numbers(place, 3),
            )  # fmt: skip
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
            raise AlignError(
                f"align: {name}: line {number}: not understood: {_NEXT_STEP}"
            ) from None


def _csv_samples(name: str, file: Iterable[str]) -> Iterator[Sample]:
    rows = csv.DictReader(file, skipinitialspace=True)
    for row in rows:
        try:
            place = [row.get(key) for key in ("x_m", "y_m", "z_m")]
            yield Sample(
                _time_ns(row), _numbers([row[key] for key in "xyzw"], 4),
                _numbers(place, 3) if all(place) else None,
            )  # fmt: skip
        except (ValueError, KeyError, TypeError, OverflowError):
            raise AlignError(
                f"align: {name}: line {rows.line_num}: not understood: expected a header line "
                "time_ns,x,y,z,w (or time_s), and numbers below it"
            ) from None


def _time_ns(value: Mapping[str, Any]) -> int:
    """Nanoseconds, exactly: a double does not hold those of Unix time."""
    if "time_ns" in value:
        return int(value["time_ns"])
    return round(float(value["time_s"]) * 1e9)


def _numbers(values: Any, count: int) -> list[float]:
    numbers = [float(value) for value in values]
    if len(numbers) != count:
        raise ValueError(values)
    return numbers
