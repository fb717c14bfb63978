"""Where a probe listens, and the connection to it."""

from __future__ import annotations

import asyncio
import os
import socket
from dataclasses import dataclass

from lightprobe.errors import ProbeError
from lightprobe.mqtt import BrokerAddress, MqttStream
from lightprobe.websocket import WebAddress, WebSocketStream, no_wildcard

#: Python has none on Windows.
HAS_UNIX_SOCKETS = hasattr(socket, "AF_UNIX") and hasattr(asyncio, "open_unix_connection")
_LONGEST_PATH_BYTES = 107  # of a Unix socket

Reader = asyncio.StreamReader | WebSocketStream | MqttStream
Writer = asyncio.StreamWriter | WebSocketStream | MqttStream


@dataclass(frozen=True)
class Address:
    """Where a probe listens: `tcp:HOST:PORT` (IPv6 in brackets), `unix:PATH`, or a web address.

    Or where it publishes: `mqtt://HOST/TOPIC`, `mqtts://HOST/TOPIC`.

    A web address is `ws://HOST:PORT/` (`ws:HOST:PORT`, as the daemon prints it, is the same), or
    `wss:` with token and fingerprint, or that of the page.
    """

    host: str | None
    port: int
    path: str | None
    web: WebAddress | None = None
    broker: BrokerAddress | None = None

    @classmethod
    def parse(cls, uri: str) -> Address:
        """Read an address; raises :class:`ProbeError` that says what is wrong with it."""
        scheme, _, rest = uri.partition(":")
        if scheme == "unix" and rest:
            if len(os.fsencode(rest)) > _LONGEST_PATH_BYTES:
                raise ProbeError(
                    f"{uri}: address: socket paths have at most {_LONGEST_PATH_BYTES} bytes"
                )
            if not HAS_UNIX_SOCKETS:
                raise ProbeError(f"{uri}: address: no Unix sockets on this system: tcp:HOST:PORT")
            return cls(None, 0, rest)
        if scheme in ("ws", "wss") or (scheme in ("http", "https") and rest.startswith("//")):
            slashes = "" if rest.startswith("//") else "//"  # ws:HOST:PORT, as the daemon has it
            web = WebAddress.parse(f"{scheme}:{slashes}{rest}")
            return cls(web.host, web.port, None, web)
        if scheme in ("mqtt", "mqtts") and rest:
            slashes = "" if rest.startswith("//") else "//"  # mqtt:HOST/TOPIC, as the daemon has it
            broker = BrokerAddress.parse(f"{scheme}:{slashes}{rest}")
            return cls(broker.host, broker.port, None, None, broker)
        host, _, port = rest.rpartition(":")
        host = host.removeprefix("[").removesuffix("]")
        known = host and "/" not in host and port.isdecimal() and 0 < int(port) < 65536
        if scheme == "tcp" and known:
            no_wildcard(uri, host)
            return cls(host, int(port), None)
        slashes = " (without //)" if rest.startswith("//") else ""
        raise ProbeError(
            f"{uri}: address: expected tcp:HOST:PORT{slashes}, unix:PATH, "
            "ws://HOST:PORT/, wss://HOST:PORT/#token=…, or mqtt://HOST/TOPIC"
        )

    def without_secrets(self, uri: str) -> str:
        """Give `uri`, which this address was read from, as it may stand in messages and logs."""
        shown = self.web or self.broker
        return uri if shown is None else str(shown)

    @property
    def is_read_only(self) -> bool:
        """The probe does not hear who reads there."""
        return self.broker is not None

    async def connect(self) -> tuple[Reader, Writer]:
        """Open a stream of delimited messages."""
        if self.broker is not None:
            published = await self.broker.connect()
            return published, published
        if self.web is not None:
            stream = await self.web.connect()
            return stream, stream
        if self.path is not None:
            return await asyncio.open_unix_connection(self.path)
        reader, writer = await asyncio.open_connection(self.host, self.port)
        sock: socket.socket = writer.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in (("TCP_KEEPIDLE", 5), ("TCP_KEEPINTVL", 2), ("TCP_KEEPCNT", 3)):
            if hasattr(socket, option):  # a half-open connection shows within ~11 s
                sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
        return reader, writer
