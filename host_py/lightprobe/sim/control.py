"""Run-time control of the simulator: lines on a Unix socket (proto/sim.md), one answer each."""

from __future__ import annotations

import os
import socket
import socketserver
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Self

from lightprobe.address import HAS_UNIX_SOCKETS
from lightprobe.errors import LightprobeError, UsageError

#: Takes what stands after the command's word; gives the answer.
Handler = Callable[[str], str]
_TIMEOUT_S = 10.0


class Control:
    """Serves commands in a thread as long as the `with` block lasts."""

    def __init__(self, path: Path, handlers: Mapping[str, Handler]) -> None:
        """`handlers` by the first word of the line; they may raise LightprobeError."""
        require_unix_sockets("--control")
        path.unlink(missing_ok=True)

        class Server(socketserver.ThreadingMixIn, socketserver.UnixStreamServer):
            daemon_threads = True

        class Conversation(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                for line in self.rfile:
                    answer = _answer(line.decode(errors="replace").strip(), handlers)
                    self.wfile.write(answer.encode() + b"\n")

        try:
            self._server = Server(str(path), Conversation)
        except OSError as error:
            raise UsageError(
                f"simulate: --control {path}: bind: {error.strerror}: choose another path"
            ) from None
        self._path = path

    def __enter__(self) -> Self:
        """Begin."""
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        """End, and take the socket away."""
        self._server.shutdown()
        self._server.server_close()
        self._path.unlink(missing_ok=True)


def require_unix_sockets(what: str) -> None:
    """Raise LightprobeError where there are none."""
    if not HAS_UNIX_SOCKETS:
        raise LightprobeError(f"{what}: this system has no Unix sockets: use Linux or macOS")


def _answer(line: str, handlers: Mapping[str, Handler]) -> str:
    word, _, rest = line.partition(" ")
    if word not in handlers:
        return f"error: {word}: unknown command: known are {', '.join(sorted(handlers))}"
    try:
        return handlers[word](rest.strip())
    except LightprobeError as error:
        return f"error: {error}"


def send(path: Path, line: str) -> str:
    """Send one command to a running simulator; gives its answer. UsageError when it refuses."""
    require_unix_sockets("control")
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(_TIMEOUT_S)
        try:
            connection.connect(os.fspath(path))
            connection.sendall(line.encode() + b"\n")
            with connection.makefile(encoding="utf-8") as answers:
                answer = answers.readline().strip()
        except OSError as error:
            raise LightprobeError(
                f"control: {path}: {error.strerror or error}: "
                f"is lightprobe simulate --control={path} running?"
            ) from None
    if answer.startswith("error: ") or not answer:
        raise UsageError(
            answer.removeprefix("error: ")
            or f"control: {path}: the simulator closed the connection"
        )
    return answer
