"""Looks at the daemon of this machine, through the client."""

from __future__ import annotations

import time
from typing import Self

from lightprobe.client import Client
from lightprobe.panel import network
from lightprobe.panel.state import Judged, Seen, judge
from lightprobe.wire import Subscription

#: The panel needs flags and health alone.
_ASKED = Subscription(rate_hz=2, sh_order=0, max_lights=0, health_period_ms=1000)


class Probe:
    """A connection that comes back by itself; use with `with`."""

    def __init__(self, uri: str, look_at_network: bool) -> None:
        """Take an address; raises ProbeError when it is none."""
        self._client = Client(uri, _ASKED)
        self._network = look_at_network
        self._silent_since_s: float | None = time.monotonic()

    def __enter__(self) -> Self:
        """Begin to connect."""
        self._client.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        """End the connection."""
        self._client.__exit__()

    def look(self) -> Judged:
        """How it is now; returns at once."""
        client, now_s = self._client, time.monotonic()
        if client.connected:
            self._silent_since_s = None
        elif self._silent_since_s is None:
            self._silent_since_s = now_s
        estimate = client.latest()
        return judge(
            Seen(
                connected=client.connected,
                silent_s=now_s - (self._silent_since_s or now_s),
                silence=f"{client.last_error or client.uri + ': does not answer yet'}",
                health=client.health,
                flags=estimate.flags if estimate else None,
                network=not self._network or network.connected(),
            )
        )
