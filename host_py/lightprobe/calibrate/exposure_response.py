"""Does a camera follow exposure commands, and how many frames later?

A step of the schedule turns the picture of the old exposure into that of the new one; where on the
way between them a frame lies tells which it had, whatever the response. The delay is counted as
the driver counts (docs/users/cameras.md): frames read after the command and before the first that
obeys.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lightprobe.calibrate.exposure_series import Frame
from lightprobe.calibrate.flat_patches import STEADY_FRAMES, blocks
from lightprobe.errors import LightprobeError
from lightprobe.geometry import Array

#: Codes that a picture must change by, on the mean, for the change to count as seen.
_LEAST_CHANGE_CODES = 2.0
#: And by so many times what two pictures of one exposure differ.
_ABOVE_UNREST = 4.0
#: A step whose last frames differ by more than this had not come to rest: nothing is said on it.
_MOST_UNREST_CODES = 6.0
#: Cells between these codes must change with the exposure; so much of the picture must be there.
_SENSITIVE_CODES = (24.0, 230.0)
_LEAST_SENSITIVE = 0.02
#: Between these shares of the way a frame is neither old nor new.
_UNDECIDED = (0.15, 0.85)


class ExposureResponseError(LightprobeError):
    """Nothing can be said about the camera; says why and what to change."""


@dataclass(frozen=True)
class Change:
    """What one command did."""

    from_us: float
    to_us: float
    expected: bool  # the picture had to change
    seen: bool  # it did, the right way
    delay_frames: int | None  # None: not seen, or frames were lost just then
    gradual: bool = False  # it took several frames
    restless: bool = False  # the picture was not at rest before or after: no judgement


@dataclass(frozen=True)
class ExposureResponse:
    """All commands together."""

    changes: tuple[Change, ...]

    @property
    def expected(self) -> int:
        """Number of changes that should have shown."""
        return sum(change.expected for change in self.changes)

    @property
    def obeyed(self) -> int:
        """Number of those that did."""
        return sum(change.expected and change.seen for change in self.changes)

    @property
    def follows(self) -> bool:
        """True when nearly every command had its effect."""
        return self.obeyed >= 3 and self.obeyed >= 0.7 * self.expected

    @property
    def ignores(self) -> bool:
        """True when no command had an effect."""
        return self.expected > 0 and self.obeyed == 0

    def delays(self) -> list[int]:
        """All delays seen, in frames."""
        return [c.delay_frames for c in self.changes if c.delay_frames is not None]

    @property
    def delay_frames(self) -> int | None:
        """Median delay; None when none was seen."""
        return int(np.median(self.delays())) if self.delays() else None

    @property
    def gradual(self) -> bool:
        """True when changes take several frames: an automatic that fades, or a filter in time."""
        seen = [change for change in self.changes if change.seen]
        return len(seen) > 0 and sum(c.gradual for c in seen) > len(seen) / 2


@dataclass(frozen=True, eq=False)
class _Look:
    """A frame by the mean codes of its cells."""

    frame: Frame
    cells: Array


def judge_commands(steps: Sequence[Sequence[Frame]]) -> ExposureResponse:
    """Judge every command of a series; :class:`ExposureResponseError` when none could show."""
    looks = [[look for frame in step if (look := _look(frame)) is not None] for step in steps]
    changes = tuple(_judge(old, new) for old, new in itertools.pairwise(looks) if old and new)
    obedience = ExposureResponse(changes)
    if not obedience.expected and any(change.restless for change in changes):
        raise ExposureResponseError(
            "exposure: the picture keeps changing between commands: keep light and camera still; "
            "for a very slow camera add --frames 24"
        )
    if not obedience.expected:
        mean = np.mean([look.cells.mean() for step in looks for look in step] or [np.nan])
        kind = "dark" if mean < 128 else "bright"
        step = "more light" if kind == "dark" else "less light"
        raise ExposureResponseError(
            f"exposure: the picture is too {kind} (mean code {mean:.0f} over all exposures), or "
            f"shows nothing: try {step}, or put something in view"
        )
    return obedience


def _look(frame: Frame) -> _Look | None:
    codes = frame.codes()
    return None if codes is None else _Look(frame, blocks(codes).mean(axis=(2, 3)))


def _steady(looks: Sequence[_Look]) -> tuple[Array, float]:
    """Mean picture at a step's end, and how much its frames differ, in codes."""
    last = np.stack([look.cells for look in looks[-STEADY_FRAMES:]])
    unrest = np.abs(np.diff(last, axis=0)).mean() if len(last) > 1 else 0.0
    return last.mean(axis=0), float(unrest)


def _judge(old: Sequence[_Look], new: Sequence[_Look]) -> Change:
    before, unrest_before = _steady(old)
    after, unrest_after = _steady(new)
    from_us = old[-1].frame.commanded_us or np.nan
    to_us = new[-1].frame.commanded_us or np.nan
    way = after - before
    if max(unrest_before, unrest_after) > _MOST_UNREST_CODES:
        return Change(from_us, to_us, False, False, None, restless=True)
    least = max(_LEAST_CHANGE_CODES, _ABOVE_UNREST * max(unrest_before, unrest_after))
    seen = float(np.abs(way).mean()) > least and bool(way.mean() > 0) == (to_us > from_us)
    inside = (before > _SENSITIVE_CODES[0]) & (before < _SENSITIVE_CODES[1])
    expected = seen or bool(np.mean(inside) > _LEAST_SENSITIVE)
    if not seen:
        return Change(from_us, to_us, expected, False, None)
    share = [float(np.sum((look.cells - before) * way) / np.sum(way**2)) for look in new]
    arrived = next(i for i, part in enumerate(share) if part > 0.5)
    undecided = sum(_UNDECIDED[0] < part < _UNDECIDED[1] for part in share)
    return Change(from_us, to_us, expected, True, _delay(old, new, arrived), undecided > 1)


def _delay(old: Sequence[_Look], new: Sequence[_Look], arrived: int) -> int | None:
    """Frames read after the command and before new[arrived]; None when some are missing."""
    frames = [look.frame for look in new]
    last_old = frames[arrived - 1] if arrived else old[-1].frame
    if frames[arrived].sequence - last_old.sequence != 1:
        return None
    first = next((f for f in frames if f.t_read_ns > f.t_command_ns), None)
    if first is None:
        return None
    return max(0, frames[arrived].sequence - first.sequence)
