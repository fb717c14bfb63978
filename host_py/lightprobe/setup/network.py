"""The set-up page's section of networks: how it stands, and joining, which may cut the page off."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from aiohttp import web

from lightprobe.errors import LightprobeError, UsageError
from lightprobe.network import names
from lightprobe.network.wifi import Wifi, page_host

#: The answer to a request to join gets out before its network may go.
_GRACE_S = 1.0


class Networks:
    """One change at a time; its end is told when the page is back."""

    def __init__(self, wifi: Wifi) -> None:
        """Of this machine."""
        self._wifi = wifi
        self._work: asyncio.Task[None] | None = None
        self._last: dict[str, str] | None = None  # what was done, with which name, what went wrong

    async def state(self, request: web.Request) -> dict[str, Any]:
        """How it stands; without Wi-Fi the reason."""
        told: dict[str, Any] = {
            "page": _page(request),
            "works": self.works, "last": self._last, "why": "", "view": None,
        }  # fmt: skip
        try:
            told["view"] = (await asyncio.to_thread(self._wifi.look)).as_json()
        except LightprobeError as error:
            told["why"] = str(error)
        return told

    @property
    def works(self) -> bool:
        """Whether a network is being joined or forgotten."""
        return self._work is not None and not self._work.done()

    def join(self, wanted: dict[str, Any]) -> None:
        """Begin; `wanted`: {"ssid": HEX or "name": TEXT, "password": TEXT, "security": TEXT}."""
        ssid, password = _ssid(wanted), _text(wanted, "password")
        security = _text(wanted, "security")
        self._begin("join", ssid, lambda: self._wifi.join(ssid, password, security))

    def forget(self, wanted: dict[str, Any]) -> None:
        """Begin; `wanted`: {"ssid": HEX}."""
        ssid = _ssid(wanted)
        self._begin("forget", ssid, lambda: self._wifi.forget(ssid))

    async def end(self) -> None:
        """Wait for what has begun: a probe must not stay between two networks."""
        if self._work:
            await self._work

    def _begin(self, what: str, ssid: bytes, change: Callable[[], None]) -> None:
        if self.works:
            raise LightprobeError("wifi: a network is being joined or forgotten: wait a minute")
        self._last = {"what": what, "name": names.shown(ssid), "problem": ""}
        self._work = asyncio.create_task(self._run(change, self._last))

    async def _run(self, change: Callable[[], None], told: dict[str, str]) -> None:
        await asyncio.sleep(_GRACE_S)
        try:
            await asyncio.to_thread(change)
        except LightprobeError as error:
            told["problem"] = str(error)
        except (OSError, ValueError) as error:  # the page must not say that it was done
            told["problem"] = f"wifi: {told['name']}: {told['what']}: {error}"


def _page(request: web.Request) -> str:
    """Where the page is when the network is another one: in clear it is for this machine alone."""
    host = page_host() if request.scheme == "https" else request.url.host
    return f"{request.scheme}://{host}:{request.url.port}/setup.html"


def _text(wanted: dict[str, Any], name: str) -> str:
    value = wanted.get(name, "")
    if not isinstance(value, str):
        raise UsageError(f"wifi: {name}: expected a text")
    return value


def _ssid(wanted: dict[str, Any]) -> bytes:
    try:
        found = bytes.fromhex(_text(wanted, "ssid"))
    except ValueError:
        raise UsageError("wifi: ssid: expected bytes in hexadecimal digits") from None
    return found or _text(wanted, "name").encode(errors="replace")
