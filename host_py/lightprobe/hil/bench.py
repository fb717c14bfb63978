"""The bench: one box, what was asked for, and what several checks share."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from lightprobe.hil.box import Box
from lightprobe.hil.check import RestartError
from lightprobe.hil.recording import Recording, record
from lightprobe.mcu import messages as mcu
from lightprobe.mcu.link import McuError

#: Asks the user to cover one sensor (or none: -1), and returns when that is so.
Cover = Callable[[int], None]


def nobody_covers(sensor: int) -> None:
    """Stand in where the user was not asked."""
    raise AssertionError(f"nobody was asked to cover sensor {sensor}")


@dataclass
class Bench:
    """One box under test."""

    box: Box
    seconds: float = 5.0
    cover: Cover = nobody_covers
    #: Numbers for the plots of the report, by their names.
    series: dict[str, Any] = field(default_factory=dict)
    homed: bool = False
    owned: frozenset[str] = frozenset()  # faults that a chosen check judges
    kept: dict[str, Any] = field(default_factory=dict)  # what checks share
    _recording: Recording | None = None
    _params: list[mcu.Param] | None = None
    _found: dict[int, int] = field(default_factory=dict)  # parameters before they were changed

    def recording(self) -> Recording:
        """Give the recording that several checks judge; it is made once."""
        if self._recording is None:
            self._recording = record(self.box, self.seconds)
        return self._recording

    def params(self) -> dict[str, int]:
        """Give the parameters as they were found, by name."""
        if self._params is None:
            self._params = self.box.params()
        return {one.name: one.value for one in self._params}

    def change(self, number: int, value: int) -> mcu.Param:
        """Set a parameter, not saved; :meth:`restore` puts it back."""
        self._found.setdefault(number, self.box.param(number).value)
        return self.box.param(number, value)

    def restore(self, *, is_there: bool = True) -> None:
        """Put everything back as it was found; `unrestored` names what the box did not take."""
        if is_there:
            with suppress(RestartError, McuError, OSError):
                self.box.rates()
        for number, value in list(self._found.items()):
            with suppress(RestartError, McuError, OSError):
                if is_there:
                    self.box.param(number, value)
                    del self._found[number]
        if self.homed and is_there:
            with suppress(RestartError, McuError, OSError):
                self.box.release()
        self.homed = False

    @property
    def unrestored(self) -> list[str]:
        """Parameters that were changed and could not be put back; a reset does it."""
        return [mcu.param_names().get(number, str(number)) for number in self._found]
