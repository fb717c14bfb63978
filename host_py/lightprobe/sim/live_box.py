"""The box with wheel and ring beside a daemon that a test starts (:mod:`lightprobe.sim.live`)."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from lightprobe.geometry import Array
from lightprobe.sim import faults
from lightprobe.sim.box import Box
from lightprobe.sim.clock import START_NS
from lightprobe.sim.world import State

_STEP_US, _MARGIN_US = 2000, 100
#: How often light reaches the sensors.
_LIGHT_NS, _LIGHT_STEPS = 20_000_000, 10


class LiveBox:
    """Firmware in lock-step; its wheel turns the polarizer of a LiveProbe's camera.

    with LiveBox() as box, LiveProbe(camera, box.arguments, box=box) as probe:
        probe.run(10)
    """

    def __init__(self, firmware: str = "host", seed: int = 0, *, real_time: bool = False) -> None:
        """`firmware`: host or avr; `real_time`: its time is this machine's, not in lock-step."""
        self._folder = tempfile.TemporaryDirectory(prefix="lp-")
        self.line = Path(self._folder.name) / "mcu"
        self.box = Box(firmware, self.line, seed, lock_step=not real_time)
        self.arguments = (f"--rotator=mcu:serial:{self.line}", "--polarizer=sweep")
        self._now_us = 0
        self._real_time, self._light_ns, self._steps = real_time, 0, 0
        self._lux_now: Callable[[], Array] | None = None

    def __enter__(self) -> Self:
        """Give itself."""
        return self

    def __exit__(self, *reason: object) -> None:
        """End the firmware."""
        self.box.__exit__(*reason)
        self._folder.cleanup()

    def shine(self, lux_now: Callable[[], Array]) -> None:
        """From now on nine illuminances fall on the ring, asked for whenever it works."""
        self._lux_now = lux_now

    def due_ns(self) -> int:
        """See :class:`lightprobe.sim.live.App`."""
        return self._light_ns if self._real_time else START_NS + 1000 * (self._now_us + _STEP_US)

    def work(self) -> None:
        """See :class:`lightprobe.sim.live.App`."""
        if self._lux_now is not None and (self._real_time or self._steps % _LIGHT_STEPS == 0):
            self.box.shine(self._lux_now())
        self._steps += 1
        if self._real_time:
            self._light_ns = time.monotonic_ns() + _LIGHT_NS
        else:
            self._advance(self._now_us + _STEP_US)

    def wheel_deg(self, from_ns: int, to_ns: int) -> tuple[float, ...] | None:
        """See :class:`lightprobe.sim.link.Surroundings`."""
        if self._real_time:
            return self.box.angles_deg(from_ns, to_ns)
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
