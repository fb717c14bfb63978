"""Another device's times on our clock, from when its messages arrive."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field


@dataclass
class ClockOffset:
    """How far another clock is off ours, without trusting that the two agree.

    The offset is the smallest (arrival − send time) of the last messages: exact up to the fastest
    transfer among them, and it follows when a clock is set or drifts.
    """

    _offsets_ns: deque[int] = field(default_factory=lambda: deque(maxlen=32))

    def arrived(self, sent_ns: int, now_ns: int) -> None:
        """Note a message: sent at `sent_ns` of its clock, arrived at `now_ns` of ours."""
        self._offsets_ns.append(now_ns - sent_ns)

    def ours_ns(self, theirs_ns: int) -> int:
        """Time of our clock at `theirs_ns` of the other; only after a message has arrived."""
        return theirs_ns + min(tuple(self._offsets_ns))
