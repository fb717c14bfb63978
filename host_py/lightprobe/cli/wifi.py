"""`lightprobe wifi`: which Wi-Fi networks there are, join one, forget one."""

from __future__ import annotations

import contextlib
import getpass
import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from lightprobe.errors import UsageError
from lightprobe.network import names, profile
from lightprobe.network.wifi import Folders, View, Wifi

_MOST_PASSWORD = 200  # characters that are read

app = typer.Typer(rich_markup_mode=None, add_completion=False)
_Folder = Annotated[
    Path | None,
    typer.Option(
        "--networks", help="Folder where NetworkManager keeps networks; default: this machine's."
    ),
]
_Name = Annotated[str, typer.Argument(help="Name of the network, as lightprobe wifi shows it.")]
_Json = Annotated[bool, typer.Option("--json", help="Print it as JSON.")]


@app.callback(invoke_without_command=True)
def command(ctx: typer.Context, folder: _Folder = None, as_json: _Json = False) -> None:
    r"""List the networks in reach and those that are known, and which is joined.

    In names \\ stands for a backslash, and \xNN for a byte that cannot be printed.
    Example: sudo lightprobe wifi join "my network"
    """
    if ctx.invoked_subcommand is None:
        _print(Wifi(Folders.of_machine(folder)).look(), as_json)


@app.command()
def join(
    name: _Name,
    security: Annotated[
        str,
        typer.Option(help="Of a network that is not seen: open, OWE, WPA2 or WPA3."),
    ] = "",
    folder: _Folder = None,
    as_json: _Json = False,
) -> None:
    """Join a network, and keep it; if that fails, go back to the former one. Needs root.

    The password is asked for, or read from the standard input: one line. An empty one: the network
    is open, or known already. Example: sudo lightprobe wifi join "my network" <password.txt
    """
    if security not in ("", *profile.SECURITIES):
        raise UsageError(f"wifi: --security {security}: one of {', '.join(profile.SECURITIES)}")
    wifi = Wifi(Folders.of_machine(folder))
    wifi.join(_meant(wifi.look(), name), _password(), security)
    _print(wifi.look(), as_json)


@app.command()
def forget(name: _Name, folder: _Folder = None, as_json: _Json = False) -> None:
    """Leave a network, and join it no more. Needs root. Example: sudo lightprobe wifi forget x"""
    wifi = Wifi(Folders.of_machine(folder))
    wifi.forget(_meant(wifi.look(), name))
    _print(wifi.look(), as_json)


def _meant(view: View, name: str) -> bytes:
    """The network that is listed so, else the name as it stands."""
    listed = {one.ssid for one in view.networks}
    meant = names.typed(name)
    return next((ssid for ssid in meant if ssid.hex() in listed), meant[-1])


def _password() -> str:
    """Ask for it at a terminal, without showing it; else read a line."""
    if sys.stdin.isatty():
        with contextlib.suppress(EOFError):
            return getpass.getpass("password (empty: none, or known): ")
        return ""
    return sys.stdin.readline(_MOST_PASSWORD).rstrip("\r\n")


def _print(view: View, as_json: bool) -> None:
    if as_json:
        print(json.dumps(view.as_json(), indent=2))
        return
    for link in view.links:
        print(f"connected  {link.kind}  {link.device}  {link.name}{'' if link.is_up else '  …'}")
    if not view.links:
        print("connected  by nothing")
    for one in view.networks:
        signal = "     " if one.signal_percent is None else f"{one.signal_percent:3d} %"
        marks = ["joined"] * one.joined + ["known"] * one.known
        print(f"{signal}  {one.security or 'away':10}  {', '.join(marks):13}  {one.name}")
    if not view.networks:
        print("no network is in reach")
