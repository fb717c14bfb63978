"""`lightprobe find`: probes that announce themselves in the local network (DNS-SD over mDNS)."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass
from typing import Annotated

import typer
from zeroconf import Error, InterfaceChoice, ServiceBrowser, ServiceInfo, ServiceListener, Zeroconf

from lightprobe.cli import check
from lightprobe.errors import LightprobeError

SERVICE_TYPE = "_lightprobe._tcp.local."

#: How a client writes the address of a probe, by the scheme that the announcement names.
_URI = {"wss": "https://{host}:{port}/", "ws": "ws://{host}:{port}/", "tcp": "tcp:{host}:{port}"}


@dataclass(frozen=True)
class Announcement:
    """One probe, as the network describes it: whoever is in it can claim anything."""

    name: str
    uri: str | None  # None: of a scheme that this version does not know
    scheme: str
    addresses: list[str]


class _Names(ServiceListener):
    """Names of the services that are there."""

    def __init__(self) -> None:
        self.present: set[str] = set()

    def add_service(self, zc: Zeroconf, type_: str, name: str) -> None:
        self.present.add(name)

    def update_service(self, zc: Zeroconf, type_: str, name: str) -> None:
        self.present.add(name)

    def remove_service(self, zc: Zeroconf, type_: str, name: str) -> None:
        self.present.discard(name)


def command(
    seconds: Annotated[
        float,
        typer.Option(
            "--seconds",
            callback=check.number(0, 600, "seconds", above=True),
            help="Listen for this long.",
        ),
    ] = 3.0,
    interface: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Of this machine; without it all interfaces."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a list as JSON.")] = False,
) -> None:
    """List the probes that announce themselves in the local network.

    A probe does so when its owner has copied packaging/avahi/lightprobe.service to
    /etc/avahi/services/. Example: lightprobe find --seconds 5
    """
    found, silent = find(seconds, interface)
    for name in silent:
        typer.echo(f"note: {name}: announced, but it does not say where it is", err=True)
    if as_json:
        typer.echo(json.dumps([asdict(one) for one in found], indent=2))
    if not found:
        raise LightprobeError(
            f"find: no probe announced itself in {seconds:g} s: on the probe, avahi-daemon must "
            "run, and /etc/avahi/services/ have packaging/avahi/lightprobe.service; both machines "
            "must be in one network"
        )
    if not as_json:
        for one in found:
            where = one.uri or f"scheme {one.scheme!r}: unknown, try a newer lightprobe"
            typer.echo(f"{one.name}: {where} ({', '.join(one.addresses)})")
        if any(one.scheme == "wss" for one in found):
            typer.echo(
                "note: add to an https: address what `lightprobe pair` prints there from # on",
                err=True,
            )


def find(seconds: float, interface: str | None = None) -> tuple[list[Announcement], list[str]]:
    """Probes found in a while, and names of which nothing more is known.

    Raises LightprobeError when the network cannot be used.
    """
    try:
        network = Zeroconf(interfaces=[interface] if interface else InterfaceChoice.Default)
    except (OSError, ValueError, RuntimeError) as error:
        raise LightprobeError(
            f"find: listen to mDNS: {error}: check --interface and the network"
        ) from None
    with network:
        names = _Names()
        ServiceBrowser(network, SERVICE_TYPE, names)
        time.sleep(seconds)
        infos = {name: _resolve(network, name) for name in sorted(names.present)}
    found = [_announcement(info) for info in infos.values() if info and info.port]
    silent = [_short(name) for name, info in infos.items() if not (info and info.port)]
    return found, silent


def _resolve(network: Zeroconf, name: str) -> ServiceInfo | None:
    try:
        return network.get_service_info(SERVICE_TYPE, name)
    except Error:  # a name that breaks the rules
        return None


def _announcement(info: ServiceInfo) -> Announcement:
    scheme = _printable((info.decoded_properties.get("scheme") or "").lower())
    host = _printable((info.server or "").removesuffix("."))
    uri = _URI[scheme].format(host=host, port=info.port) if scheme in _URI else None
    return Announcement(_short(info.name), uri, scheme, info.parsed_addresses())


def _short(name: str) -> str:
    return _printable(name.removesuffix(f".{SERVICE_TYPE}"))


def _printable(text: str) -> str:
    """Text of the network for a terminal: no control characters."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)
