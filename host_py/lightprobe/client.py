"""Clients of a probe: one for asyncio, and one that blocks (the same, in a thread of its own).

>>> with Client("tcp:127.0.0.1:7700") as probe:
...     for estimate in probe.estimates():
...         draw(estimate.lights, estimate.sh)

A client connects, asks for what its :class:`Subscription` says, and stays: when the connection is
lost or the probe sends nonsense it connects again, waiting longer after each failure, and more than
a minute after a refused token. Only a probe
of another major protocol version is a final error. The newest estimate wins: who reads slowly
skips, and the number of skipped ones is counted. `latest()` is None once the estimate has outlived
its ttl_ms, so that nobody is lit by light of an hour ago: then :func:`fallback_estimate` gives what
to show. A pause of the program makes nothing old: what came meanwhile is read first.

Estimates that were made for another subscription, as those that a probe sends before it has read
the client's own, are dropped and counted.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import CancelledError
from typing import Any, Self, TypeVar

from numpy.typing import ArrayLike

from lightprobe.async_client import DEFAULT_URI as DEFAULT_URI
from lightprobe.async_client import AsyncClient as AsyncClient
from lightprobe.async_client import OnWaiting, Patience
from lightprobe.async_client import Statistics as Statistics
from lightprobe.errors import ProbeError
from lightprobe.estimate import Estimate, Health, Hello, PolarizationMap
from lightprobe.reflection_map import ReflectionMap
from lightprobe.wire import Subscription

T = TypeVar("T")


class Client:
    """A probe's client that blocks; use with `with`. Its methods may be called from any thread."""

    def __init__(self, uri: str = DEFAULT_URI, subscription: Subscription | None = None) -> None:
        """Take an address (raises :class:`ProbeError` when it is none); connects on entering."""
        self._async = AsyncClient(uri, subscription)
        self._loop: asyncio.AbstractEventLoop | None = None  # runs while the block lasts
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        """Start connecting, in the background. May be entered again after it was left."""
        if self._loop is not None:
            raise ProbeError(
                f"{self.uri}: client: already in use: create one client for each `with` block"
            )
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=_run, args=(self._loop,), name=f"lightprobe {self.uri}", daemon=True
        )
        self._thread.start()
        self._call(self._async.__aenter__())
        return self

    def __exit__(self, *_: object) -> None:
        """Disconnect; threads that still wait for an estimate get a :class:`ProbeError`."""
        loop, thread = self._loop, self._thread
        if loop is None or thread is None:
            return
        try:
            self._call(self._async.__aexit__())
        finally:
            self._loop = self._thread = None
            loop.call_soon_threadsafe(loop.stop)
            thread.join()

    def _call(self, work: Coroutine[Any, Any, T]) -> T:
        """Run in the client's thread; :class:`ProbeError` when it does not run."""
        try:
            if self._loop is None:
                raise self._async.not_running()
            future = asyncio.run_coroutine_threadsafe(work, self._loop)
        except (ProbeError, RuntimeError):  # RuntimeError: closed just now, by another thread
            work.close()
            raise self._async.not_running() from None
        try:
            return future.result()
        except CancelledError:
            raise self._async.not_running() from None
        except BaseException:
            future.cancel()  # Ctrl-C in the caller's thread
            raise

    @property
    def uri(self) -> str:
        """Address of the probe."""
        return self._async.uri

    @property
    def connected(self) -> bool:
        """True between the probe's Hello and the end of the connection."""
        return self._async.connected

    @property
    def hello(self) -> Hello | None:
        """Give what the probe said of itself; None while not connected."""
        return self._async.hello

    @property
    def health(self) -> Health | None:
        """Counters of the daemon, as of its last health message."""
        return self._async.health

    @property
    def last_error(self) -> str | None:
        """Say what ended the last connection, or which request was refused."""
        return self._async.last_error

    @property
    def statistics(self) -> Statistics:
        """Counters of this client."""
        return self._async.statistics

    @property
    def subscription(self) -> Subscription:
        """What was asked for last."""
        return self._async.subscription

    @property
    def reflection_map(self) -> ReflectionMap | None:
        """Give the newest reflection map, however old; None before the first."""
        return self._async.reflection_map

    def latest(self) -> Estimate | None:
        """Give the newest estimate at once; None before the first, and when it has aged out."""
        return self._async.latest()

    def age_ms(self) -> float | None:
        """Milliseconds since the newest estimate's capture, aged out or not."""
        return self._async.age_ms()

    def receive(
        self, timeout_s: float | None = None, on_waiting: OnWaiting | None = None
    ) -> Estimate:
        """Wait for an estimate that was not received before; see :meth:`AsyncClient.receive`.

        `on_waiting` is called in the caller's thread.
        """
        patience = Patience(timeout_s, on_waiting)
        while (estimate := self._call(self._async._next(patience.piece_s()))) is None:
            patience.nothing_came(self._async._why_nothing())
        return estimate

    def estimates(
        self, timeout_s: float | None = None, on_waiting: OnWaiting | None = None
    ) -> Iterator[Estimate]:
        """Every new estimate, for ever; says what it waits for and raises as :meth:`receive`."""
        while True:
            yield self.receive(timeout_s, on_waiting)

    def wait_for(self, condition: Callable[[Client], bool], timeout_s: float) -> bool:
        """Wait until `condition(client)` holds; False when it does not in time."""
        deadline = time.monotonic() + timeout_s
        while not condition(self):
            if time.monotonic() > deadline:
                return False
            time.sleep(0.01)
        return True

    def subscribe(self, subscription: Subscription) -> None:
        """Ask for something else; see :meth:`AsyncClient.subscribe`."""
        self._call(self._async.subscribe(subscription))

    def polarization(self, timeout_s: float = 10.0) -> PolarizationMap:
        """Ask for a coarse picture of polarized light; see :meth:`AsyncClient.polarization`."""
        return self._call(self._async.polarization(timeout_s))

    def sweep(self, timeout_s: float = 60.0) -> int:
        """Have the polarizer visit all its angles; see :meth:`AsyncClient.sweep`."""
        return self._call(self._async.sweep(timeout_s))

    def take_stills(self, timeout_s: float = 10.0) -> int:
        """Have cameras for stills take a set now; see :meth:`AsyncClient.take_stills`."""
        return self._call(self._async.take_stills(timeout_s))

    def send_pose(
        self,
        orientation: ArrayLike,
        time_ns: int | None = None,
        sigma_deg: float | None = None,
        position_m: ArrayLike | None = None,
        position_sigma_m: float | None = None,
    ) -> bool:
        """Say how the head is turned; see :meth:`AsyncClient.send_pose`."""
        when_ns = time.monotonic_ns() if time_ns is None else time_ns

        async def send() -> bool:
            return self._async.send_pose(
                orientation, when_ns, sigma_deg, position_m, position_sigma_m
            )

        return self._call(send())

    @property
    def clock_sigma_s(self) -> float:
        """1 sigma of how far the probe's clock is off ours; infinite before the first ping."""
        return self._async.clock_sigma_s


def _run(loop: asyncio.AbstractEventLoop) -> None:
    """Run an event loop until it is stopped, then end whatever still waits in it."""
    asyncio.set_event_loop(loop)
    loop.run_forever()
    left = asyncio.all_tasks(loop)
    for task in left:
        task.cancel()
    loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
    loop.close()
