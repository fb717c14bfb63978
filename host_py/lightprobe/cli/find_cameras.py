"""`lightprobe find --cameras`: cameras that the daemon reads with `--source=osc:`.

A RICOH THETA in client mode announces the service `_osc._tcp`. Programs for music announce one of
the same name (Open Sound Control), so each one found is asked what it is (GET /osc/info).
"""

from __future__ import annotations

import http.client
import ipaddress
import json
from dataclasses import dataclass

import typer
from zeroconf import ServiceInfo

from lightprobe.cli.browse import browse, printable, short, show

SERVICE_TYPE = "_osc._tcp.local."
_PATIENCE_S = 3.0
_MOST_BYTES = 65536


@dataclass(frozen=True)
class Camera:
    """One camera, as it describes itself."""

    name: str  # as announced; a THETA's is also the user of its password
    uri: str  # for --source
    model: str | None  # None: it tells only who has its password
    firmware: str | None
    needs_password: bool
    addresses: list[str]


def list_cameras(seconds: float, interface: str | None, *, as_json: bool) -> None:
    """Print the cameras that announce themselves; raises LightprobeError when there is none."""
    services, silent = browse(SERVICE_TYPE, seconds, interface)
    cameras = []
    for info in services:
        camera = _ask(info)
        if isinstance(camera, Camera):
            cameras.append(camera)
        else:
            typer.echo(f"note: {short(info.name, SERVICE_TYPE)}: {camera}", err=True)
    show(
        cameras, silent, _line,
        f"find: no camera announced itself in {seconds:g} s: a THETA does so in client mode; "
        "it must be awake, and in the network of this machine. In the camera's own Wi-Fi it "
        "is osc:192.168.1.1; with a cable see its screen for the address",
        as_json=as_json,
    )  # fmt: skip


def _line(camera: Camera) -> str:
    what = f"{camera.model}, firmware {camera.firmware}" if camera.model else "unknown model"
    secret = f"?password_file=FILE (a line {camera.name}:PASSWORD)" if camera.needs_password else ""
    return f"{camera.name}: --source={camera.uri}{secret}, {what}"


def _ask(info: ServiceInfo) -> Camera | str:
    """Give what a service is; a text: why it is no camera that can be used."""
    addresses = sorted(info.parsed_addresses(), key=lambda a: ipaddress.ip_address(a).version)
    if not addresses or info.port is None:
        return "announced without an address"
    host = f"[{addresses[0]}]" if ":" in addresses[0] else addresses[0]
    port = "" if info.port == 80 else f":{info.port}"
    connection = http.client.HTTPConnection(addresses[0], info.port, timeout=_PATIENCE_S)
    try:
        connection.request("GET", "/osc/info")
        answer = connection.getresponse()
        status, body = answer.status, answer.read(_MOST_BYTES)
    except (OSError, http.client.HTTPException) as error:
        return f"no camera, or not awake: {addresses[0]} port {info.port}: {error}"
    finally:
        connection.close()
    about = _facts(body) if status == 200 else None
    if status != 401 and about is None:
        return f"no Open Spherical Camera at {addresses[0]} port {info.port}"
    return Camera(
        short(info.name, SERVICE_TYPE), f"osc:{host}{port}", _text(about, "model"),
        _text(about, "firmwareVersion"), status == 401, addresses,
    )  # fmt: skip


def _facts(body: bytes) -> dict[str, object] | None:
    """Parse an answer to /osc/info; None: it is something else."""
    try:
        about = json.loads(body)
    except ValueError:
        return None
    return about if isinstance(about, dict) and isinstance(about.get("model"), str) else None


def _text(about: dict[str, object] | None, key: str) -> str | None:
    return printable(str(about.get(key, "?"))) if about else None
