"""Another device's times on our clock, from when its messages arrive."""

from __future__ import annotations

import math
import time
from collections import deque
from dataclasses import dataclass, field


@dataclass
class ClockOffset:
    """How far another clock is off ours, without trusting that the two agree.

    The offset is the smallest (arrival − send time) of the last messages: exact up to the fastest
    transfer among them, and it follows when a clock is set or drifts. Where it is known, too, when
    messages of ours arrived there, it is exact up to half of the fastest round trip (as NTP does,
    RFC 5905).
    """

    _offsets_ns: deque[int] = field(default_factory=lambda: deque(maxlen=32))
    _back_ns: deque[int] = field(default_factory=lambda: deque(maxlen=16))

    def arrived(self, sent_ns: int, now_ns: int) -> None:
        """Note a message: sent at `sent_ns` of its clock, arrived at `now_ns` of ours."""
        self._offsets_ns.append(now_ns - sent_ns)
        if self._round_trip_ns() < 0:  # less than no time: a clock has been set
            self._offsets_ns.clear()
            self._back_ns.clear()
            self._offsets_ns.append(now_ns - sent_ns)

    def was_there(self, sent_ns: int, theirs_ns: int) -> None:
        """Note a message of ours: sent at `sent_ns` of our clock, there at `theirs_ns` of theirs.

        Before :meth:`arrived` of the answer that tells it.
        """
        self._back_ns.append(theirs_ns - sent_ns)

    def ours_ns(self, theirs_ns: int) -> int:
        """Time of our clock at `theirs_ns` of the other.

        Before a message has arrived: as if the other clock, too, showed Unix time.
        """
        offsets_ns = tuple(self._offsets_ns)
        offset_ns = min(offsets_ns) if offsets_ns else time.monotonic_ns() - time.time_ns()
        back_ns = tuple(self._back_ns)
        return theirs_ns + ((offset_ns - min(back_ns)) // 2 if back_ns else offset_ns)

    @property
    def sigma_s(self) -> float:
        """1 sigma of the offset; infinite where only one direction is known."""
        half_s = self._round_trip_ns() / 2e9
        return half_s / math.sqrt(3)  # evenly likely within half of the round trip

    def _round_trip_ns(self) -> float:
        offsets_ns, back_ns = tuple(self._offsets_ns), tuple(self._back_ns)
        return min(offsets_ns) + min(back_ns) if offsets_ns and back_ns else math.inf
