"""Services that announce themselves in the local network (DNS-SD over mDNS)."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, TypeVar

import typer
from zeroconf import Error, InterfaceChoice, ServiceBrowser, ServiceInfo, ServiceListener, Zeroconf

from lightprobe.errors import LightprobeError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Found = TypeVar("Found", bound="DataclassInstance")


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


def browse(
    service_type: str, seconds: float, interface: str | None = None
) -> tuple[list[ServiceInfo], list[str]]:
    """Services of a type found in a while, and names of which nothing more is known.

    `interface`: address of this machine; None: all. Raises LightprobeError when the network cannot
    be used.
    """
    try:
        network = Zeroconf(interfaces=[interface] if interface else InterfaceChoice.Default)
    except (OSError, ValueError, RuntimeError) as error:
        raise LightprobeError(
            f"find: listen to mDNS: {error}: check --interface and the network"
        ) from None
    with network:
        names = _Names()
        ServiceBrowser(network, service_type, names)
        time.sleep(seconds)
        infos = {name: _resolve(network, service_type, name) for name in sorted(names.present)}
    found = [info for info in infos.values() if info and info.port]
    silent = [short(name, service_type) for name, info in infos.items() if not (info and info.port)]
    return found, silent


def _resolve(network: Zeroconf, service_type: str, name: str) -> ServiceInfo | None:
    try:
        return network.get_service_info(service_type, name)
    except Error:  # a name that breaks the rules
        return None


def show(
    found: Sequence[Found],
    silent: Sequence[str],
    line: Callable[[Found], str],
    nobody: str,
    *,
    as_json: bool,
) -> None:
    """Print what was found, `line` by line or as JSON; LightprobeError `nobody` without any."""
    for name in silent:
        typer.echo(f"note: {name}: announced, but it does not say where it is", err=True)
    if as_json:
        typer.echo(json.dumps([asdict(one) for one in found], indent=2))
    if not found:
        raise LightprobeError(nobody)
    if not as_json:
        for one in found:
            typer.echo(line(one))


def short(name: str, service_type: str) -> str:
    """Name of a service without its type."""
    return printable(name.removesuffix(f".{service_type}"))


def printable(text: str) -> str:
    """Text of the network for a terminal: no control characters."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)
