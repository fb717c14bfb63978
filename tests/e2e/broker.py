"""A real broker, Mosquitto of Debian, with a folder and a port of its own."""

from __future__ import annotations

import contextlib
import datetime
import ipaddress
import queue
import subprocess
import time
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from harness import LONG_S, wait_for
from paho.mqtt.client import Client as Paho
from paho.mqtt.enums import CallbackAPIVersion
from web_daemon import free_port

#: Debian has the broker where only root looks.
MOSQUITTO = "/usr/sbin/mosquitto"
PASSWD = "/usr/bin/mosquitto_passwd"


def write_certificates(folder: Path) -> None:
    """An authority (ca.pem), and the broker's certificate for 127.0.0.1 (cert.pem, key.pem)."""
    now = datetime.datetime.now(datetime.UTC)

    def build(name: str, key: Any, issuer: str, issuer_key: Any, extension: Any) -> None:
        subject, by = (
            x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, text)])
            for text in (name, issuer)
        )
        certificate = (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(by)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(now - datetime.timedelta(hours=1))
            .not_valid_after(now + datetime.timedelta(hours=1))
            .add_extension(extension, critical=True)
            .sign(issuer_key, hashes.SHA256())
        )
        pem = certificate.public_bytes(serialization.Encoding.PEM)
        (folder / f"{name}.pem").write_bytes(pem)

    authority, broker = (ec.generate_private_key(ec.SECP256R1()) for _ in range(2))
    here = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    build("ca", authority, "ca", authority, x509.BasicConstraints(ca=True, path_length=None))
    build("cert", broker, "ca", authority, here)
    (folder / "key.pem").write_bytes(
        broker.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
    )


class Broker:
    """Mosquitto on loopback; use with `with`. It keeps nothing when it is restarted."""

    def __init__(self, folder: Path, *lines: str, password: str | None = None) -> None:
        """`password`: of the user "probe"; None: everybody may come."""
        self.port = free_port()
        self._folder = folder
        self._config = folder / "mosquitto.conf"
        self._log = folder / "mosquitto.log"
        # Started as root, it would otherwise become a user who may not read the folder.
        own = ["user root", f"listener {self.port} 127.0.0.1", "log_type all", *lines]
        if password is None:
            own += ["allow_anonymous true"]
        else:
            users = folder / "users"
            subprocess.run([PASSWD, "-c", "-b", users, "probe", password], check=True)
            own += ["allow_anonymous false", f"password_file {users}"]
        self._config.write_text("\n".join(own) + "\n")
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start, and wait until it listens."""
        with open(self._log, "wb") as log:
            self.process = subprocess.Popen(
                [MOSQUITTO, "-c", self._config], stdin=subprocess.DEVNULL, stderr=log, stdout=log
            )
        wait_for(lambda: b" running" in self._log.read_bytes(), "the broker does not run")

    def kill(self) -> None:
        """End it without a farewell."""
        assert self.process is not None
        self.process.kill()
        self.process.wait(LONG_S)

    def __enter__(self) -> Broker:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def log(self) -> str:
        """What it has said since its start."""
        return self._log.read_text()

    def rss_kib(self) -> int:
        """Its memory."""
        assert self.process is not None
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return next(int(one.split()[1]) for one in status.splitlines() if one[:6] == "VmRSS:")

    def retained(self, topic: str, count: int) -> dict[str, bytes]:
        """What it keeps below a topic, `count` messages, as a new subscriber gets it."""
        came: queue.Queue[Any] = queue.Queue()
        paho = Paho(CallbackAPIVersion.VERSION2)
        paho.on_message = lambda _c, _data, message: message.retain and came.put(message)
        paho.connect("127.0.0.1", self.port)
        paho.loop_start()
        kept: dict[str, bytes] = {}
        until_s = time.monotonic() + LONG_S
        while len(kept) < count and time.monotonic() < until_s:
            paho.subscribe(f"{topic}/#")  # again: what it keeps since comes as kept, too
            with contextlib.suppress(queue.Empty):
                while len(kept) < count:
                    message = came.get(timeout=0.3)
                    kept[message.topic.removeprefix(f"{topic}/")] = message.payload
        paho.disconnect()
        paho.loop_stop()
        return kept
