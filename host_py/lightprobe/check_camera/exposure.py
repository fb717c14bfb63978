"""Does the camera obey exposure commands, how late, and how exactly?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lightprobe.calibrate.exposure_response import (
    ExposureResponse,
    ExposureResponseError,
    judge_commands,
)
from lightprobe.calibrate.exposure_series import Frame
from lightprobe.check_camera.answers import Answer, Outcome
from lightprobe.check_camera.response import NOTICED_STEP, Power, untold

OBEYS, EXACT = "exposure", "exposure steps"
#: Share of commands that may come at another time: the machine was busy.
_FEW = 0.2
_STEP = "lightprobe calibrate exposure SOURCE shows each command"


def obedience(groups: Sequence[Sequence[Frame]]) -> ExposureResponse | str:
    """What commands did; or why that cannot be told."""
    try:
        return judge_commands(groups)
    except ExposureResponseError as error:
        return str(error).removeprefix("exposure: ")


def not_settable() -> Answer:
    """Say what it means that a camera takes no commands."""
    return Answer(
        OBEYS, Outcome.UNFIT,
        "an exposure that cannot be set (its light is relative, and lamps clip)",
        "exposure = settable in the camera file, unless the camera has automatic exposure only; "
        "then take another camera (docs/users/which_camera.md)",
    )  # fmt: skip


def judge(found: ExposureResponse | str, trouble: str = "", next_step: str = "") -> Answer:
    """Say whether the camera obeys; `trouble`: what makes the light useless, and its next step."""
    if isinstance(found, str):
        why, _, step = found.partition(": ")
        return Answer(OBEYS, Outcome.UNKNOWN, f"because {why}", step)
    numbers = {"changes_expected": float(found.expected), "changes_seen": float(found.obeyed)}
    if found.ignores:
        return Answer(
            OBEYS, Outcome.UNFIT, "exposure commands that have no effect",
            "switch automatic exposure off, and stop other programs that use the camera "
            f"(v4l2-ctl --list-ctrls); {_STEP}",
            numbers,
        )  # fmt: skip
    if not found.follows and trouble:
        return Answer(OBEYS, Outcome.UNKNOWN, f"because {trouble}", next_step, numbers)
    if not found.follows:
        words = f"exposure commands of which only {found.obeyed} of {found.expected} had an effect"
        return Answer(OBEYS, Outcome.UNFIT, words, _STEP, numbers)
    delay = found.delay_frames
    if delay is None:
        return Answer(
            OBEYS, Outcome.UNKNOWN, "because frames were lost around every change: it obeys, but "
            "nobody knows how late", "a lower frame rate, or a less busy machine", numbers,
        )  # fmt: skip
    numbers["delay_frames"] = float(delay)
    others = [one for one in found.delays() if abs(one - delay) > 1]
    if len(others) > _FEW * len(found.delays()):
        words = f"exposure commands that take {min(found.delays())} to {max(found.delays())} frames"
        return Answer(OBEYS, Outcome.DEFECT, words, _STEP, numbers)
    words = f"it obeys, {delay} frames late"
    return Answer(OBEYS, Outcome.FINE, words, numbers=numbers)


def judge_steps(found: Power | None, exposures_us: Sequence[float], regional: Answer) -> Answer:
    """Say whether each exposure gives the light that was commanded, against the others'."""
    if found is None or regional.outcome is not Outcome.FINE:
        why = "local tone mapping changes the light of every exposure"
        return untold(EXACT, found, regional, why)
    seen = np.isfinite(found.steps)
    worst = float(np.abs(found.steps[seen]).max(initial=0.0))
    numbers = {"largest_error": worst, "seen": float(seen.sum())}
    if worst <= NOTICED_STEP:
        words = f"each gives what was commanded, within {100 * worst:.1f} %"
        return Answer(EXACT, Outcome.FINE, words, numbers=numbers)
    which = int(np.nanargmax(np.abs(found.steps)))
    words = (
        f"exposures that are not what was commanded ({exposures_us[which]:g} µs gives "
        f"{100 * found.steps[which]:+.0f} % light)"
    )
    return Answer(EXACT, Outcome.DEFECT, words, _STEP, numbers)
