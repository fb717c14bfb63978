"""A probe's client for asyncio; :mod:`lightprobe.client` says how clients behave."""

from __future__ import annotations

import asyncio
import logging
import math
import random
import socket
import ssl
import time
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Never, Self, TypeVar

from numpy.typing import ArrayLike

from lightprobe.address import Address, Writer
from lightprobe.clock_offset import ClockOffset
from lightprobe.drained import Drained
from lightprobe.errors import IncompatibleProbe, MissingPackage, ProbeError, ProbeTimeout
from lightprobe.estimate import (
    Estimate,
    Health,
    Hello,
    PolarizationMap,
    Pong,
    Refusal,
    StillsAsked,
    SweepStarted,
)
from lightprobe.mqtt import MqttStream
from lightprobe.reflection_map import ReflectionMap
from lightprobe.wire import (
    MINOR_WITH_NUMBERS,
    MINOR_WITH_PINGS,
    MINOR_WITH_POLARIZATION,
    MINOR_WITH_STILLS,
    PROTOCOL_MAJOR,
    TOKEN_REFUSED,
    Decoder,
    Message,
    Subscription,
    WireError,
    decode,
    encode_get_polarization_map,
    encode_ping,
    encode_pose,
    encode_start_sweep,
    encode_subscription,
    encode_take_stills,
)

DEFAULT_URI = "tcp:127.0.0.1:7700"
#: As in every client (docs/users/clients.md): a phone on Wi-Fi with TLS takes a while.
CONNECT_TIMEOUT_S = HELLO_TIMEOUT_S = 5.0
LEAST_PATIENCE_S = 5.0
BACKOFF_FIRST_S, BACKOFF_LAST_S = 0.1, 5.0
#: After a refused token. The daemon forgets a wrong one in a minute; several of an address bar all.
TOKEN_BACKOFF_S = 80.0
#: How often the probe's clock is compared with ours.
PING_PERIOD_S = 1.0
#: A wait that lasts longer than this says what it waits for.
SAY_AFTER_S = 2.0

_UNHEARD = (
    "a probe hears nothing over MQTT: what comes is what the keys of lightprobed's --publish say"
)

T = TypeVar("T")
#: Gets one line on what a client waits for.
OnWaiting = Callable[[str], None]

_log = logging.getLogger("lightprobe")


@dataclass
class Statistics:
    """Counters of one client since its start."""

    connections: int = 0
    failures: int = 0  # connections refused, lost, or closed by us for nonsense
    estimates: int = 0
    skipped: int = 0  # superseded before the user took them
    not_ours: int = 0  # made for another subscription: dropped
    refusals: int = 0


class Patience:
    """One wait for an estimate, cut into pieces; after each it says why there is none."""

    def __init__(self, timeout_s: float | None, on_waiting: OnWaiting | None) -> None:
        """Begin to wait; None: for ever."""
        if timeout_s is not None and not timeout_s >= 0:  # NaN too
            raise ValueError(
                f"receive: timeout_s = {timeout_s}: expected seconds, 0 or more, or None"
            )
        self._timeout_s = math.inf if timeout_s is None else timeout_s
        self._deadline_s = time.monotonic() + self._timeout_s
        self._say = on_waiting or _log.warning
        self._said: str | None = None

    def piece_s(self) -> float:
        """How long to wait before :meth:`nothing_came` is called."""
        return max(0.0, min(SAY_AFTER_S, self._deadline_s - time.monotonic()))

    def nothing_came(self, why: str) -> None:
        """Say why, once for each reason; raises :class:`ProbeTimeout` when the time is over."""
        if time.monotonic() >= self._deadline_s:
            raise ProbeTimeout(f"{why} (waited {self._timeout_s:g} s)")
        if why != self._said:
            self._say(f"{why}: waiting")
        self._said = why


class _CallerError(Exception):
    """What a function of the caller has raised: passed on to it, and no reason to reconnect."""

    def __init__(self, error: Exception) -> None:
        super().__init__(repr(error))
        self.error = error


class AsyncClient:
    """A probe's client for asyncio; use with `async with`. Not for several event loops at once."""

    def __init__(
        self,
        uri: str = DEFAULT_URI,
        subscription: Subscription | None = None,
        on_payload: Callable[[bytes], None] | None = None,
    ) -> None:
        """Take an address (raises :class:`ProbeError` when it is none); connects on entering.

        `on_payload` gets every message as it came, without its length: for recordings. What it
        raises ends the client; :meth:`receive` and the other calls that wait raise it, unchanged.
        """
        self.hello: Hello | None = None  # of the connection that is open; None: not connected
        self.health: Health | None = None
        self.last_error: str | None = None
        self.statistics = Statistics()
        self._address = Address.parse(uri)
        self.uri = self._address.without_secrets(uri)
        self._on_payload = on_payload
        if subscription is not None and self._address.is_read_only:
            _log.warning("%s: subscription: not sent: %s", self.uri, _UNHEARD)
        self._subscription = subscription or Subscription()
        self._subscription_number = 0 if self._address.is_read_only else 1
        self._newest: Estimate | None = None
        self._reflection_map: ReflectionMap | None = None
        self._received = self._taken = 0  # counted since the start
        self._probe_clock = ClockOffset()
        self._drained = Drained()
        self._pong_time_ns: int | None = None  # when the last answer to a ping came
        self._final: Exception | None = None
        self._answer: PolarizationMap | SweepStarted | StillsAsked | None = None
        self._refusal: str | None = None  # of this connection
        self._is_token_refused = False  # likewise
        self._is_retained = False  # what is read now: a broker has kept it
        self._writer: Writer | None = None
        self._news = asyncio.Condition()
        self._task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        """Start connecting, in the background. May be entered again after it was left."""
        if self._task is not None:
            raise ProbeError(
                f"{self.uri}: client: already in use: create one client for each `with` block"
            )
        self._final = None
        self._news = asyncio.Condition()  # of this event loop
        self._task = asyncio.create_task(self._stay_connected())
        return self

    async def __aexit__(self, *_: object) -> None:
        """Disconnect; whoever still waits for an estimate gets a :class:`ProbeError`."""
        if self._task is not None:
            self._task.cancel()
            with suppress(asyncio.CancelledError):
                await self._task
            self._task = None
            await self._announce(final=self.not_running())

    @property
    def connected(self) -> bool:
        """True between the probe's Hello and the end of the connection."""
        return self.hello is not None

    def latest(self) -> Estimate | None:
        """Give the newest estimate; None before the first, and when it has outlived its ttl_ms.

        That is judged by what has been read: after a pause of the program, the one before the pause
        remains until what came meanwhile is read. What was too old when it was sent is so here.
        """
        newest = self._newest
        if newest is None:
            return None
        age_ms = max(self._age_ms(newest, self._drained.until_ns), newest.send_delay_us / 1e3)
        return None if newest.ttl_ms and age_ms > newest.ttl_ms else newest

    @property
    def subscription(self) -> Subscription:
        """What was asked for last."""
        return self._subscription

    @property
    def reflection_map(self) -> ReflectionMap | None:
        """Give the newest reflection map, however old; None before the first."""
        return self._reflection_map

    def age_ms(self) -> float | None:
        """Milliseconds since the newest estimate's capture, aged out or not."""
        return None if self._newest is None else self._age_ms(self._newest, time.monotonic_ns())

    def _age_ms(self, estimate: Estimate, at_ns: int) -> float:
        return (at_ns - self._probe_clock.ours_ns(estimate.capture_time_unix_ns)) / 1e6

    async def receive(
        self, timeout_s: float | None = None, on_waiting: OnWaiting | None = None
    ) -> Estimate:
        """Wait for an estimate that was not received before; the newest wins.

        When nothing has come for two seconds, and again when the reason changes, `on_waiting` gets
        a line that says what is waited for; by default it is logged as a warning of the logger
        "lightprobe". Raises :class:`ProbeTimeout` with the reason when `timeout_s` is over (0: only
        what is there; None: never), :class:`IncompatibleProbe`, and :class:`ProbeError` outside
        `async with`.
        """
        patience = Patience(timeout_s, on_waiting)
        while (estimate := await self._next(patience.piece_s())) is None:
            patience.nothing_came(self._why_nothing())
        return estimate

    async def _next(self, timeout_s: float) -> Estimate | None:
        """Wait for the next estimate; None when the time is over."""
        if self._task is None:
            raise self.not_running()
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s), self._news:
                await self._news.wait_for(lambda: self._final or self._received > self._taken)
        if self._final:
            raise self._final
        if self._received == self._taken:
            return None
        self.statistics.skipped += self._received - self._taken - 1
        self._taken = self._received
        return self._newest

    def _why_nothing(self) -> str:
        if self.connected:
            state = f" (source: {self.health.source_state})" if self.health else ""
            return f"{self.uri}: receive: connected, but no estimate{state}"
        return self.last_error or f"{self.uri}: connect: no answer"

    def not_running(self) -> ProbeError:
        """Give the error of who asks a client that is not entered."""
        return ProbeError(
            f"{self.uri}: client: not running: use it within `with Client(…) as probe:`"
        )

    async def estimates(
        self, timeout_s: float | None = None, on_waiting: OnWaiting | None = None
    ) -> AsyncIterator[Estimate]:
        """Every new estimate, for ever; says what it waits for and raises as :meth:`receive`."""
        while True:
            yield await self.receive(timeout_s, on_waiting)

    async def subscribe(self, subscription: Subscription) -> None:
        """Ask for something else, now and after every reconnection.

        :meth:`receive` gives no estimate of the former subscription from now on; :meth:`latest`
        gives the last of them until the first new one comes.
        """
        self._must_be_heard("subscribe")
        self._subscription = subscription
        self._subscription_number += 1
        self._taken = self._received
        if self._writer is not None:
            self._writer.write(self._request())
            with suppress(OSError):  # the reader sees the loss and reconnects
                await self._writer.drain()

    def send_pose(
        self,
        orientation: ArrayLike,
        time_ns: int | None = None,
        sigma_deg: float | None = None,
        position_m: ArrayLike | None = None,
        position_sigma_m: float | None = None,
    ) -> bool:
        """Say how the head is turned that the probe is mounted on; False: not connected.

        `orientation`: unit quaternion x, y, z, w; turns the head's frame (+X right, +Y up, −Z
        forward) into the app's world. `time_ns`: when it was so, of time.monotonic_ns(); None: now.
        `sigma_deg`: 1 sigma about each axis; None: 0.2. `position_m` (3,): where the head is in
        that world, `position_sigma_m`: 1 sigma along each axis, None: 0.005; with it lamps get
        distances as the head moves. The daemon needs --orientation=client, else it refuses
        (`last_error`). Raises :class:`PoseError` for what is no rotation or no place.
        """
        self._must_be_heard("pose")
        now_ns = time.monotonic_ns()
        when_ns = now_ns if time_ns is None else time_ns
        request = encode_pose(orientation, when_ns, sigma_deg, position_m, position_sigma_m)
        if self._writer is None or not self.connected:
            return False
        if not self._knows_pings():
            raise ProbeError(
                f"{self.uri}: pose: this probe is older than protocol 1.{MINOR_WITH_PINGS}: "
                "install a newer lightprobed"
            )
        self._writer.write(request)
        return True

    async def polarization(self, timeout_s: float = 10.0) -> PolarizationMap:
        """Ask for a coarse picture of how the light is polarized, and wait for it.

        Raises :class:`ProbeError` with the probe's words where it gives none (the daemon needs
        --publish-polarization), :class:`ProbeTimeout`. One such request at a time.
        """
        return await self._ask(encode_get_polarization_map(), PolarizationMap, timeout_s)

    async def sweep(self, timeout_s: float = 60.0) -> int:
        """Have the polarizer visit all its angles, and wait until it has; gives Wheel.sweeps.

        Raises :class:`ProbeError` with the probe's words where it cannot (no wheel, fixed angle),
        :class:`ProbeTimeout`. The subscription must ask for health.
        """
        if not self._subscription.health_period_ms:
            raise ProbeError(f"{self.uri}: sweep: only health tells its end: health_period_ms > 0")
        deadline_s = time.monotonic() + timeout_s
        started = await self._ask(encode_start_sweep(), SweepStarted, timeout_s)
        over = await self._until(lambda: self._sweeps() >= started.done_at, deadline_s)
        if not over:
            raise ProbeTimeout(
                f"{self.uri}: sweep: not over after {timeout_s:g} s: does the wheel turn? "
                "(lightprobe doctor)"
            )
        return self._sweeps()

    async def take_stills(self, timeout_s: float = 10.0) -> int:
        """Have cameras for stills take a set now, and wait until that is under way; gives how many.

        A set counts some seconds later, when it has come. Raises :class:`ProbeError` with the
        probe's words where there is no such camera, or none is ready; :class:`ProbeTimeout`.
        """
        asked = await self._ask(encode_take_stills(), StillsAsked, timeout_s, MINOR_WITH_STILLS)
        return asked.cameras

    def _sweeps(self) -> int:
        return self.health.wheel.sweeps if self.health and self.health.wheel else 0

    async def _until(self, condition: Callable[[], bool], deadline_s: float) -> bool:
        """Wait for news until a condition holds; False when it does not in time."""
        if self._task is None:
            raise self.not_running()
        with suppress(TimeoutError):
            async with asyncio.timeout(max(0.0, deadline_s - time.monotonic())), self._news:
                await self._news.wait_for(lambda: self._final or condition())
        if self._final:
            raise self._final
        return condition()

    async def _ask(
        self,
        request: bytes,
        kind: type[T],
        timeout_s: float,
        least_minor: int = MINOR_WITH_POLARIZATION,
    ) -> T:
        """Send a request and wait for its answer; probes of an older protocol have none."""
        self._must_be_heard("request")
        deadline_s = time.monotonic() + timeout_s
        if not await self._until(lambda: self.connected, deadline_s) or self._writer is None:
            raise ProbeTimeout(f"{self._why_nothing()} (waited {timeout_s:g} s)")
        if self.hello is None or self.hello.protocol_minor < least_minor:
            raise ProbeError(
                f"{self.uri}: request: this probe is older than protocol 1.{least_minor}: "
                "install a newer lightprobed"
            )
        self._answer = self._refusal = None
        self._writer.write(request)
        await self._until(
            lambda: isinstance(self._answer, kind) or self._refusal is not None, deadline_s
        )
        if self._refusal is not None:
            raise ProbeError(self._refusal)
        if not isinstance(self._answer, kind):
            raise ProbeTimeout(f"{self._why_nothing()} (waited {timeout_s:g} s for an answer)")
        return self._answer

    def _must_be_heard(self, what: str) -> None:
        if self._address.is_read_only:
            raise ProbeError(
                f"{self.uri}: {what}: {_UNHEARD}; or connect to the probe itself (tcp:, wss:)"
            )

    @property
    def clock_sigma_s(self) -> float:
        """1 sigma of how far the probe's clock is off ours; infinite before the first ping."""
        return self._probe_clock.sigma_s

    def _knows_pings(self) -> bool:
        return self.hello is not None and self.hello.protocol_minor >= MINOR_WITH_PINGS

    async def _keep_pinging(self, writer: Writer) -> None:
        """Ping for as long as the connection lasts, from the Hello on."""
        while True:
            if self._knows_pings():
                writer.write(encode_ping(time.monotonic_ns(), self._pong_time_ns))
                self._pong_time_ns = None
                await asyncio.sleep(PING_PERIOD_S)
            else:
                async with self._news:
                    await self._news.wait_for(lambda: self.hello is not None)
                if not self._knows_pings():
                    return

    def _request(self) -> bytes:
        return encode_subscription(self._subscription, self._subscription_number)

    async def _stay_connected(self) -> None:
        turns = asyncio.create_task(self._drained.note_turns())
        try:
            await self._reconnect_for_ever()
        except (IncompatibleProbe, MissingPackage) as error:
            await self._announce(final=error)
        except _CallerError as error:
            await self._announce(final=error.error)
        except Exception as error:
            _log.exception("%s: client: unexpected error", self.uri)
            await self._announce(
                final=ProbeError(f"{self.uri}: client: unexpected {error!r}: please report it")
            )
        finally:
            turns.cancel()

    async def _reconnect_for_ever(self) -> None:
        wait_s = BACKOFF_FIRST_S
        while True:
            greeted = self.statistics.connections
            try:
                await self._one_connection()
            except (IncompatibleProbe, MissingPackage):
                raise
            except (OSError, WireError, ProbeError, TimeoutError) as error:
                self.last_error = self._refusal or _explain(self.uri, error)
            self.statistics.failures += 1
            if self.statistics.connections > greeted:
                wait_s = BACKOFF_FIRST_S
            pause_s = TOKEN_BACKOFF_S if self._is_token_refused else wait_s
            await asyncio.sleep(pause_s * random.uniform(0.8, 1.2))  # not all clients at once
            wait_s = min(2 * wait_s, BACKOFF_LAST_S)

    async def _one_connection(self) -> Never:
        """Connect, subscribe, and read until the connection ends; always ends in an exception."""
        self._refusal, self._is_token_refused = None, False
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            reader, writer = await self._address.connect()
        self._writer = writer
        pings = asyncio.create_task(self._keep_pinging(writer))
        try:
            writer.write(self._request())
            decoder = Decoder()
            while True:
                data = await self._drained.within(self._patience_s(), lambda: reader.read(65536))
                if not data:
                    raise ProbeError(f"{self.uri}: receive: the probe closed the connection")
                self._is_retained = isinstance(reader, MqttStream) and reader.retained
                for payload in decoder.payloads(data):
                    message = decode(payload)
                    self._hand_out(payload)
                    if message is not None:
                        await self._take(message)
        finally:
            pings.cancel()
            self.hello = self._writer = self._pong_time_ns = None
            writer.close()

    def _hand_out(self, payload: bytes) -> None:
        """Give a message to the caller's function, whose errors are not the network's."""
        if self._on_payload is None:
            return
        try:
            self._on_payload(payload)
        except Exception as error:
            raise _CallerError(error) from error

    def _patience_s(self) -> float | None:
        """Longest silence that is no fault: a greeting comes at once, health periodically."""
        if not self.connected:
            return HELLO_TIMEOUT_S
        if self._address.is_read_only:  # the broker tells its loss
            return None
        period_ms = self._subscription.health_period_ms
        return max(LEAST_PATIENCE_S, 5e-3 * period_ms) if period_ms else None

    async def _take(self, message: Message) -> None:
        if isinstance(message, Hello):
            self._greet(message)
            await self._announce()
        elif isinstance(message, Refusal):  # comes in place of a Hello when the probe is full
            self.statistics.refusals += 1
            self._refusal = self.last_error = f"{self.uri}: request: {message.text}"
            self._is_token_refused = not self.connected and message.code == TOKEN_REFUSED
            await self._announce()
        elif not self.connected:
            raise WireError("the first message is not a Hello")
        elif isinstance(message, Estimate):
            await self._take_estimate(message)
        elif isinstance(message, ReflectionMap):
            if message.subscription == self._subscription_number:
                self._reflection_map = message
        elif isinstance(message, Health):
            self.health = message
            await self._announce()
        elif isinstance(message, PolarizationMap | SweepStarted | StillsAsked):
            self._answer = message
            await self._announce()
        elif isinstance(message, Pong):
            self._pong_time_ns = time.monotonic_ns()
            self._probe_clock.was_there(message.ping_time_ns, message.received_unix_ns)
            self._probe_clock.arrived(message.sent_unix_ns, self._pong_time_ns)

    async def _take_estimate(self, estimate: Estimate) -> None:
        assert self.hello is not None
        numbered = self.hello.protocol_minor >= MINOR_WITH_NUMBERS
        if numbered and estimate.subscription != self._subscription_number:
            self.statistics.not_ours += 1
            return
        if not self._is_retained:
            self._probe_clock.arrived(estimate.send_time_unix_ns, time.monotonic_ns())
        self._newest = estimate
        self._received += 1
        self.statistics.estimates += 1
        await self._announce()

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

    async def _announce(self, final: Exception | None = None) -> None:
        async with self._news:
            self._final = final
            self._news.notify_all()


def _explain(uri: str, error: Exception) -> str:
    """Object, stage and next step of what ended a connection."""
    if isinstance(error, ProbeError):
        return str(error)
    if isinstance(error, WireError):
        return f"{uri}: receive: {error}: is this a lightprobe?"
    if isinstance(error, ssl.SSLCertVerificationError):
        return (
            f"{uri}: connect: no authority vouches for its certificate: use the whole address that "
            "`lightprobe pair` prints, with sha256="
        )
    if isinstance(error, ssl.SSLError):
        return f"{uri}: connect: no TLS there ({error.reason}): is it ws:// instead of wss://?"
    if isinstance(error, ConnectionRefusedError | FileNotFoundError):
        return f"{uri}: connect: nobody listens there: is lightprobed running? (lightprobe doctor)"
    if isinstance(error, socket.gaierror):
        return f"{uri}: connect: {error.strerror}: is the host's name right?"
    if isinstance(error, PermissionError):
        return f"{uri}: connect: permission denied: are you in the socket's group?"
    if isinstance(error, TimeoutError):
        return f"{uri}: silent for too long: is this a lightprobe, and is the network up?"
    return (
        f"{uri}: connection: {error.strerror or error}"
        if isinstance(error, OSError)
        else str(error)
    )
