"""What time it is for the simulator: the system's time, or a daemon's simulated time."""

from __future__ import annotations

import selectors
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from lightprobe.errors import LightprobeError

#: Where simulated time begins (daemon/app/run/time_control.h), and Unix time less it
#: (base/clock.h).
START_NS = 1_000_000_000_000
UNIX_NS = 1_700_000_000_000_000_000
_ANSWER_S = 120.0  # the machine may be busy: never a measure of speed


class ClockError(LightprobeError):
    """The daemon whose time is simulated has gone or does not answer."""


class Clock(Protocol):
    """Time, and waiting for it."""

    def now_ns(self) -> int:
        """CLOCK_MONOTONIC, or what stands for it."""

    def wait_until(self, t_ns: int, selector: selectors.BaseSelector) -> bool:
        """Wait until `t_ns`, or less long when the selector has something: then True."""


class SystemClock:
    """The time of this machine."""

    def now_ns(self) -> int:
        """CLOCK_MONOTONIC."""
        return time.monotonic_ns()

    def wait_until(self, t_ns: int, selector: selectors.BaseSelector) -> bool:
        """Sleep until `t_ns`, or until the selector has something."""
        left_s = (t_ns - time.monotonic_ns()) / 1e9
        return bool(selector.select(max(left_s, 0)))


class WatchedClock(SystemClock):
    """The time of this machine, for who wants to be called now and then while it goes on."""

    _STEP_S = 0.02

    def __init__(
        self, on_advance: Callable[[], None], check: Callable[[], None] = lambda: None
    ) -> None:
        """`on_advance` is called about every 20 ms; `check` raises when a wait is of no use."""
        self._on_advance, self._check = on_advance, check

    def advance(self, t_ns: int) -> None:
        """Wait until a time, at least for one call."""
        with selectors.DefaultSelector() as nothing:
            self.wait_until(t_ns, nothing)

    def wait_until(self, t_ns: int, selector: selectors.BaseSelector) -> bool:
        """See :class:`SystemClock`."""
        while True:
            left_s = max((t_ns - self.now_ns()) / 1e9, 0.0)
            has_some = bool(selector.select(min(left_s, self._STEP_S)))
            self._check()
            self._on_advance()
            if has_some or left_s <= self._STEP_S:
                return has_some

    def close(self) -> None:
        """There is nothing to close."""


class SimulatedClock:
    """The time of one daemon (`lightprobed --simulated-time=PATH`), which goes on when told to.

    When :meth:`advance` returns, the daemon has done all that was due by then, its threads' work
    included: what its clients' sockets hold is all that it has to say.
    """

    def __init__(
        self,
        path: Path,
        on_advance: Callable[[], None] = lambda: None,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        """Listen on a socket for the daemon.

        `on_advance` is called whenever time has gone on; `check` while the daemon is waited for,
        and raises an exception if it will not come.
        """
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(path))
        self._listener.listen(1)
        self._listener.settimeout(0.1)
        self._daemon: socket.socket | None = None
        self._now_ns = START_NS
        self._on_advance, self._check = on_advance, check

    def now_ns(self) -> int:
        """Give the simulated time."""
        return self._now_ns

    def advance(self, t_ns: int) -> None:
        """Let the daemon's time go on to `t_ns`; ClockError when it has ended."""
        t_ns = max(t_ns, self._now_ns)
        try:
            if self._daemon is None:
                self._daemon = self._accept()
            self._daemon.sendall(b"%d\n" % t_ns)
            answer = b""
            while not answer.endswith(b"\n"):
                data = self._daemon.recv(64)
                if not data:
                    raise ClockError("lightprobed: simulated time: it has ended")
                answer += data
        except TimeoutError:
            raise ClockError(f"lightprobed: simulated time: no answer in {_ANSWER_S} s") from None
        except OSError as error:
            raise ClockError(f"lightprobed: simulated time: {error}: it has ended") from None
        self._now_ns = t_ns
        self._on_advance()

    def _accept(self) -> socket.socket:
        while True:
            with suppress(TimeoutError):
                daemon, _ = self._listener.accept()
                daemon.settimeout(_ANSWER_S)
                return daemon
            self._check()

    def wait_until(self, t_ns: int, selector: selectors.BaseSelector) -> bool:
        """Let the daemon's time go on, then say whether the selector has something.

        Also at a time that has come already: the daemon first takes what it was sent then.
        """
        self.advance(t_ns)
        return bool(selector.select(0))

    def close(self) -> None:
        """Close the sockets: the daemon ends."""
        self._listener.close()
        if self._daemon is not None:
            self._daemon.close()
