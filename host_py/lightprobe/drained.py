"""Until when all that has arrived has also been read."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import TypeVar

T = TypeVar("T")

#: So often a turn of the event loop is noted,
PERIOD_S = 0.05
#: and so many turns it takes until what waited before them has been read.
TURNS = 3


class Drained:
    """The last moment of which it is known that all that had come by then was read.

    After a pause (the event loop was blocked, the process was stopped) messages wait in the
    system's buffers, and the caller may look before they are read. What is the newest by then says
    nothing of what the probe has sent. So age and silence are judged at :attr:`until_ns`.
    """

    def __init__(self) -> None:
        """Nothing is noted yet: as if all were read now."""
        self._turns_ns: deque[int] = deque(maxlen=TURNS)

    async def note_turns(self) -> None:
        """Note the turns of this event loop until it is cancelled."""
        self._turns_ns = deque([time.monotonic_ns()], maxlen=TURNS)
        try:
            while True:
                await asyncio.sleep(PERIOD_S)
                self._turns_ns.append(time.monotonic_ns())
        finally:
            self._turns_ns = deque(maxlen=TURNS)  # a new one: other threads may be reading

    @property
    def until_ns(self) -> int:
        """Of time.monotonic_ns(): all that came before has been read. From any thread."""
        with suppress(IndexError):
            return self._turns_ns[0]
        return time.monotonic_ns()

    async def within(self, timeout_s: float | None, wait: Callable[[], Awaitable[T]]) -> T:
        """Await `wait()`, which may be cancelled and called again, for so long (None: for ever).

        TimeoutError when nothing has come. A pause of the program is no silence: the time is over
        only when all that had come by then was read.
        """
        if timeout_s is None:
            return await wait()
        due_ns = time.monotonic_ns() + round(1e9 * timeout_s)
        while True:
            try:
                async with asyncio.timeout(timeout_s) as limit:
                    return await wait()
            except TimeoutError:  # also what a socket raises whose peer does not answer
                if not limit.expired() or self.until_ns >= due_ns:
                    raise
            timeout_s = PERIOD_S
