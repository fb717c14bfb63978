"""`lightprobe find`: probes that announce themselves in the local network, and cameras."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer
from zeroconf import ServiceInfo

from lightprobe.cli import check
from lightprobe.cli.browse import browse, printable, short, show
from lightprobe.cli.find_cameras import list_cameras

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
    cameras: Annotated[
        bool, typer.Option("--cameras", help="List cameras for --source=osc: instead.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print a list as JSON.")] = False,
) -> None:
    """List the probes, or the cameras, that announce themselves in the local network.

    A probe does so when its owner has copied packaging/avahi/lightprobe.service to
    /etc/avahi/services/. A camera (RICOH THETA) does so in client mode. Example:
    lightprobe find --cameras
    """
    if cameras:
        list_cameras(seconds, interface, as_json=as_json)
        return
    found, silent = find(seconds, interface)
    show(
        found, silent, _line,
        f"find: no probe announced itself in {seconds:g} s: on the probe, avahi-daemon must "
        "run, and /etc/avahi/services/ have packaging/avahi/lightprobe.service; both machines "
        "must be in one network",
        as_json=as_json,
    )  # fmt: skip
    if not as_json and any(one.scheme == "wss" for one in found):
        typer.echo(
            "note: add to an https: address what `lightprobe pair` prints there from # on",
            err=True,
        )


def _line(one: Announcement) -> str:
    where = one.uri or f"scheme {one.scheme!r}: unknown, try a newer lightprobe"
    return f"{one.name}: {where} ({', '.join(one.addresses)})"


def find(seconds: float, interface: str | None = None) -> tuple[list[Announcement], list[str]]:
    """Probes found in a while, and names of which nothing more is known.

    Raises LightprobeError when the network cannot be used.
    """
    infos, silent = browse(SERVICE_TYPE, seconds, interface)
    return [_announcement(info) for info in infos], silent


def _announcement(info: ServiceInfo) -> Announcement:
    scheme = printable((info.decoded_properties.get("scheme") or "").lower())
    host = printable((info.server or "").removesuffix("."))
    uri = _URI[scheme].format(host=host, port=info.port) if scheme in _URI else None
    return Announcement(short(info.name, SERVICE_TYPE), uri, scheme, info.parsed_addresses())
