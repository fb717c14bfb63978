"""The microcontroller with wheel and ring: simulated, or a real one on a port."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Protocol, Self

import pytest

from lightprobe.errors import UsageError
from lightprobe.sim.live_box import LiveBox
from lightprobe.testing.breakable import Breakable
from lightprobe.testing.faults import BOX_FAULTS, healthy_box, numbers_of


class Box(Protocol):
    """What a test may do with the box."""

    @property
    def port(self) -> str:
        """Where the daemon finds it: a device."""

    @property
    def is_real(self) -> bool:
        """Whether it is a real one, which cannot be told to break."""

    def fault(self, name: str = "", /, **numbers: float) -> None:
        """Break something from now on: `fault("wheel-stuck")`, or `fault(slow=0.3)`.

        Names are those of :data:`lightprobe.testing.FAULTS`, numbers those of `lightprobe simulate
        --help-faults`. UsageError for an unknown one. With a real box the test is skipped.
        """

    def heal(self) -> None:
        """Repair everything. With a real box the test is skipped.

        LDR_OPEN and LDR_SHORTED are reported until :meth:`restart`.
        """

    def restart(self) -> None:
        """Let the microcontroller start again: it forgets faults. A real one: skip the test."""

    def faulty(self, name: str = "", /, **numbers: float) -> AbstractContextManager[None]:
        """Break something as :meth:`fault` does as long as the `with` block lasts."""

    def wheel_deg(self) -> float:
        """Say where the wheel truly is. With a real box the test is skipped."""


class SimulatedBox(Breakable):
    """The firmware in a simulated box."""

    is_real = False

    def __init__(self, firmware: str = "host", seed: int = 0, *, real_time: bool = False) -> None:
        """Start the firmware, host or avr. BoxError when it is not installed."""
        self.live = LiveBox(firmware, seed, real_time=real_time)

    def __enter__(self) -> Self:
        """Give itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the firmware."""
        self.live.__exit__()

    @property
    def port(self) -> str:
        """See :class:`Box`."""
        return str(self.live.line)

    def fault(self, name: str = "", /, **numbers: float) -> None:
        """See :class:`Box`."""
        found = numbers_of(name, dict(numbers), BOX_FAULTS, "box")
        unknown = sorted(set(found) - self.live.box.names)
        if unknown:
            raise UsageError(
                f"box: no number {', '.join(unknown)}: `lightprobe simulate --help-faults` lists "
                "all of them"
            )
        self.live.box.set(**found)

    def heal(self) -> None:
        """See :class:`Box`."""
        self.live.box.set(**healthy_box())

    def restart(self) -> None:
        """See :class:`Box`."""
        self.live.box.set(reset=1)

    def wheel_deg(self) -> float:
        """See :class:`Box`."""
        return self.live.box.get("wheel_deg")


class RealBox(Breakable):
    """A real box on a serial port. A test cannot break it, and is skipped."""

    is_real = True
    live = None

    def __init__(self, port: str) -> None:
        """`port`: its device, such as /dev/ttyUSB0."""
        self.port = port

    def fault(self, name: str = "", /, **numbers: float) -> None:
        """See :class:`Box`."""
        self._skip(name or ", ".join(numbers))

    def heal(self) -> None:
        """See :class:`Box`."""
        self._skip("repair")

    def restart(self) -> None:
        """See :class:`Box`."""
        self._skip("restart")

    def wheel_deg(self) -> float:
        """See :class:`Box`."""
        self._skip("the true angle of the wheel")
        return 0.0

    def _skip(self, what: str) -> None:
        pytest.skip(
            f"box: {self.port}: {what}: a real box cannot do this: run the test without "
            "--lightprobe-port"
        )
