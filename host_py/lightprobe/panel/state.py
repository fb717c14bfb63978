"""Which state the probe is in, by what is seen of it. No input or output here."""

from __future__ import annotations

from dataclasses import dataclass

from lightprobe.estimate import FLAG_WORDS, MINOR_FAULTS, EstimateFlag, Health, flag_names
from lightprobe.panel.patterns import State

#: A daemon that does not answer for longer does not start: it has failed.
STARTING_S = 60.0
#: Faults with which the light is measured, and nobody has to come: a choice of the owner, or an app
#: that does not run. `source-waiting` has a state of its own.
NO_ALARM = MINOR_FAULTS | {
    "insecure-lan", "preset-lowered", "reflection-maps-late", "orientation-silent",
    "orientation-late", "orientation-clock", "orientation-place", "source-waiting",
}  # fmt: skip
#: Flags for which somebody has to do something at the box.
ALARM = (
    EstimateFlag.INVALID_INPUT | EstimateFlag.RING_ONLY | EstimateFlag.EXPOSURE_IGNORED
    | EstimateFlag.RING_FAULT | EstimateFlag.WHEEL_FAULT | EstimateFlag.FILM_TURNED
)  # fmt: skip
_NO_PICTURE = EstimateFlag.STALE | EstimateFlag.NO_LIGHT


@dataclass(frozen=True)
class Seen:
    """One look at the probe."""

    connected: bool
    silent_s: float = 0.0  # since when it is not connected
    silence: str = ""  # why
    health: Health | None = None
    flags: EstimateFlag | None = None  # of an estimate that still counts; None: there is none
    network: bool = True


@dataclass(frozen=True)
class Judged:
    """A state, and why."""

    state: State
    why: str


def judge(seen: Seen) -> Judged:
    """Give the state of the probe itself."""
    if not seen.connected:
        late = seen.silent_s >= STARTING_S
        return Judged(State.FAULT if late else State.STARTING, seen.silence)
    if seen.health is None:
        return Judged(State.STARTING, "lightprobed has not told its health yet")
    wrong = _wrong(seen.health, seen.flags)
    if wrong:
        return Judged(State.FAULT, "; ".join(wrong))
    if not seen.network:
        return Judged(State.NO_NETWORK, "no interface has a cable or a cell, and an address")
    if seen.flags is None or seen.flags & _NO_PICTURE:
        return Judged(State.WAITING, _waits_for(seen.health, seen.flags))
    return Judged(State.MEASURING, "")


def _wrong(health: Health, flags: EstimateFlag | None) -> list[str]:
    faults = [f"{fault.id}: {fault.text}" for fault in health.faults if fault.id not in NO_ALARM]
    if health.source_state == "DOWN" and not faults:
        faults = ["the camera cannot be used as it is configured"]
    alarms = flag_names((flags or EstimateFlag(0)) & ALARM)
    return faults + [f"{name}: {FLAG_WORDS[name]}" for name in alarms]


def _waits_for(health: Health, flags: EstimateFlag | None) -> str:
    for fault in health.faults:
        if fault.id == "source-waiting":
            return fault.text
    if flags is not None and flags & EstimateFlag.NO_LIGHT:
        return FLAG_WORDS["NO_LIGHT"]
    return f"no estimate that still counts; the camera is {health.source_state.lower()}"
