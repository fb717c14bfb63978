"""What a test says when the probe did not show what was waited for."""

from __future__ import annotations

from typing import Protocol

from lightprobe.estimate import Estimate, Health, flag_names

_LOG_LINES = 25


class NotSeen(AssertionError):  # noqa: N818 - reads as what it is
    """What was waited for did not come in time; says the stage, the state and the next step."""


class Watched(Protocol):
    """What a failure is told from."""

    @property
    def t_s(self) -> float:
        """Seconds since the start."""

    @property
    def log(self) -> str:
        """All that the daemon has said."""

    @property
    def estimate(self) -> Estimate | None:
        """The newest estimate."""

    @property
    def health(self) -> Health | None:
        """The newest health message."""


def not_seen(probe: Watched, wanted: str, within_s: float, hint: str = "") -> NotSeen:
    """Describe it, with the last lines of the daemon's log.

    `hint`: the next step where camera and daemon work.
    """
    stage, next_step = _stage(probe.estimate, probe.health)
    if hint and stage == "light":
        next_step = hint
    log = "\n".join(probe.log.strip().splitlines()[-_LOG_LINES:])
    return NotSeen(
        f"probe: {stage}: no {wanted} in {within_s:g} s, at {probe.t_s:.2f} s\n"
        f"{state(probe.estimate, probe.health)}\n"
        f"next step: {next_step}\n"
        f"log of lightprobed:\n{log or '(empty)'}"
    )


def state(estimate: Estimate | None, health: Health | None) -> str:
    """What the probe shows now, in a few lines."""
    lines = [*_health_lines(health), *_estimate_lines(estimate)]
    return "\n".join(lines) or "the probe has said nothing yet"


def _health_lines(health: Health | None) -> list[str]:
    if health is None:
        return []
    faults = "; ".join(f"{one.id} ({one.text})" for one in health.faults) or "none"
    lines = [
        f"camera: {health.source_state}, {health.frames_received} frames received, "
        f"{health.frames_rejected} rejected, {health.frames_dropped} dropped",
        f"faults: {faults}",
    ]
    if health.wheel is not None:
        at = health.wheel.measured_deg
        lines.append(f"wheel: {health.wheel.phase}, at {'?' if at is None else f'{at:.1f}°'}")
    return lines


def _estimate_lines(estimate: Estimate | None) -> list[str]:
    if estimate is None:
        return []
    lamps = (
        f"{one.azimuth_deg:.1f}°, {one.elevation_deg:.1f}°, {one.irradiance.mean():.3g}"
        for one in estimate.lights
    )
    return [
        f"flags: {', '.join(flag_names(estimate.flags)) or 'none'}",
        f"lamps (azimuth, elevation, mean irradiance): {'; '.join(lamps) or 'none'}",
    ]


def _stage(estimate: Estimate | None, health: Health | None) -> tuple[str, str]:
    """Where it stopped, and what to look at."""
    if health is None:
        return "connection", "read the log: did the daemon refuse an option or a client?"
    if health.source_state != "STREAMING":
        return (
            f"camera {health.source_state}",
            "is a fault of the camera still on? camera.heal() takes all away",
        )
    if estimate is None:
        return "estimate", "frames come and no estimate: read the log"
    if health.faults:
        return "light", "the faults above may be the reason; docs/users/faults.md explains them"
    return "light", "is the condition right for the state above? A longer within_s= waits longer"
