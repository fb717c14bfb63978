"""A server of lightprobe.v1 in Python: replays recordings, and publishes what a simulator knows.

It is no daemon: it sends one stream of estimates, and of reflection maps if there are any, to
every client, cut to what the client has subscribed to as far as the stream holds it. TCP and
WebSocket, on this machine only.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from google.protobuf.message import DecodeError
from lightprobe_proto import lightprobe_pb2 as pb

from lightprobe import replayed_map, sh
from lightprobe.errors import LightprobeError
from lightprobe.estimate import LightFlag
from lightprobe.wire import PROTOCOL_MAJOR, Decoder, WireError, delimit

_PROTOCOL = "lightprobe.v1"
_LOOPBACK = ("127.0.0.1", "::1", "localhost")
_MINOR = 2
_MAP_RATE_HZ = 5.0  # where a subscription names none
#: By the order that SH are cut to, what moving ambient light through the room is off at least, 1
#: sigma (docs/users/conventions.md, "Ambient light at a place"): below order 2 it is no better than
#: leaving it.
AMBIENT_MOVED_PERMILLE_PER_M = (100, 100, 33, 33)
#: What ends a connection without a word: what is no request, and this program's end.
_ENDS = (WireError, DecodeError, asyncio.CancelledError)


@dataclass(eq=False)
class _Client:
    """One connection: what it wants, and what waits for it (the newest estimate and map alone)."""

    wish: Any = field(default_factory=pb.Subscription)
    newest: Any = None
    map: Any = None  # pb.ReflectionMap as recorded, and the estimate that it belongs to
    map_due_s: float = 0.0  # no map before; of time.monotonic()
    news: asyncio.Event = field(default_factory=asyncio.Event)


class ProbeServer:
    """Clients of one stream. Use within one event loop."""

    def __init__(self, name: str, software: str, map_size: int = 0) -> None:
        """`name`: of the probe, as Hello tells it; `map_size`: of reflection maps; 0: none."""
        self._hello = pb.Hello(
            protocol_major=PROTOCOL_MAJOR, protocol_minor=_MINOR, software=software[:39],
            boot_id=secrets.randbits(32), source="replay", max_sh_order=4, max_lights=8,
            clock="CLOCK_REALTIME", name=name[:60],
            max_reflection_map_size=map_size,
        )  # fmt: skip
        self._clients: set[_Client] = set()
        self._last: Any = None
        self._sequence = 0

    def publish(self, estimate: Any) -> None:
        """Send a pb.Estimate to all clients, as of now; it gets this server's sequence and boot."""
        self._sequence += 1
        estimate.sequence = self._sequence
        estimate.boot_id = self._hello.boot_id
        self._last = estimate
        for client in self._clients:
            client.newest = estimate
            client.news.set()

    def publish_map(self, recorded: Any) -> None:
        """Send a pb.ReflectionMap of AMBIENT, which belongs to the estimate published last."""
        if self._last is None:
            return
        for name in ("sequence", "boot_id", "capture_time_unix_ns"):
            setattr(recorded, name, getattr(self._last, name))
        now_s = time.monotonic()
        for client in self._clients:
            wish = client.wish.reflection_map
            if wish.size and now_s >= client.map_due_s:
                client.map_due_s = now_s + 1 / (wish.rate_hz or _MAP_RATE_HZ)
                client.map = (recorded, self._last)
                client.news.set()

    @contextlib.asynccontextmanager
    async def listening(self, uri: str) -> AsyncIterator[str]:
        """Listen on `tcp:HOST:PORT` or `ws:HOST:PORT` of this machine; gives the clients' address.

        Raises :class:`LightprobeError`.
        """
        scheme, _, rest = uri.partition(":")
        parts = urlsplit(f"//{rest}")
        try:
            host, port = parts.hostname or "", parts.port
        except ValueError:
            host, port = "", None
        if scheme not in ("tcp", "ws") or port is None or host not in _LOOPBACK:
            raise LightprobeError(
                f"{uri}: listen: expected tcp:127.0.0.1:PORT or ws:127.0.0.1:PORT: this is for "
                "this machine only"
            )
        shown = f"[{host}]" if ":" in host else host
        try:
            if scheme == "tcp":
                server = await asyncio.start_server(self._serve_stream, host, port)
                async with server:
                    yield f"tcp:{shown}:{server.sockets[0].getsockname()[1]}"
            else:
                from websockets.asyncio.server import serve

                async with serve(
                    self._serve_web, host, port, subprotocols=[_PROTOCOL],  # type: ignore[list-item]
                    process_request=_own_page_only, max_size=256, compression=None,
                ) as web:  # fmt: skip
                    yield f"ws://{shown}:{next(iter(web.sockets)).getsockname()[1]}/"
        except OSError as error:
            raise LightprobeError(
                f"{uri}: listen: {error.strerror or error}: choose another port"
            ) from None

    @contextlib.contextmanager
    def _client(self) -> Any:
        client = _Client()
        client.newest = self._last
        if self._last is not None:
            client.news.set()
        self._clients.add(client)
        try:
            yield client
        finally:
            self._clients.discard(client)

    def _greeting(self) -> bytes:
        return bytes(pb.FromProbe(hello=self._hello).SerializeToString())

    async def _serve_stream(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        async def read() -> None:
            decoder = Decoder(max_bytes=256)
            while data := await reader.read(1024):
                for payload in decoder.payloads(data):
                    self._subscribe(client, payload)

        async def write(message: bytes) -> None:
            writer.write(delimit(message))
            await writer.drain()

        with self._client() as client, contextlib.suppress(*_ENDS, OSError):
            await self._talk(client, read, write)
        writer.close()

    async def _serve_web(self, connection: Any) -> None:
        async def read() -> None:
            async for message in connection:
                if isinstance(message, str):
                    break
                self._subscribe(client, message)

        from websockets.exceptions import ConnectionClosed

        with self._client() as client, contextlib.suppress(*_ENDS, ConnectionClosed):
            await self._talk(client, read, connection.send)

    async def _talk(self, client: _Client, read: Any, write: Any) -> None:
        """Until the client goes, or says what is no request."""

        async def send() -> None:
            await write(self._greeting())
            while True:
                await client.news.wait()
                client.news.clear()
                if client.newest is not None:
                    estimate, client.newest = cut(client.newest, client.wish), None
                    await write(pb.FromProbe(estimate=estimate).SerializeToString())
                if client.map is not None:
                    (recorded, estimate), client.map = client.map, None
                    added = not_listed(estimate, client.wish)
                    reflection_map = replayed_map.answer(recorded, client.wish, added)
                    await write(pb.FromProbe(reflection_map=reflection_map).SerializeToString())

        sending = asyncio.create_task(send())
        try:
            await read()
        finally:
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError, Exception):
                await sending

    def _subscribe(self, client: _Client, payload: bytes) -> None:
        request = pb.FromClient.FromString(payload)
        if request.WhichOneof("message") != "subscribe":
            return  # a ping, a pose, what only a probe can do: the wish stays
        client.wish = request.subscribe
        if self._last is not None:
            client.newest = self._last
            client.news.set()


def _own_page_only(connection: Any, request: Any) -> Any:
    """Refuse pages of the network; pages of this machine, and programs, may connect."""
    origin = request.headers.get("Origin")
    if origin is None or urlsplit(origin).hostname in _LOOPBACK:
        return None
    return connection.respond(403, "pages of other machines may not read this\n")


def _listed(estimate: Any, wish: Any) -> list[Any]:
    most = wish.max_lights if wish.HasField("max_lights") else 4
    return [
        light
        for light in estimate.lights
        if wish.area_lights or not light.flags & LightFlag.EXTENDED
    ][:most]


def not_listed(estimate: Any, wish: Any) -> list[Any]:
    """Lamps of a pb.Estimate whose light a reflection map is to hold, by a subscription."""
    if wish.reflection_map.kind != pb.SphericalHarmonics.AMBIENT:
        return list(estimate.lights)
    listed = _listed(estimate, wish)
    return [light for light in estimate.lights if light not in listed]


def cut(estimate: Any, wish: Any) -> Any:
    """Give the part of a pb.Estimate that a subscription asks for.

    Lamps beyond its number, and area lights and KEY that it does not want, are put into the SH, as
    points; orders above its own are left out; TOTAL puts all lamps into the SH. What the estimate
    does not hold cannot be given.
    """
    part = pb.Estimate()
    part.CopyFrom(estimate)
    part.subscription = wish.number
    total = wish.kind == pb.SphericalHarmonics.TOTAL and part.sh.kind != pb.SphericalHarmonics.TOTAL
    order = min(part.sh.order, wish.sh_order if wish.HasField("sh_order") else 2)
    listed = _listed(part, wish)
    if part.sh.kind != pb.SphericalHarmonics.TOTAL:
        coefficients = np.array(part.sh.coefficients).reshape(-1, 3)
        dropped = [light for light in part.lights if light not in listed]
        if part.HasField("key") and (total or not wish.key_light):
            dropped.append(part.key)
        for light in [*dropped, *listed] if total else dropped:
            shape = sh.lamp(np.array(light.direction), part.sh.order)
            coefficients += shape[:, None] * np.array(light.irradiance)
        part.sh.coefficients[:] = coefficients.ravel().tolist()
    if total:
        part.sh.kind = pb.SphericalHarmonics.TOTAL
    del part.lights[:]
    part.lights.extend(listed)
    if not wish.key_light:
        part.ClearField("key")
    del part.sh.coefficients[3 * (order + 1) ** 2 :]
    if part.HasField("room"):
        least = AMBIENT_MOVED_PERMILLE_PER_M[order] if order < part.sh.order else 0
        part.room.error_permille_per_m = max(part.room.error_permille_per_m, least)
    part.sh.order = order
    part.ClearField("predicted_error_permille")  # it was another model's
    return part


def stamp_now(estimate: Any, delay_us: int = 0) -> None:
    """Make an estimate one of now: captured `delay_us` ago."""
    estimate.capture_time_unix_ns = time.time_ns() - 1000 * delay_us
    estimate.send_delay_us = delay_us
