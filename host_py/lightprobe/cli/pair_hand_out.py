"""`lightprobe pair --hand-out`: for a short time, give the address to the first that asks."""

from __future__ import annotations

import contextlib
import html
import json
import socket
import ssl
import threading
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlsplit

from lightprobe.cli.listening import listen
from lightprobe.errors import LightprobeError
from lightprobe.places import Places, peer_of

PORT = 7704
#: Of one connection, and how many at once, in all and of one peer.
_PATIENCE_S = 10.0
_MOST, _MOST_OF_PEER = 32, 16
_PAGE = """<!doctype html><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>lightprobe: pair</title><style>body{{font:1.2em sans-serif;margin:2em;max-width:34em}}
button{{font:inherit;padding:.6em 1.2em}}</style><h1>lightprobe</h1>{body}"""
_ASK = '<p>One client may pair now.</p><form method="post"><button>Pair this device</button></form>'
_GIVE = (
    '<p><a href="{url}">The light of this probe</a></p><p>Keep this address: it is the secret.</p>'
)


@dataclass(frozen=True)
class Offer:
    """What is handed out, and how."""

    url: str  # with the token
    certificate: Path
    key: Path
    seconds: float
    port: int = PORT


def hand_out(offer: Offer) -> bool:
    """Serve until one client has the address or the time is over; gives whether one has.

    Raises LightprobeError when it cannot serve.
    """
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        tls.load_cert_chain(offer.certificate, offer.key)
    except (OSError, ssl.SSLError) as error:
        raise LightprobeError(
            f"pair: {offer.certificate}: {error.strerror or error}: run lightprobe pair --new"
        ) from None
    with _Server(offer, tls) as server:
        work = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
        work.start()
        given = server.given.wait(offer.seconds)
        server.shutdown()
    return given


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, offer: Offer, tls: ssl.SSLContext) -> None:
        listening = listen("pair", True, offer.port)
        super().__init__(("", 0), _Handler, bind_and_activate=False)
        self.socket.close()
        self.socket = listening
        self.url, self.given = offer.url, threading.Event()
        self._tls, self._places = tls, Places(_MOST, _MOST_OF_PEER, 1)
        self._own = threading.local()  # .place: of the connection of this thread
        self._lock, self._taken = threading.Lock(), False

    def take(self) -> str | None:
        """Give the address to the first one that asks, and None to others."""
        with self._lock:
            first, self._taken = not self._taken, True
        if first and hasattr(self._own, "place"):  # nobody pushes it out before it has the address
            self._places.prove(self._own.place)
        return self.url if first else None

    def process_request_thread(self, request, client_address):  # type: ignore[no-untyped-def]
        """Shake hands in the connection's own thread, so that a slow one holds nobody up."""
        place = limit = None
        try:
            request.settimeout(_PATIENCE_S)
            request = self._tls.wrap_socket(
                request, server_side=True, do_handshake_on_connect=False
            )
            wrapped = request
            place = self._places.enter(peer_of(client_address[0]), lambda: _end(wrapped))
            self._own.place = place
            # In all, not for each of its bytes.
            limit = threading.Timer(_PATIENCE_S, _end, (wrapped,))
            limit.daemon = True
            limit.start()
            request.do_handshake()
            super().process_request_thread(request, client_address)
        except (OSError, ValueError):  # no TLS, or it has gone, or had to leave
            self.shutdown_request(request)
        finally:
            if limit:
                limit.cancel()
            if place:
                self._places.exit(place)

    def handle_error(self, request, client_address):  # type: ignore[no-untyped-def]
        """A connection that broke is nobody's matter."""


def _end(connection: ssl.SSLSocket) -> None:
    """Wake its thread, which closes it. Not by its own shutdown(), which lets it speak in clear."""
    with contextlib.suppress(OSError):
        socket.socket.shutdown(connection, socket.SHUT_RDWR)


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = _PATIENCE_S

    def do_GET(self) -> None:
        """Ask: a page that is only looked at takes nothing."""
        self._answer(200, _PAGE.format(body=_ASK))

    def do_POST(self) -> None:
        """Give the address, once."""
        origin = self.headers.get("Origin")
        if origin and urlsplit(origin).netloc != self.headers.get("Host"):
            self._answer(403, _PAGE.format(body="<p>Refused: a page of elsewhere asks.</p>"))
            return
        url = self.server.take()
        if url is None:
            self._answer(410, _PAGE.format(body="<p>Another client was first: press again.</p>"))
            return
        try:
            if "text/html" in self.headers.get("Accept", ""):  # as each browser says
                self._answer(200, _PAGE.format(body=_GIVE.format(url=html.escape(url))))
            else:
                self._answer(200, json.dumps({"url": url}), "application/json")
        finally:
            self.server.given.set()

    def _answer(self, status: int, text: str, kind: str = "text/html; charset=utf-8") -> None:
        data = text.encode()
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "no-store")
        # With no-referrer a browser sends the page's own form with Origin: null, as from elsewhere.
        self.send_header("Referrer-Policy", "same-origin")
        self.send_header("X-Frame-Options", "DENY")
        self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(data)
        self.wfile.flush()
        self.close_connection = True

    def log_message(self, format: str, *args: object) -> None:
        """Nothing: the address must not be in a log."""
