"""A probe's messages over WebSocket: `ws:` on this machine, `wss:` over the network.

The WebSocket protocol itself is the package `websockets` (`pip install websockets`), which is
imported when such an address is used.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import re
import ssl
from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

from lightprobe.errors import MissingPackage, ProbeError

if TYPE_CHECKING:
    from websockets.client import ClientProtocol

_PROTOCOL = "lightprobe.v1"
_MAX_MESSAGE_BYTES = 128 * 1024
_PORTS = {"ws": 80, "wss": 443}
#: The address of the probe's page is also that of its messages.
_SCHEMES = {"ws": "ws", "wss": "wss", "http": "ws", "https": "wss"}


@dataclass(frozen=True)
class WebAddress:
    """`ws://HOST:PORT/` or `wss://HOST:PORT/#token=TOKEN&sha256=FINGERPRINT`.

    What follows # stays with the client: it is not part of any request's address.
    """

    scheme: str  # ws or wss
    host: str
    port: int
    path: str
    token: str | None
    fingerprint: bytes | None  # SHA-256 of the certificate; None: a public authority vouches for it

    @classmethod
    def parse(cls, uri: str) -> WebAddress:
        """Read an address; raises :class:`ProbeError` that says what is wrong with it."""
        try:
            parts = urlsplit(uri)
            host, port = parts.hostname, parts.port
        except ValueError as error:
            raise ProbeError(f"{uri}: address: {error}") from None
        if not host:
            raise ProbeError(f"{uri}: address: expected {parts.scheme}://HOST:PORT/")
        no_wildcard(uri, host)
        extra = parse_qs(parts.fragment)
        scheme = _SCHEMES[parts.scheme]
        token = extra.get("token", [None])[0]
        if token and scheme != "wss":
            raise ProbeError(
                f"{uri.partition('#')[0]}: address: {parts.scheme}: would send the token in clear: "
                "take the address that `lightprobe pair` prints, with https: or wss:"
            )
        return cls(
            scheme,
            host,
            port or _PORTS[scheme],
            parts.path or "/",
            token,
            _fingerprint(uri, extra.get("sha256", [""])[0]),
        )

    async def connect(self) -> WebSocketStream:
        """Connect, check the certificate, shake hands; raises :class:`ProbeError`, OSError."""
        try:
            from websockets.client import ClientProtocol
            from websockets.typing import Subprotocol
            from websockets.uri import parse_uri
        except ModuleNotFoundError:
            raise MissingPackage(
                f"{self}: connect: needs the package websockets: pip install websockets"
            ) from None
        reader, writer = await asyncio.open_connection(
            self.host, self.port, ssl=self._tls() if self.scheme == "wss" else None
        )
        try:
            self._check_certificate(writer)
            offered = [_PROTOCOL, *([f"token.{self.token}"] if self.token else [])]
            protocol = ClientProtocol(
                parse_uri(str(self)),
                subprotocols=[Subprotocol(one) for one in offered],
                max_size=_MAX_MESSAGE_BYTES,
            )
            stream = WebSocketStream(str(self), protocol, reader, writer)
            await stream.shake_hands()
        except BaseException:
            writer.close()
            raise
        return stream

    def _tls(self) -> ssl.SSLContext:
        context = ssl.create_default_context()
        if self.fingerprint is not None:  # compared before anything is sent, the token above all
            context.check_hostname = False
            context.verify_mode = ssl.CERT_NONE
        return context

    def _check_certificate(self, writer: asyncio.StreamWriter) -> None:
        if self.scheme != "wss" or self.fingerprint is None:
            return
        certificate = writer.get_extra_info("ssl_object").getpeercert(True)
        if not hmac.compare_digest(hashlib.sha256(certificate).digest(), self.fingerprint):
            raise ProbeError(
                f"{self}: certificate: is not the one of the address: is this your probe? "
                "Nothing was sent to it. After a new `lightprobe pair` take the new address"
            )

    def __str__(self) -> str:
        """Address without token and fingerprint: fit for messages and logs."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}{self.path}"


def _allowing(name: str) -> str:
    """How the probe's owner lets clients in that call it as in the address `name`."""
    parts = urlsplit(name)
    return (
        f"start lightprobed with ?origins={parts.scheme.replace('ws', 'http')}://{parts.netloc} "
        f"at the end of its --publish={parts.scheme}:…, or call it by its address"
    )


def no_wildcard(uri: str, host: str) -> None:
    """Raise :class:`ProbeError` for what a daemon listens on, and nobody can call."""
    if host in ("0.0.0.0", "::", "*"):
        raise ProbeError(
            f"{uri.partition('#')[0]}: address: {host} stands for all addresses of the probe's "
            "machine: take one of them, or its name"
        )


def _fingerprint(uri: str, text: str) -> bytes | None:
    if not text:
        return None
    digits = text.replace(":", "")
    if not re.fullmatch(r"[0-9A-Fa-f]{64}", digits):
        shown = uri.partition("#")[0]
        raise ProbeError(f"{shown}: address: sha256= is not a fingerprint of 64 hexadecimal digits")
    return bytes.fromhex(digits)


class WebSocketStream:
    """The binary messages of a WebSocket as a stream of delimited ones, as on `tcp:`."""

    def __init__(
        self,
        name: str,
        protocol: ClientProtocol,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
    ) -> None:
        """Take over an open connection on which nothing has been said yet."""
        self._name = name
        self._protocol = protocol
        self._reader = reader
        self._writer = writer
        self._fragments = b""  # of a message that has not ended

    async def shake_hands(self) -> None:
        """Open the WebSocket; raises :class:`ProbeError` with the probe's reason."""
        self._protocol.send_request(self._protocol.connect())
        self._flush()
        while self._protocol.state.name == "CONNECTING":
            await self._feed()
            error = self._protocol.handshake_exc
            if error is not None:
                body = getattr(getattr(error, "response", None), "body", None) or b""
                reason = body.decode(errors="replace").strip() or str(error)
                if getattr(getattr(error, "response", None), "status_code", None) == 403:
                    reason += f": {_allowing(self._name)}"
                raise ProbeError(f"{self._name}: connect: refused: {reason}")

    async def read(self, _limit: int = 0) -> bytes:
        """Messages that have come, each after its length; empty when the probe has closed."""
        from websockets.frames import Frame, Opcode

        from lightprobe.wire import delimit

        while True:
            messages = b""
            for frame in self._protocol.events_received():
                if isinstance(frame, Frame) and frame.opcode in (Opcode.BINARY, Opcode.CONT):
                    self._fragments += bytes(frame.data)
                    if frame.fin:
                        messages += delimit(self._fragments)
                        self._fragments = b""
            if messages:
                return messages
            if self._protocol.state.name in ("CLOSING", "CLOSED"):
                return b""
            await self._feed()

    def write(self, delimited: bytes) -> None:
        """Send one message, given after its length; not after the probe has closed."""
        if self._protocol.state.name != "OPEN":
            return  # read() gives what the probe has said last
        start = next(i for i, byte in enumerate(delimited) if byte < 0x80) + 1
        self._protocol.send_binary(delimited[start:])
        self._flush()

    async def drain(self) -> None:
        """Wait until the system has taken what was written."""
        await self._writer.drain()

    def close(self) -> None:
        """Close at once."""
        self._writer.close()

    async def _feed(self) -> None:
        data = await self._reader.read(65536)
        if data:
            self._protocol.receive_data(data)
        else:
            self._protocol.receive_eof()
        self._flush()

    def _flush(self) -> None:
        for data in self._protocol.data_to_send():
            if data:
                self._writer.write(data)
