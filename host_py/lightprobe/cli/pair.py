"""`lightprobe pair`: key, certificate and token, so that clients may connect over the network."""

from __future__ import annotations

import datetime
import ipaddress
import json
import os
import secrets
import socket
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import segno
import typer
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from lightprobe import daemon, installation
from lightprobe.cli import check, pair_hand_out
from lightprobe.errors import LightprobeError
from lightprobe.setup import settings
from lightprobe.whole_file import replacing

KEY, CERTIFICATE, _TOKEN = "key.pem", "certificate.pem", "token"
_PORT = 7702
#: Where the service looks (packaging/systemd), and where its copies of the three files are.
_SERVICE_FOLDER = Path("/etc/lightprobe/pair")
_CREDENTIALS = Path("/run/credentials/lightprobed.service")
_SERVICE_D = Path("/etc/systemd/system/lightprobed.service.d")
_CONFIG = Path("/etc/lightprobe/lightprobed.conf")
#: avahi-daemon's; it announces NAME.local.
_ANNOUNCER = Path("/run/avahi-daemon/socket")
#: As long as browsers accept.
_DAYS = 397
_TOKEN_BYTES = 24


def default_folder() -> Path:
    """Where the three files are: of the service for root, else of the user."""
    if os.geteuid() == 0:
        return _SERVICE_FOLDER
    config = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(config) / "lightprobe" / "pair"


@dataclass(frozen=True)
class Pair:
    """What a client needs to know."""

    hosts: list[str]  # names and addresses that the certificate is for; see shown_host
    fingerprint: str  # SHA-256 of the certificate, AA:BB:…
    expires: datetime.datetime
    token: str

    def url(self, port: int) -> str:
        """Address of the page, and of the messages. What follows # is never sent as an address."""
        name = shown_host(self.hosts)
        host = f"[{name}]" if ":" in name else name
        sha256 = self.fingerprint.replace(":", "").lower()
        return f"https://{host}:{port}/#token={self.token}&sha256={sha256}"


def command(
    folder: Annotated[
        Path | None,
        typer.Option(
            "--dir",
            help="Folder of key, certificate and token; default: /etc/lightprobe/pair for root, "
            "else ~/.config/lightprobe/pair.",
        ),
    ] = None,
    host: Annotated[
        list[str] | None,
        typer.Option(help="Name or address of this probe; default: NAME.local, its addresses."),
    ] = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the publisher.")] = _PORT,
    new: Annotated[
        bool,
        typer.Option("--new", help="Make everything anew: clients with the old address are out."),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print address and paths.")] = False,
    hand_out_s: Annotated[
        float | None,
        typer.Option(
            "--hand-out",
            callback=check.number(1, 3600, "seconds"),
            help="For so many seconds, give the address to the first client that asks; print none.",
        ),
    ] = None,
    hand_out_port: Annotated[
        int, typer.Option(min=1, max=65535, help="Port at which clients ask.")
    ] = pair_hand_out.PORT,
) -> None:
    """Make what wss: needs, and print the address for clients, also as a QR code.

    Run it on the probe. Without --new, what exists is kept, and its address is printed again. The
    address holds a secret: who has it can read the light.
    Example: lightprobe pair --host probe.local
    """  # fmt: skip
    folder = folder or default_folder()
    try:
        pair, made = ensure(folder, host, new=new)
    except OSError as error:
        raise LightprobeError(
            f"pair: {error.filename or folder}: {error.strerror}: run it as a user who may, or "
            "name another --dir"
        ) from None
    if host and not made and pair.hosts != host:
        raise LightprobeError(
            f"pair: {folder}: is for {', '.join(pair.hosts)}: for other names run it with --new"
        )
    if hand_out_s is None:
        _print(pair, folder, port, as_json, made)
    else:
        _hand_out(pair, folder, port, hand_out_s, hand_out_port)


def _hand_out(pair: Pair, folder: Path, port: int, seconds: float, at_port: int) -> None:
    """Serve the address to one client; LightprobeError if nobody serves what it leads to."""
    config = settings.read(_CONFIG) if folder == _SERVICE_FOLDER else ""
    served = settings.values(config).get("publish", [])
    if folder == _SERVICE_FOLDER and not any(uri.startswith("wss:") for uri in served):
        raise LightprobeError(
            f"pair: {_CONFIG}: no publish = wss:…, so the address would lead nowhere: run "
            "sudo lightprobe pair, and the command that it prints"
        )
    where = f"https://{shown_host(pair.hosts)}:{at_port}"
    print(f"pair: the first client that asks at {where} gets the address", flush=True)
    offer = pair_hand_out.Offer(
        pair.url(port), folder / CERTIFICATE, folder / KEY, seconds, at_port
    )
    given = pair_hand_out.hand_out(offer)
    print("pair: a client has it" if given else f"pair: nobody asked in {seconds:g} s", flush=True)


def ensure(folder: Path, hosts: list[str] | None = None, *, new: bool = False) -> tuple[Pair, bool]:
    """What is in the folder, and whether it has been made now: if nothing was there, or anew.

    Raises OSError, LightprobeError.
    """
    made = new or not any((folder / name).exists() for name in (KEY, CERTIFICATE, _TOKEN))
    if made:
        make(folder, hosts or own_hosts())
    return read(folder), made


def own_hosts() -> list[str]:
    """Names and addresses by which others on the network may call this machine."""
    name = socket.gethostname().partition(".")[0]
    hosts = [f"{name}.local"]
    for family, anywhere in ((socket.AF_INET, "192.0.2.1"), (socket.AF_INET6, "2001:db8::1")):
        with socket.socket(family, socket.SOCK_DGRAM) as probing:
            try:
                probing.connect((anywhere, 9))  # sends nothing: the system chooses an interface
            except OSError:
                continue
            hosts.append(probing.getsockname()[0])
    return hosts


def make(folder: Path, hosts: list[str]) -> None:
    """Write key, certificate and token, readable for their owner alone; raises OSError."""
    key = ec.generate_private_key(ec.SECP256R1())
    now = datetime.datetime.now(datetime.UTC)
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"lightprobe {hosts[0]}"[:64])])
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(hours=1))
        .not_valid_after(now + datetime.timedelta(days=_DAYS))
        .add_extension(x509.SubjectAlternativeName([_name(host) for host in hosts]), False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), False)
        .sign(key, hashes.SHA256())
    )
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    pem = serialization.Encoding.PEM
    plain = serialization.NoEncryption()
    private = key.private_bytes(pem, serialization.PrivateFormat.PKCS8, plain)
    write_secret(folder / KEY, private)
    write_secret(folder / CERTIFICATE, certificate.public_bytes(pem))
    write_secret(folder / _TOKEN, secrets.token_urlsafe(_TOKEN_BYTES).encode() + b"\n")


def _name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def write_secret(path: Path, data: bytes) -> None:
    """Whole or not at all, for the owner alone; raises OSError."""
    with replacing(path) as file:
        file.write(data)


def read(folder: Path) -> Pair:
    """Read what :func:`make` wrote; raises OSError, LightprobeError."""
    token = (folder / _TOKEN).read_text().strip()
    (folder / KEY).read_bytes()
    try:
        certificate = x509.load_pem_x509_certificate((folder / CERTIFICATE).read_bytes())
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (ValueError, x509.ExtensionNotFound) as error:
        raise LightprobeError(
            f"pair: {folder / CERTIFICATE}: {error}: lightprobe pair --new makes another"
        ) from None
    expires = certificate.not_valid_after_utc
    if expires < datetime.datetime.now(datetime.UTC):
        raise LightprobeError(
            f"pair: {folder / CERTIFICATE}: expired on {expires:%Y-%m-%d}: run lightprobe pair "
            "--new, restart lightprobed, and give clients the new address"
        )
    return Pair(
        [str(name.value) for name in names],
        certificate.fingerprint(hashes.SHA256()).hex(":").upper(),
        expires,
        token,
    )


def shown_host(hosts: list[str]) -> str:
    """The first, or an address instead of a name in .local that nothing announces."""
    if _is_local(hosts[0]) and not _ANNOUNCER.exists():
        return next((host for host in hosts if not _is_local(host)), hosts[0])
    return hosts[0]


def _is_local(host: str) -> bool:
    return host.endswith(".local")


def publish_uri(folder: Path, port: int) -> str:
    """Where lightprobed is to publish: for clients, and with the viewer for browsers."""
    web = installation.viewer()
    return f"wss:0.0.0.0:{port}?pair={folder}" + (f"&root={web}" if web else "")


def next_command(folder: Path, port: int) -> str:
    """One line for a shell that makes the probe serve: as a service where it is one."""
    drop_in = installation.share() / "drop-ins" / "wss.conf"
    if folder == _SERVICE_FOLDER and drop_in.is_file():
        publish = f"publish = {publish_uri(_CREDENTIALS, port)}"
        return (
            f"sudo sh -ec 'install -D -m 644 -t {_SERVICE_D} {drop_in}; "
            f'sed -i "/^publish = wss:/d" {_CONFIG}; echo "{publish}" >>{_CONFIG}; '
            "systemctl daemon-reload; systemctl restart lightprobed'"
        )
    try:
        program = str(daemon.find())
    except daemon.DaemonError:
        program = daemon.NAME
    return f"{program} --source=v4l2: --publish='{publish_uri(folder, port)}'"


def _print(pair: Pair, folder: Path, port: int, as_json: bool, made: bool) -> None:
    folder = folder.absolute()
    if as_json:
        print(json.dumps({
            "url": pair.url(port), "sha256": pair.fingerprint, "hosts": pair.hosts,
            "expires": f"{pair.expires:%Y-%m-%d}", "folder": str(folder),
            "publish": f"--publish={publish_uri(folder, port)}",
            "next": next_command(folder, port),
        }, indent=2))  # fmt: skip
        return
    segno.make(pair.url(port), error="m").terminal(out=sys.stdout, compact=True)
    print(f"address      {pair.url(port)}")
    print(f"certificate  valid until {pair.expires:%Y-%m-%d}, for {', '.join(pair.hosts)}")
    print(f"SHA-256      {pair.fingerprint}")
    print(f"{'made' if made else 'found'}        {folder}: {KEY}, {CERTIFICATE}, {_TOKEN}")
    print(f"next         run this, which serves that address; end lightprobed first if it runs:\n\n"
          f"{next_command(folder, port)}\n")  # fmt: skip
    print("             A browser warns once, because no authority has signed the certificate:")
    print("             compare the SHA-256 that it shows with the one above.")
    for warning in _warnings(pair):
        print(f"note         {warning}")


def _warnings(pair: Pair) -> Iterator[str]:
    """What keeps a phone from the page, and the next step."""
    if installation.viewer() is None:
        yield (
            "there is no viewer beside this command, so a browser gets no page: run `make web` "
            "and add &root=build/web"
        )
    if _is_local(pair.hosts[0]) and not _ANNOUNCER.exists():
        yield (
            f"nothing announces {pair.hosts[0]} in the network: sudo apt-get install avahi-daemon, "
            "then run this again"
        )
