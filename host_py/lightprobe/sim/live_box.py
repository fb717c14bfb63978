"""The box with its wheel beside a daemon in simulated time (:mod:`lightprobe.sim.live`)."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Self

from lightprobe.sim import faults
from lightprobe.sim.box import Box
from lightprobe.sim.clock import START_NS
from lightprobe.sim.world import State

_STEP_US, _MARGIN_US = 2000, 100


class LiveBox:
    """Firmware in lock-step; its wheel turns the polarizer of a LiveProbe's camera.

    with LiveBox() as box, LiveProbe(camera, box.arguments, box=box) as probe:
        probe.run(10)
    """

    def __init__(self, firmware: str = "host", seed: int = 0) -> None:
        """`firmware`: host or avr."""
        self._folder = tempfile.TemporaryDirectory(prefix="lp-")
        pty = Path(self._folder.name) / "mcu"
        self.box = Box(firmware, pty, seed, lock_step=True)
        self.arguments = (f"--rotator=mcu:serial:{pty}", "--polarizer=sweep")
        self._now_us = 0

    def __enter__(self) -> Self:
        """Give itself."""
        return self

    def __exit__(self, *reason: object) -> None:
        """End the firmware."""
        self.box.__exit__(*reason)
        self._folder.cleanup()

    def due_ns(self) -> int:
        """See :class:`lightprobe.sim.live.App`."""
        return START_NS + 1000 * (self._now_us + _STEP_US)

    def work(self) -> None:
        """See :class:`lightprobe.sim.live.App`."""
        self._advance(self._now_us + _STEP_US)

    def wheel_deg(self, from_ns: int, to_ns: int) -> tuple[float, ...] | None:
        """See :class:`lightprobe.sim.link.Surroundings`."""
        # simavr stops at the end of an instruction, just before the time that it is told
        self._advance(-(-(to_ns - START_NS) // 1000) + _MARGIN_US)
        return self.box.angles_deg(from_ns - START_NS, to_ns - START_NS)

    def misbehave(self, query: str) -> str:
        """See :class:`lightprobe.sim.link.Surroundings`."""
        camera, numbers = faults.split(query, self.box.names)
        self.box.set(**numbers)
        return camera

    def truth(self, state: State) -> dict[str, Any]:
        """See :class:`lightprobe.sim.link.Surroundings`."""
        return {}

    def _advance(self, to_us: int) -> None:
        if to_us > self._now_us:
            self.box.run(to_us - self._now_us)
            self._now_us = to_us
