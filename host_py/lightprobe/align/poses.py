"""Orientations from files: of a head (an app's poses), or of a probe.

JSON lines, one object for each pose, as `lightprobe simulate --headset` writes them:

    {"time_ns": 1700000000123456789, "rotation_xyzw": [0, 0.38268343, 0, 0.92387953]}

or CSV with a header line: `time_ns,x,y,z,w`. Instead of `time_ns` there may be `time_s`. More keys
and columns are left alone. Times are of any one clock; rotations turn the frame of the head (+X
right, +Y up, −Z forward) to any fixed frame of the world, right-handed.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from lightprobe.align.track import AlignError, Track, make

_NEXT_STEP = 'expected {"time_ns": …, "rotation_xyzw": [x, y, z, w]} (or time_s)'
Sample = tuple[int, list[float]]  # time in nanoseconds, quaternion x, y, z, w


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
    return make(name, [t for t, _ in samples], [q for _, q in samples])


def samples_of_lines(name: str, lines: Iterable[str]) -> Iterator[Sample]:
    """Samples of JSON lines, one by one; empty lines are left out."""
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            value = json.loads(line)
            yield _time_ns(value), _quaternion(value["rotation_xyzw"])
        except (ValueError, KeyError, TypeError, OverflowError):
            raise AlignError(
                f"align: {name}: line {number}: not understood: {_NEXT_STEP}"
            ) from None


def _csv_samples(name: str, file: Iterable[str]) -> Iterator[Sample]:
    rows = csv.DictReader(file, skipinitialspace=True)
    for row in rows:
        try:
            yield _time_ns(row), _quaternion([row[key] for key in "xyzw"])
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


def _quaternion(values: Any) -> list[float]:
    numbers = [float(value) for value in values]
    if len(numbers) != 4:
        raise ValueError(values)
    return numbers
