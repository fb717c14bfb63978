"""`lightprobe setup`: choose camera and boards, calibrate, and open the network, in a browser."""

from __future__ import annotations

import os
import secrets
import ssl
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import segno
import typer

from lightprobe import installation
from lightprobe.cli import pair
from lightprobe.cli.listening import listen
from lightprobe.errors import LightprobeError
from lightprobe.network.wifi import Folders, Wifi
from lightprobe.setup import door, service
from lightprobe.setup.web import LEAST_TOKEN, Setup

_OWNER = "owner"
_PORT = 7703
_CONFIG = Path("/etc/lightprobe/lightprobed.conf")


def command(
    config: Annotated[
        Path, typer.Option(help="Configuration of the daemon that is set up.")
    ] = _CONFIG,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the page; 0: a free one.")
    ] = _PORT,
    network: Annotated[
        bool,
        typer.Option(
            "--network", help="Serve the network, encrypted; default: this machine alone."
        ),
    ] = False,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--dir", help="Folder of key, certificate and owner's token, as of lightprobe pair."
        ),
    ] = None,
    new: Annotated[
        bool, typer.Option("--new", help="Make another owner's token: the former is out.")
    ] = False,
    networks: Annotated[
        Path | None,
        typer.Option(
            help="Folder where NetworkManager keeps Wi-Fi networks; default: this machine's."
        ),
    ] = None,
    page: Annotated[
        Path | None, typer.Option(help="Folder of setup.html; default: the installed one.")
    ] = None,
) -> None:
    """Serve a page to set up this probe: camera, boards, calibration, settings.

    Prints the page's address, which holds the owner's token: who has it can change everything.
    Where systemd runs lightprobed, it sets up that service, as root. With another --config it runs
    lightprobed itself. Example: sudo lightprobe setup --network
    """
    if sys.platform == "win32":
        raise LightprobeError("setup: runs on the probe, which is not a Windows machine")
    page = page or installation.viewer()
    if page is None or not (page / "setup.html").is_file():
        raise LightprobeError(
            "setup: the page is not installed beside this command: run `make web`"
        )
    folder = folder or pair.default_folder()
    try:
        token, hosts, tls = _owner(folder, network, new)
    except OSError as error:
        raise LightprobeError(
            f"setup: {error.filename or folder}: {error.strerror}: run it as a user who may, or "
            "name another --dir"
        ) from None
    with tempfile.TemporaryDirectory(prefix="lightprobe-setup-") as scratch:
        probe = _service(config, Path(scratch))
        listening = listen("setup", network, port)
        wifi = Wifi(Folders.of_machine(networks))
        setup = Setup(token, config, probe, page, folder, wifi)
        host = pair.shown_host(hosts) if network else "127.0.0.1"
        site = f"{'https' if tls else 'http'}://{f'[{host}]' if ':' in host else host}"
        _tell(f"{site}:{listening.getsockname()[1]}/setup.html", token, folder, network)
        try:
            door.serve(setup.application(), listening, tls)
        finally:
            if isinstance(probe, service.Child):
                probe.stop()


def _tell(page: str, token: str, folder: Path, network: bool) -> None:
    """Print the address; not the token where it would stay in a journal."""
    if os.environ.get("JOURNAL_STREAM"):
        print(f"{page}#owner=… the token is in {folder / _OWNER}", flush=True)
        return
    address = f"{page}#owner={token}"
    if network:
        segno.make(address, error="m").terminal(out=sys.stdout, compact=True)
    print(address, flush=True)


def _service(config: Path, scratch: Path) -> service.Service:
    """The one of systemd that has this configuration, else a child process."""
    if config.resolve() == _CONFIG.resolve() and Path("/run/systemd/system").is_dir():
        if os.geteuid() != 0:
            raise LightprobeError(
                f"setup: {service.UNIT}: only root may change it: sudo lightprobe setup, or name "
                "another --config"
            )
        return service.Systemd()
    if not config.is_file():
        raise LightprobeError(
            f"setup: {config}: no such file: name one with --config; it may be empty but for "
            "publish = …"
        )
    return service.Child(config, scratch / "log")


def _owner(folder: Path, network: bool, new: bool) -> tuple[str, list[str], ssl.SSLContext | None]:
    """Token, names, and keys of the page; made where they are missing. Raises OSError."""
    hosts, tls = ["127.0.0.1"], None
    if network:
        hosts = pair.ensure(folder)[0].hosts
        tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        tls.load_cert_chain(folder / pair.CERTIFICATE, folder / pair.KEY)
    file = folder / _OWNER
    if new or not file.exists() or len(file.read_text().strip()) < LEAST_TOKEN:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        pair.write_secret(file, secrets.token_urlsafe(24).encode() + b"\n")
    return file.read_text().strip(), hosts, tls
