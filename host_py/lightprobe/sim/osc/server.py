"""HTTP in front of a simulated THETA: /osc/…, digest authentication, multipart pictures."""

from __future__ import annotations

import contextlib
import json
import random
import socket
import struct
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self

from lightprobe.errors import LightprobeError
from lightprobe.sim.osc.camera import OscCamera
from lightprobe.sim.osc.digest import Digest
from lightprobe.sim.osc.options import RefusedError, Values

BOUNDARY = "---osclivepreview---"
_MOST_BODY_BYTES = 65536
_NETWORK_POLL_S = 0.02
_TIMEOUT_S = 30.0
_END_S = 5.0
_LIVE = "camera.getLivePreview"


class OscServer:
    """Serves one camera as long as the `with` block lasts."""

    def __init__(
        self, camera: OscCamera, address: tuple[str, int], login: tuple[str, str] | None = None
    ) -> None:
        """`address`: host ("": all) and port (0: any free one). `login`: user and password of the
        client mode. Raises LightprobeError."""
        self.camera = camera
        self.digest = Digest(*login, camera.faults.nonce_uses) if login else None
        self.streams = 0  # live previews under way
        self.changed = threading.Condition()  # guards them

        server = self

        class Handler(_Handler):
            osc = server

        class Http(ThreadingHTTPServer):
            daemon_threads = True
            request_queue_size = 32

            def handle_error(self, *_: object) -> None:
                """A client that leaves is no error."""

        try:
            self._http = Http(address, Handler)
        except OSError as error:
            raise LightprobeError(
                f"simulate: --osc {address[1]}: bind: {error.strerror}: choose another port"
            ) from None
        self.port = int(self._http.server_address[1])

    def __enter__(self) -> Self:
        """Begin."""
        threading.Thread(target=self._http.serve_forever, args=(0.05,), daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        """End: the camera is switched off."""
        self.camera.end_preview()
        with self.changed:  # no picture is being made when the program ends
            self.changed.wait_for(lambda: self.streams == 0, _END_S)
        self._http.shutdown()
        self._http.server_close()


class _Handler(BaseHTTPRequestHandler):
    """One connection."""

    osc: OscServer
    protocol_version = "HTTP/1.1"
    timeout = _TIMEOUT_S
    disable_nagle_algorithm = True

    def log_message(self, *_: object) -> None:
        """Say nothing."""

    def do_GET(self) -> None:
        """/osc/info, /getLivePreview and files."""
        if not self._admitted():
            return
        if self.path == "/osc/info":
            self._answer(200, self.osc.camera.info())
        elif self.path == "/getLivePreview":
            self._live({"name": _LIVE})
        elif self.path in self.osc.camera.files:
            self._send(200, "image/jpeg", self.osc.camera.files[self.path])
        else:
            self._refuse("", RefusedError("notFound", f"{self.path}: there is no such page"))

    def do_POST(self) -> None:
        """/osc/state, /osc/checkForUpdates, /osc/commands/execute and …/status."""
        body = self._body()
        if body is None or not self._admitted():
            return
        camera = self.osc.camera
        try:
            if self.path == "/osc/state":
                self._answer(200, camera.state())
            elif self.path == "/osc/checkForUpdates":
                fingerprint = camera.state()["fingerprint"]
                self._answer(200, {"stateFingerprint": fingerprint, "throttleTimeout": 1})
            elif self.path == "/osc/commands/status":
                self._answer(200, camera.status(str(body.get("id", ""))))
            elif self.path == "/osc/commands/execute":
                self._execute(body)
            else:
                raise RefusedError("notFound", f"{self.path}: there is no such page")
        except RefusedError as refused:
            self._refuse(str(body.get("name", "")), refused)

    def _execute(self, body: Values) -> None:
        name, parameters = body.get("name"), body.get("parameters", {})
        if not isinstance(name, str) or not isinstance(parameters, dict):
            raise RefusedError("missingParameter", "name is missing, or parameters are no object")
        if name == _LIVE:
            self._live(body)
        else:
            self._answer(200, self.osc.camera.execute(name, parameters))

    # Around every request.

    def _body(self) -> Values | None:
        """JSON of the request, {} when it has none; None: answered."""
        length = int(self.headers.get("Content-Length") or 0)
        if length > _MOST_BODY_BYTES:
            self.close_connection = True
            return None
        text = self.rfile.read(length)
        try:
            body = json.loads(text) if text.strip() else {}
        except ValueError:
            body = None
        if not isinstance(body, dict):
            self._refuse("", RefusedError("missingParameter", "the request is no JSON object"))
            return None
        return body

    def _admitted(self) -> bool:
        """Network, power and password allow it; False: answered, or never to be."""
        camera = self.osc.camera
        while camera.network_is_lost():
            time.sleep(_NETWORK_POLL_S)
        if camera.is_asleep():
            self.close_connection = True
            return False
        if self.osc.digest is None:
            return True
        challenge = self.osc.digest.check(self.command, self.headers.get("Authorization"))
        if challenge is None:
            return True
        self._send(401, "text/plain", b"", {"WWW-Authenticate": challenge})
        return False

    def _answer(self, status: int, body: Values) -> None:
        data = json.dumps(body).encode()
        self._send(status, "application/json; charset=utf-8", data)

    def _refuse(self, name: str, refused: RefusedError) -> None:
        error = {"code": refused.code, "message": str(refused)}
        self._answer(
            RefusedError.STATUS[refused.code], {"name": name, "state": "error", "error": error}
        )

    def _send(
        self, status: int, kind: str, data: bytes, headers: dict[str, str] | None = None
    ) -> None:
        self.send_response(status)
        for key, value in (headers or {}).items():
            self.send_header(key, value)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        self.wfile.write(data)

    # The live preview.

    def _live(self, body: Values) -> None:
        try:
            pictures = self.osc.camera.begin_preview()
        except RefusedError as refused:
            self._refuse(str(body["name"]), refused)
            return
        self.send_response(200)
        self.send_header("Content-Type", f'multipart/x-mixed-replace; boundary="{BOUNDARY}"')
        self.send_header("Transfer-Encoding", "chunked")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        self.close_connection = True
        with contextlib.suppress(OSError), self._counted():
            self._stream(pictures)

    @contextlib.contextmanager
    def _counted(self) -> Iterator[None]:
        osc = self.osc
        with osc.changed:
            osc.streams += 1
        try:
            yield
        finally:
            with osc.changed:
                osc.streams -= 1
                osc.changed.notify_all()

    def _stream(self, pictures: Iterator[bytes]) -> None:
        chance = random.Random(self.osc.camera.frames)
        for sent, picture in enumerate(pictures, 1):
            f = self.osc.camera.faults
            if self.osc.camera.network_is_lost():
                self._wait_for_network()
                return
            self._chunks(_part(picture, f, chance), chance if f.pieces else None)
            if f.disconnect_after and sent >= f.disconnect_after:
                linger = struct.pack("ii", 1, 0)  # the other end gets a reset
                self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
                return
        self.wfile.write(b"0\r\n\r\n")

    def _wait_for_network(self) -> None:
        """The other end hears nothing; the connection has gone when the network is back."""
        while self.osc.camera.network_is_lost():
            time.sleep(_NETWORK_POLL_S)

    def _chunks(self, data: bytes, chance: random.Random | None) -> None:
        for piece in _cut(data, chance) if chance else [data]:
            self.wfile.write(b"%x\r\n%b\r\n" % (len(piece), piece))


def _part(picture: bytes, faults: Any, chance: random.Random) -> bytes:
    """One picture with its boundary and header, right or as faults ask for."""
    length = len(picture)
    if chance.random() < faults.wrong_length:
        length = max(1, length + chance.choice((-1, 1)) * chance.randint(1, length // 2 + 1))
    dashes = b"" if faults.bare_boundary else b"--"
    header = b"" if faults.no_length else b"Content-Length: %d\r\n" % length
    start = b"%b%b\r\nContent-type: image/jpeg\r\n%b\r\n" % (dashes, BOUNDARY.encode(), header)
    return start + picture + b"\r\n"


def _cut(data: bytes, chance: random.Random) -> Iterator[bytes]:
    """Pieces of any length: small ones in what stands before and after the picture."""
    at = 0
    while at < len(data):
        small = at < 100 or at > len(data) - 100
        size = chance.randint(1, 7) if small else chance.randint(1, 20000)
        if not small:
            size = min(size, len(data) - 100 - at + 1)
        yield data[at : at + size]
        at += size
