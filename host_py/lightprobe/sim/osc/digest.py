"""Digest authentication as a server asks for it (RFC 7616 with MD5 and qop=auth)."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import threading
from urllib.request import parse_http_list, parse_keqv_list

REALM = "Please input username and password."
_MOST_NONCES = 64


class Digest:
    """Checks requests for one user. Any thread."""

    def __init__(self, user: str, password: str, nonce_uses: int = 0) -> None:
        """`nonce_uses`: requests until a nonce is stale; 0: never."""
        self._user, self._password, self.nonce_uses = user, password, nonce_uses
        self._uses: dict[str, int] = {}
        self._lock = threading.Lock()

    def challenge(self, *, stale: bool = False) -> str:
        """Give a new WWW-Authenticate header."""
        nonce = secrets.token_hex(16)
        with self._lock:
            while len(self._uses) >= _MOST_NONCES:
                self._uses.pop(next(iter(self._uses)))
            self._uses[nonce] = 0
        text = f'Digest realm="{REALM}", nonce="{nonce}", algorithm=MD5, qop="auth"'
        return text + (", stale=true" if stale else "")

    def check(self, method: str, authorization: str | None) -> str | None:
        """None: the request is allowed; else the challenge to answer it with."""
        kind, _, rest = (authorization or "").partition(" ")
        if kind != "Digest":
            return self.challenge()
        given = parse_keqv_list(parse_http_list(rest))
        nonce = given.get("nonce", "")
        with self._lock:
            uses = self._uses.get(nonce)
            if uses is not None:
                self._uses[nonce] = uses + 1
        if uses is None or (self.nonce_uses and uses >= self.nonce_uses):
            return self.challenge(stale=True)
        if hmac.compare_digest(self._response(method, given), given.get("response", "")):
            return None
        return self.challenge()

    def _response(self, method: str, given: dict[str, str]) -> str:
        who = _md5(self._user, REALM, self._password)
        what = _md5(method, given.get("uri", ""))
        middle = (given.get(key, "") for key in ("nonce", "nc", "cnonce", "qop"))
        return _md5(who, *middle, what)


def _md5(*parts: str) -> str:
    return hashlib.md5(":".join(parts).encode()).hexdigest()
