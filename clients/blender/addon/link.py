"""The connection to a probe, in a thread of its own. Nothing here touches bpy.

The thread does what takes time: it waits for packets, and computes the picture of the world. The
main thread reads the newest :class:`Seen`, which never changes once it is there.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Literal

from lightprobe import Client, Subscription
from lightprobe.errors import ProbeError, ProbeTimeout
from lightprobe.estimate import Estimate, Fault
from lightprobe.geometry import Array
from lightprobe.reflection_map import ReflectionMap

from . import sky
from .suns import there

#: LAMPS: the listed lamps as lamps, the rest (AMBIENT) as the world. MAP: the reflection map with
#: the lamps in it (TOTAL) as the world, and no lamps. Neither counts light twice.
Mode = Literal["LAMPS", "MAP"]

#: How long the thread waits for a packet before it looks whether it is to end.
_WAIT_S = 0.1
#: Estimates that are remembered until the reflection map of the same frame comes.
_REMEMBERED = 64


@dataclass(frozen=True)
class Wish:
    """What the user wants from the probe."""

    mode: Mode = "LAMPS"
    max_lamps: int = 4  # 0…8
    map_size: int = 32  # texels along an edge of reflection maps: 16, 32, 64; 0: none
    rate_hz: float = 10.0  # most updates a second
    steady: bool = True  # light stays where it is while the probe turns, where it knows how

    def subscription(self) -> Subscription:
        """Give what the client asks for; raises :class:`lightprobe.SubscriptionError`."""
        return Subscription(
            # A map belongs to the estimate of one frame, so none of these may be missing.
            rate_hz=0.0 if self.map_size else self.rate_hz,
            sh_order=4,
            max_lights=self.max_lamps if self.mode == "LAMPS" else 0,
            kind="AMBIENT",
            reflection_map_size=self.map_size,
            reflection_map_rate_hz=self.rate_hz,
            reflection_map_kind="AMBIENT" if self.mode == "LAMPS" else "TOTAL",
        )


@dataclass(frozen=True, eq=False)
class Seen:
    """All that is known of the probe at one moment."""

    uri: str
    mode: Mode
    connected: bool = False
    probe_name: str = ""
    #: True when the probe can send maps; None before it has said so.
    offers_maps: bool | None = None
    wants_maps: bool = False
    estimate: Estimate | None = None  # the newest, however old
    sky: sky.Sky | None = None  # of this estimate
    age_ms: float | None = None  # of the newest estimate of all
    fresh: bool = False  # the newest estimate has not outlived its time to live
    restarts: int = 0  # how often the probe was started again since Connect
    source_state: str = ""
    faults: tuple[Fault, ...] = ()
    trouble: str | None = None  # what ended the last connection, or which request was refused
    ended: str | None = None  # why the client has given up


class Link:
    """A client that runs until :meth:`close`."""

    def __init__(self, uri: str, wish: Wish, standing_m: Array | None = None) -> None:
        """Start connecting; raises :class:`lightprobe.LightprobeError` for what is no address."""
        #: Where the object stands whose ambient light is wanted; see :func:`.suns.there`.
        self.standing_m = standing_m
        self._wish = wish
        self._client = Client(uri, wish.subscription())
        self._seen = Seen(self._client.uri, wish.mode, wants_maps=wish.map_size > 0)
        self._recent: OrderedDict[tuple[int, int], Estimate] = OrderedDict()
        self._map: ReflectionMap | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="lightprobe add-on", daemon=True)
        self._thread.start()

    @property
    def seen(self) -> Seen:
        """Give what is known now, at once."""
        return self._seen

    def close(self) -> None:
        """Let the thread end; does not wait for it."""
        self._stop.set()

    def wait_closed(self, timeout_s: float) -> bool:
        """For scripts and tests: wait for the thread's end; False when it still runs."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            with self._client as probe:
                while not self._stop.is_set():
                    self._look(probe)
        except ProbeError as error:
            self._seen = replace(self._seen, connected=False, fresh=False, ended=str(error))
        except Exception as error:  # the thread's last words: there is nobody to raise it to
            text = f"{self._seen.uri}: add-on: unexpected {error!r}: please report it"
            self._seen = replace(self._seen, connected=False, fresh=False, ended=text)

    def _look(self, probe: Client) -> None:
        """Wait for news for a moment, and publish what is known then."""
        try:
            estimate: Estimate | None = probe.receive(_WAIT_S)
        except ProbeTimeout:
            estimate = None
        hello, health, before = probe.hello, probe.health, self._seen
        offers = before.offers_maps if hello is None else hello.max_reflection_map_size > 0
        seen = replace(
            before,
            connected=hello is not None,
            probe_name=hello.name if hello else before.probe_name,
            offers_maps=offers,
            age_ms=probe.age_ms(),
            fresh=probe.latest() is not None,
            source_state=health.source_state if health and hello else "",
            faults=health.faults if health and hello else (),
            trouble=probe.last_error,
        )
        if before.wants_maps and offers:
            seen = self._with_map(seen, probe, estimate)
        elif estimate is not None and before.mode == "LAMPS":
            seen = self._with(seen, estimate, self._sky_of(estimate))
        self._seen = seen

    def _sky_of(self, estimate: Estimate) -> sky.Sky:
        orientation = estimate.orientation if self._wish.steady else None
        moved = there(estimate, self._wish.steady, self.standing_m)
        return sky.from_harmonics(moved.sh, orientation)

    def _with_map(self, seen: Seen, probe: Client, estimate: Estimate | None) -> Seen:
        """Take the newest map, with the estimate of the same frame: their light adds up."""
        if estimate is not None:
            self._recent[estimate.boot_id, estimate.sequence] = estimate
            while len(self._recent) > _REMEMBERED:
                self._recent.popitem(last=False)
        found = probe.reflection_map
        if found is None or found is self._map:
            return seen
        partner = self._recent.get((found.boot_id, found.sequence))
        if partner is None:
            return seen
        self._map = found
        orientation = found.orientation if self._wish.steady else None
        return self._with(seen, partner, sky.from_map(found, orientation))

    @staticmethod
    def _with(seen: Seen, estimate: Estimate, picture: sky.Sky) -> Seen:
        before = seen.estimate
        restarted = before is not None and before.boot_id != estimate.boot_id
        return replace(
            seen, estimate=estimate, sky=picture, restarts=seen.restarts + int(restarted)
        )
