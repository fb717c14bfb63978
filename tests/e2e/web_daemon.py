"""What tests of ws: and wss: share: a daemon, and clients of several kinds."""

from __future__ import annotations

import base64
import contextlib
import os
import socket
import ssl
import time

from harness import BUILD, LONG_S, Daemon, jpeg
from lightprobe_proto import lightprobe_pb2 as pb
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

GOOD = jpeg()
PROTOCOL = "lightprobe.v1"
LIGHTPROBE = BUILD / "venv" / "bin" / "lightprobe"


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


class WebDaemon(Daemon):
    """A daemon on ws: and on a Unix socket, for comparison."""

    def __init__(self, *arguments, query="", folder, **popen):
        picture = folder / "a.jpg"
        picture.write_bytes(GOOD)
        self.port = free_port()
        self.local = folder / "probe"
        super().__init__(
            f"--source=file:{picture}?rate=30",
            f"--publish=ws:127.0.0.1:{self.port}{query}",
            f"--publish=unix:{self.local}?per_peer=4096",
            *arguments,
            **popen,
        )

    def wait_log(self, text):
        super().wait_log("listen: ready" if text == "listen: " else text)

    def open(self, **options):
        """A real client's connection."""
        options = {"subprotocols": [PROTOCOL], "open_timeout": LONG_S} | options
        return connect(f"ws://127.0.0.1:{self.port}/", **options)


def receive(connection, kind=None):
    """The next message (of this kind)."""
    end = time.monotonic() + LONG_S
    while time.monotonic() < end:
        data = connection.recv(LONG_S)
        assert isinstance(data, bytes)
        message = pb.FromProbe.FromString(data)
        found = message.WhichOneof("message")
        if kind in (None, found):
            return getattr(message, found)
    raise AssertionError(f"no {kind}")


def request(**wanted):
    return pb.FromClient(subscribe=pb.Subscription(**wanted)).SerializeToString()


def wait_closed(connection):
    with contextlib.suppress(ConnectionClosed):
        while True:
            connection.recv(LONG_S)
    return connection.close_code, connection.close_reason


def handshake(extra=b"", host="127.0.0.1"):
    key = base64.b64encode(os.urandom(16))
    return (
        f"GET / HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key.decode()}\r\n"
    ).encode() + extra


def read_all(raw):
    raw.settimeout(LONG_S)
    data = b""
    with contextlib.suppress(ConnectionError):
        while piece := raw.recv(65536):
            data += piece
            if b" 101 " in data:
                break
    return data


def unverified():
    """TLS as of a browser whose user has clicked the warning away.

    Not 1.3, which our own client speaks: `websockets.sync` reads in one thread and writes in
    another, OpenSSL does not allow that, and Python keeps them apart from 3.13 on. After a
    handshake of 1.3 both happen at once, and four requests of 150 were lost.
    """
    context = ssl.create_default_context()
    context.maximum_version = ssl.TLSVersion.TLSv1_2
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context
