"""How connections come to the set-up page: so many at once, and not for long without the token.

A connection has a place from the moment it is accepted, before its TLS handshake. Until a request
with the owner's token has come over it, it leaves for newcomers (`places`), and at the latest after
a while: whatever it does, or does not do, in its handshake, its first request, or between requests.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import ssl

from aiohttp import web

from lightprobe.places import Place, Places, peer_of

#: Below the 1024 files that a process may have open by default. A browser opens six connections.
MOST, MOST_OF_PEER, MOST_PROVEN = 192, 64, 32
HANDSHAKE_S = 10.0
#: From accepting a connection to the owner's token.
UNPROVEN_S = 15.0
#: Between two requests.
KEEP_ALIVE_S = 15.0
_ACCEPTED_AT_ONCE = 64
#: When the system has no more files.
_PAUSE_S = 0.1


class Connection(asyncio.Protocol):
    """Between a transport and the page's server; it knows when the connection ends."""

    def __init__(self, inner: asyncio.Protocol, guest: Guest) -> None:
        """`inner`: of aiohttp."""
        self._inner, self._guest = inner, guest

    def prove(self) -> None:
        """The owner's token has come over it."""
        self._guest.prove()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Its handshake is done."""
        assert isinstance(transport, asyncio.Transport)
        self._guest.transport = transport
        self._inner.connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """It has ended."""
        self._guest.end()
        self._inner.connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Pass on what has come."""
        self._inner.data_received(data)

    def eof_received(self) -> bool | None:
        """Pass on that nothing more comes."""
        return self._inner.eof_received()

    def pause_writing(self) -> None:
        """Pass on that too much waits to be sent."""
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        """Pass on that there is room again."""
        self._inner.resume_writing()


class Guest:
    """One accepted socket until its end."""

    def __init__(self, accepted: socket.socket, door: Door) -> None:
        """Take it; `admit` goes on."""
        self.transport: asyncio.Transport | None = None
        self._accepted, self._door = accepted, door
        self._place: Place | None = None
        self._work: asyncio.Task[None] | None = None
        self._limit: asyncio.TimerHandle | None = None

    def admit(self, peer: str) -> None:
        """Give it a place, a time limit, and its handshake."""
        self._place = self._door.places.enter(peer, self.close)
        self._limit = asyncio.get_running_loop().call_later(UNPROVEN_S, self.close)
        self._work = asyncio.create_task(self._connect())

    async def _connect(self) -> None:
        loop, tls = asyncio.get_running_loop(), self._door.tls
        try:
            await loop.connect_accepted_socket(
                lambda: Connection(self._door.inner(), self), self._accepted, ssl=tls,
                ssl_handshake_timeout=HANDSHAKE_S if tls else None,
                ssl_shutdown_timeout=HANDSHAKE_S if tls else None,
            )  # fmt: skip
        except OSError:  # no TLS, or it had to leave; asyncio has closed it
            self.end()

    def prove(self) -> None:
        """It may stay."""
        if self._limit:
            self._limit.cancel()
        if self._place:
            self._door.places.prove(self._place)

    def close(self) -> None:
        """End it at once, in whatever state it is."""
        if self.transport:
            self.transport.abort()
        else:  # asyncio owns the socket; its handshake fails of this
            with contextlib.suppress(OSError):
                self._accepted.shutdown(socket.SHUT_RDWR)
        self.end()

    def end(self) -> None:
        """Give the place back."""
        if self._limit:
            self._limit.cancel()
        if self._place:
            self._door.places.exit(self._place)
        self._door.guests.discard(self)


class Door(web.BaseSite):
    """Accepts connections for a page's server."""

    __slots__ = ("_listening", "guests", "places", "tls")

    def __init__(
        self, runner: web.AppRunner, listening: socket.socket, tls: ssl.SSLContext | None
    ) -> None:
        """`tls`: None for a page in clear."""
        super().__init__(runner, ssl_context=tls)
        self._listening, self.tls = listening, tls
        self.places = Places(MOST, MOST_OF_PEER, MOST_PROVEN)
        self.guests: set[Guest] = set()

    @property
    def name(self) -> str:
        """Where it listens."""
        return str(self._listening.getsockname())

    def inner(self) -> asyncio.Protocol:
        """Give aiohttp's end of a new connection."""
        server = self._runner.server
        assert server is not None
        return server()

    async def start(self) -> None:
        """Accept from now on."""
        await super().start()
        self._listening.listen(socket.SOMAXCONN)
        self._listening.setblocking(False)
        self._watch()

    async def stop(self) -> None:
        """Accept no more; who has not shown the token by now goes."""
        asyncio.get_running_loop().remove_reader(self._listening)
        self._listening.close()
        for guest in list(self.guests):
            if guest.transport is None:
                guest.close()
        await super().stop()

    def _watch(self) -> None:
        if self._listening.fileno() >= 0:
            asyncio.get_running_loop().add_reader(self._listening, self._accept)

    def _accept(self) -> None:
        """Accept those that wait, some at a time, so that others have their turn."""
        for _ in range(_ACCEPTED_AT_ONCE):
            try:
                accepted, address = self._listening.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError:  # no more files: this listener would be ready all the time
                loop = asyncio.get_running_loop()
                loop.remove_reader(self._listening)
                loop.call_later(_PAUSE_S, self._watch)
                return
            accepted.setblocking(False)
            guest = Guest(accepted, self)
            self.guests.add(guest)
            guest.admit(peer_of(str(address[0])))


def prove(request: web.BaseRequest) -> None:
    """Note that this request has shown the owner's token."""
    connection = request.transport.get_protocol() if request.transport else None
    if isinstance(connection, Connection):
        connection.prove()


def serve(app: web.Application, listening: socket.socket, tls: ssl.SSLContext | None) -> None:
    """Serve until SIGINT or SIGTERM comes."""
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_serve(app, listening, tls))


async def _serve(
    app: web.Application, listening: socket.socket, tls: ssl.SSLContext | None
) -> None:
    loop, ends = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ends.set)
    runner = web.AppRunner(app, access_log=None, keepalive_timeout=KEEP_ALIVE_S)
    await runner.setup()
    try:
        await Door(runner, listening, tls).start()
        await ends.wait()
    finally:
        await runner.cleanup()
