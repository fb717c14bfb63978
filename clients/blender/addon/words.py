"""The state of a link in plain sentences, for the panel and for scripts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from lightprobe.estimate import FLAG_WORDS, Estimate, EstimateFlag, flag_names

from .link import Seen

#: FRESH: the light is of now. FAULTY: it is, but flags or faults say that it may be wrong. OLD: it
#: has outlived its time to live. WAITING: nothing has come yet. LOST: no connection. ENDED: the
#: client has given up.
State = Literal["FRESH", "FAULTY", "OLD", "WAITING", "LOST", "ENDED"]

#: Says that more lamps exist than are listed: the light is right.
_HARMLESS = EstimateFlag.MORE_LIGHTS
#: Above this, the panel says how far the world's irradiance is off.
_NOTABLE_ERROR = 0.02


@dataclass(frozen=True)
class Report:
    """What the panel shows."""

    state: State
    headline: str
    details: tuple[str, ...] = ()


def report(seen: Seen) -> Report:
    """Say how the light is, and what to do where something is wrong."""
    if seen.ended is not None:
        return Report("ENDED", seen.ended)
    details = (*_restarts(seen), *_flags(seen.estimate), *_faults(seen), *_world(seen))
    if not seen.connected:
        headline = seen.trouble or f"{seen.uri}: connect: no answer yet"
        return Report("LOST", headline, (*_age(seen), *_restarts(seen)))
    if seen.trouble:  # a refused request leaves the connection open
        details = (seen.trouble, *details)
    if seen.mode == "MAP" and not seen.offers_maps:
        return Report("WAITING", _no_maps(seen), details)
    if seen.estimate is None:
        return Report("WAITING", _nothing(seen), details)
    name = seen.probe_name or seen.uri
    if not seen.fresh:
        return Report(
            "OLD", f"{name}: the light is too old, so it fades out", (*_age(seen), *details)
        )
    flags = seen.estimate.flags & ~_HARMLESS
    if flags or seen.faults:
        return Report("FAULTY", f"{name}: light comes, but it may be wrong", details)
    return Report("FRESH", f"{name}: {_lamps(seen)}", details)


def _lamps(seen: Seen) -> str:
    if seen.mode == "MAP":
        return "the reflection map lights the scene"
    count = len(seen.estimate.beside_sh) if seen.estimate else 0
    return "1 lamp" if count == 1 else f"{count} lamps"


def _nothing(seen: Seen) -> str:
    state = f" (source: {seen.source_state})" if seen.source_state else ""
    what = "no reflection map" if seen.wants_maps and seen.offers_maps else "no light"
    return f"{seen.uri}: receive: connected, but {what} has come yet{state}: does the camera run?"


def _no_maps(seen: Seen) -> str:
    if not seen.wants_maps:
        return f"{seen.uri}: reflection map: its size is 0: choose 16, 32 or 64"
    return (
        f"{seen.uri}: reflection map: this probe sends none: start lightprobed with "
        "--reflection-map=64, or choose 'Lamps and sky'"
    )


def _age(seen: Seen) -> tuple[str, ...]:
    if seen.age_ms is None or seen.estimate is None:
        return ()
    return (
        f"newest light: {seen.age_ms / 1000:.1f} s old; "
        f"it is valid for {seen.estimate.ttl_ms / 1000:g} s",
    )


def _restarts(seen: Seen) -> tuple[str, ...]:
    if not seen.restarts:
        return ()
    return (f"The probe was started again ({seen.restarts} times); its lamps have new objects.",)


def _flags(estimate: Estimate | None) -> tuple[str, ...]:
    if estimate is None:
        return ()
    return tuple(
        f"{name}: {FLAG_WORDS.get(name, 'a flag of a newer probe: update the add-on')}"
        for name in flag_names(estimate.flags)
    )


def _faults(seen: Seen) -> tuple[str, ...]:
    return tuple(f"{fault.id}: {fault.text}" for fault in seen.faults)


def _world(seen: Seen) -> tuple[str, ...]:
    if seen.sky is None:
        return ()
    notes = []
    if seen.wants_maps and seen.offers_maps is False:
        notes.append("World: from the SH, because this probe sends no reflection maps.")
    if seen.sky.irradiance_error > _NOTABLE_ERROR:
        notes.append(
            f"World: irradiance is up to {100 * seen.sky.irradiance_error:.0f} % off, because the "
            "SH are not those of any light: the probe's picture is noisy."
        )
    return tuple(notes)
