"""Clients of a probe: one for asyncio, and one that blocks (the same, in a thread of its own).

>>> with Client("tcp:127.0.0.1:7700") as probe:
...     for estimate in probe.estimates():
...         draw(estimate.lights, estimate.sh)

A client connects, asks for what its :class:`Subscription` says, and stays: when the connection is
lost or the probe sends nonsense it connects again, waiting longer after each failure. Only a probe
of another major protocol version is a final error. The newest estimate wins: who reads slowly
skips, and the number of skipped ones is counted. `latest()` is None once the estimate has outlived
its ttl_ms, so that nobody is lit by light of an hour ago.
"""

from __future__ import annotations

import asyncio
import os
import random
import socket
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Self, TypeVar

from lightprobe.errors import LightprobeError
from lightprobe.estimate import Estimate, Health, Hello, Refusal
from lightprobe.wire import (
    PROTOCOL_MAJOR,
    Decoder,
    Message,
    Subscription,
    WireError,
    encode_subscription,
)

DEFAULT_URI = "tcp:127.0.0.1:7700"
CONNECT_TIMEOUT_S = 3.0
HELLO_TIMEOUT_S = 3.0
BACKOFF_FIRST_S, BACKOFF_LAST_S = 0.1, 5.0

T = TypeVar("T")


class ProbeError(LightprobeError):
    """Something that a user of the client has to know; names object, stage and next step."""


class ProbeTimeout(ProbeError, TimeoutError):  # noqa: N818 - reads as what it is
    """No estimate came in the time given."""


class IncompatibleProbe(ProbeError):  # noqa: N818
    """The probe speaks another major version of the protocol; trying again would not help."""


@dataclass
class Statistics:
    """Counters of one client since its start."""

    connections: int = 0
    failures: int = 0  # connections refused, lost, or closed by us for nonsense
    estimates: int = 0
    skipped: int = 0  # superseded before the user took them
    refusals: int = 0


@dataclass(frozen=True)
class Address:
    """Where a probe listens: `tcp:HOST:PORT` (IPv6 in brackets) or `unix:PATH`."""

    host: str | None
    port: int
    path: str | None

    @classmethod
    def parse(cls, uri: str) -> Address:
        """Read an address; raises :class:`ProbeError` that says what is wrong with it."""
        scheme, _, rest = uri.partition(":")
        if scheme == "unix" and rest:
            if len(os.fsencode(rest)) > 107:
                raise ProbeError(f"{uri}: address: socket paths have at most 107 bytes")
            return cls(None, 0, rest)
        if scheme == "tcp":
            host, _, port = rest.rpartition(":")
            if host and port.isdecimal() and 0 < int(port) < 65536:
                return cls(host.removeprefix("[").removesuffix("]"), int(port), None)
        raise ProbeError(f"{uri}: address: want tcp:HOST:PORT or unix:PATH")

    async def connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """Open a stream."""
        if self.path is not None:
            return await asyncio.open_unix_connection(self.path)
        reader, writer = await asyncio.open_connection(self.host, self.port)
        sock: socket.socket = writer.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in (("TCP_KEEPIDLE", 5), ("TCP_KEEPINTVL", 2), ("TCP_KEEPCNT", 3)):
            if hasattr(socket, option):  # a half-open connection shows within ~11 s
                sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
        return reader, writer


@dataclass
class Ageing:
    """Age of estimates without trusting that the two clocks agree.

    The offset between the probe's clock and ours is the smallest (arrival − send time) of the last
    messages: exact up to the fastest transfer among them, and it follows when a clock is set.
    """

    offsets_ns: deque[int] = field(default_factory=lambda: deque(maxlen=32))

    def arrived(self, estimate: Estimate, now_ns: int) -> None:
        """Note an arrival at `now_ns` of our monotonic clock."""
        self.offsets_ns.append(now_ns - estimate.send_time_unix_ns)

    def age_ms(self, estimate: Estimate, now_ns: int) -> float:
        """Milliseconds since the estimate's capture."""
        return (now_ns - estimate.capture_time_unix_ns - min(tuple(self.offsets_ns))) / 1e6


class AsyncClient:
    """A probe's client for asyncio; use with `async with`. Not for several event loops at once."""

    def __init__(self, uri: str = DEFAULT_URI, subscription: Subscription | None = None) -> None:
        """Take an address (raises :class:`ProbeError` when it is none); connects on entering."""
        self.uri = uri
        self.hello: Hello | None = None  # of the connection that is open; None: not connected
        self.health: Health | None = None
        self.last_error: str | None = None
        self.statistics = Statistics()
        self._address = Address.parse(uri)
        self._subscription = subscription or Subscription()
        self._newest: Estimate | None = None
        self._number = self._taken = 0
        self._ageing = Ageing()
        self._fatal: ProbeError | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._news = asyncio.Condition()
        self._task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        """Start connecting, in the background."""
        self._task = asyncio.create_task(self._stay_connected())
        return self

    async def __aexit__(self, *_: object) -> None:
        """Disconnect."""
        if self._task is not None:
            self._task.cancel()
            with suppress(asyncio.CancelledError):
                await self._task
            self._task = None

    @property
    def connected(self) -> bool:
        """True between the probe's Hello and the end of the connection."""
        return self.hello is not None

    def latest(self) -> Estimate | None:
        """Give the newest estimate; None before the first, and when it has outlived its ttl_ms."""
        newest = self._newest
        if newest is None or (newest.ttl_ms and self._age_ms(newest) > newest.ttl_ms):
            return None
        return newest

    def age_ms(self) -> float | None:
        """Milliseconds since the newest estimate's capture, aged out or not."""
        return None if self._newest is None else self._age_ms(self._newest)

    def _age_ms(self, estimate: Estimate) -> float:
        return self._ageing.age_ms(estimate, time.monotonic_ns())

    async def receive(self, timeout_s: float | None = None) -> Estimate:
        """Wait for an estimate that was not received before; the newest wins.

        Raises :class:`ProbeTimeout`, with the reason when known, and :class:`IncompatibleProbe`.
        """
        try:
            async with asyncio.timeout(timeout_s), self._news:
                await self._news.wait_for(lambda: self._fatal or self._number > self._taken)
        except TimeoutError:
            raise ProbeTimeout(self._why_nothing(timeout_s or 0)) from None
        if self._fatal:
            raise self._fatal
        assert self._newest is not None
        self.statistics.skipped += self._number - self._taken - 1
        self._taken = self._number
        return self._newest

    def _why_nothing(self, timeout_s: float) -> str:
        if self.connected:
            state = f" (source: {self.health.source_state})" if self.health else ""
            return f"{self.uri}: receive: connected, but no estimate in {timeout_s:g} s{state}"
        return self.last_error or f"{self.uri}: connect: no answer in {timeout_s:g} s"

    async def estimates(self, timeout_s: float | None = None) -> AsyncIterator[Estimate]:
        """Every new estimate, for ever; raises as :meth:`receive`."""
        while True:
            yield await self.receive(timeout_s)

    async def subscribe(self, subscription: Subscription) -> None:
        """Ask for something else, now and after every reconnection."""
        self._subscription = subscription
        if self._writer is not None:
            self._writer.write(encode_subscription(subscription))
            with suppress(OSError):  # the reader sees the loss and reconnects
                await self._writer.drain()

    async def _stay_connected(self) -> None:
        wait_s = BACKOFF_FIRST_S
        while True:
            greeted = self.statistics.connections
            try:
                await self._one_connection()
            except IncompatibleProbe as error:
                await self._announce(fatal=error)
                return
            except (OSError, WireError, ProbeError, TimeoutError) as error:
                self.last_error = _explain(self.uri, error)
            self.statistics.failures += 1
            if self.statistics.connections > greeted:
                wait_s = BACKOFF_FIRST_S
            await asyncio.sleep(wait_s * random.uniform(0.8, 1.2))  # not all clients at once
            wait_s = min(2 * wait_s, BACKOFF_LAST_S)

    async def _one_connection(self) -> None:
        """Connect, subscribe, and read until the connection ends; always ends in an exception."""
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            reader, writer = await self._address.connect()
        self._writer = writer
        try:
            writer.write(encode_subscription(self._subscription))
            decoder = Decoder()
            while True:
                async with asyncio.timeout(self._patience_s()):
                    data = await reader.read(65536)
                if not data:
                    raise ProbeError(f"{self.uri}: receive: the probe closed the connection")
                for message in decoder.feed(data):
                    await self._take(message)
        finally:
            self.hello = self._writer = None
            writer.close()

    def _patience_s(self) -> float | None:
        """Longest silence that is no fault: a greeting comes at once, health periodically."""
        if not self.connected:
            return HELLO_TIMEOUT_S
        period_ms = self._subscription.health_period_ms
        return max(5.0, 5e-3 * period_ms) if period_ms else None

    async def _take(self, message: Message) -> None:
        if isinstance(message, Hello):
            self._greet(message)
        elif not self.connected:
            raise WireError("the first message is no Hello")
        elif isinstance(message, Estimate):
            self._ageing.arrived(message, time.monotonic_ns())
            self._newest = message
            self._number += 1
            self.statistics.estimates += 1
            await self._announce()
        elif isinstance(message, Health):
            self.health = message
        elif isinstance(message, Refusal):
            self.statistics.refusals += 1
            self.last_error = f"{self.uri}: request: {message.text}"

    def _greet(self, hello: Hello) -> None:
        if hello.protocol_major != PROTOCOL_MAJOR:
            raise IncompatibleProbe(
                f"{self.uri}: hello: {hello.software} speaks protocol {hello.protocol_major}, this "
                f"client {PROTOCOL_MAJOR}: install the lightprobe package of the probe's version"
            )
        if not self.connected:
            self.statistics.connections += 1
            self.last_error = None
        self.hello = hello

    async def _announce(self, fatal: ProbeError | None = None) -> None:
        async with self._news:
            self._fatal = fatal
            self._news.notify_all()


def _explain(uri: str, error: Exception) -> str:
    """Object, stage and next step of what ended a connection."""
    if isinstance(error, ProbeError):
        return str(error)
    if isinstance(error, WireError):
        return f"{uri}: receive: {error}: is this a lightprobe?"
    if isinstance(error, ConnectionRefusedError | FileNotFoundError):
        return f"{uri}: connect: nobody listens there: is lightprobed running? (lightprobe doctor)"
    if isinstance(error, PermissionError):
        return f"{uri}: connect: permission denied: are you in the socket's group?"
    if isinstance(error, TimeoutError):
        return f"{uri}: silent for too long: is this a lightprobe, and is the network up?"
    return (
        f"{uri}: connection: {error.strerror or error}"
        if isinstance(error, OSError)
        else str(error)
    )


class Client:
    """A probe's client that blocks; use with `with`. Its methods may be called from any thread."""

    def __init__(self, uri: str = DEFAULT_URI, subscription: Subscription | None = None) -> None:
        """Take an address (raises :class:`ProbeError` when it is none); connects on entering."""
        self._async = AsyncClient(uri, subscription)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name=f"lightprobe {uri}", daemon=True)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_forever()
        self._loop.close()

    def _call(self, work: Coroutine[Any, Any, T]) -> T:
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result()
        except BaseException:
            future.cancel()  # Ctrl-C in the caller's thread
            raise

    def __enter__(self) -> Self:
        """Start connecting, in the background."""
        self._thread.start()
        self._call(self._async.__aenter__())
        return self

    def __exit__(self, *_: object) -> None:
        """Disconnect."""
        self._call(self._async.__aexit__())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

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

    def latest(self) -> Estimate | None:
        """Give the newest estimate at once; None before the first, and when it has aged out."""
        return self._async.latest()

    def age_ms(self) -> float | None:
        """Milliseconds since the newest estimate's capture, aged out or not."""
        return self._async.age_ms()

    def receive(self, timeout_s: float | None = None) -> Estimate:
        """Wait for an estimate that was not received before; see :meth:`AsyncClient.receive`."""
        return self._call(self._async.receive(timeout_s))

    def estimates(self, timeout_s: float | None = None) -> Iterator[Estimate]:
        """Every new estimate, for ever; raises as :meth:`receive`."""
        while True:
            yield self.receive(timeout_s)

    def wait_for(self, condition: Callable[[Client], bool], timeout_s: float) -> bool:
        """Wait until `condition(client)` holds; False when it does not in time."""
        deadline = time.monotonic() + timeout_s
        while not condition(self):
            if time.monotonic() > deadline:
                return False
            time.sleep(0.01)
        return True

    def subscribe(self, subscription: Subscription) -> None:
        """Ask for something else, now and after every reconnection."""
        self._call(self._async.subscribe(subscription))
