"""Files of recorded motion, in the two forms that data sets of visual-inertial odometry use.

TUM: `t x y z qx qy qz qw`, seconds, with spaces between. EuRoC: `t, x, y, z, qw, qx, qy, qz, …`,
nanoseconds, with commas between; what follows is left. Lines that begin with # are comments.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from lightprobe.errors import UsageError
from lightprobe.sim.motion import Track

#: By which a rotation's length may differ from 1: data sets write four digits and more.
_LENGTH_TOLERANCE = 0.01


@dataclass(frozen=True)
class _Form:
    words: str  # what a line is to be
    separator: str | None  # None: white space
    seconds: Decimal  # of the unit of time
    wxyz: tuple[int, int, int, int]  # columns
    has_more: bool  # columns that are left


_TUM = _Form("t x y z qx qy qz qw, as TUM's files have it", None, Decimal(1), (7, 4, 5, 6), False)
_EUROC = _Form(
    "t, x, y, z, qw, qx, qy, qz, as EuRoC's files have it", ",", Decimal("1e-9"), (4, 5, 6, 7), True
)


def read(path: Path) -> Track:
    """Read a file of either form: the first line tells which. UsageError for what is none.

    Time and place begin at 0 with the first line; rotations are as they stand, camera to scene.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "no text"
        raise UsageError(f"path: {path}: {reason}") from None
    lines = [
        (number, line.strip())
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise UsageError(f"path: {path}: no line with a pose: expected {_TUM.words}, or EuRoC's")
    form = _EUROC if "," in lines[0][1] else _TUM
    keys = [_key(f"path: {path}:{number}", line, form) for number, line in lines]
    start = keys[0][0]
    t_s = np.array([float((stamp - start) * form.seconds) for stamp, _ in keys])
    back = np.flatnonzero(np.diff(t_s) <= 0)
    if len(back):
        raise UsageError(
            f"path: {path}:{lines[back[0] + 1][0]}: not later than the line before: "
            "expected times that rise"
        )
    values = np.array([row for _, row in keys])
    rotations = values[:, np.array(form.wxyz) - 1]
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    return Track(t_s, rotations, values[:, :3] - values[0, :3], str(path))


def _key(where: str, line: str, form: _Form) -> tuple[Decimal, list[float]]:
    """Time in the form's unit, and the numbers after it."""
    words = line.split(form.separator)
    if len(words) < 8 or (len(words) > 8 and not form.has_more):
        raise UsageError(f"{where}: {len(words)} numbers: expected {form.words}")
    try:
        stamp = Decimal(words[0].strip())
        values = [float(word) for word in words[1:8]]
    except (InvalidOperation, ValueError):
        raise UsageError(f"{where}: {line[:80]!r}: expected numbers: {form.words}") from None
    if not (stamp.is_finite() and np.all(np.isfinite(values))):
        raise UsageError(f"{where}: not finite: expected numbers: {form.words}")
    length = float(np.linalg.norm([values[column - 1] for column in form.wxyz]))
    if abs(length - 1) > _LENGTH_TOLERANCE:
        raise UsageError(
            f"{where}: a rotation of length {length:.3g}: expected a unit quaternion: {form.words}"
        )
    return stamp, values
