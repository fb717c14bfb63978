"""The daemon that is set up: systemd's service, or one that runs as long as this program does."""

from __future__ import annotations

import contextlib
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path
from typing import Protocol

from lightprobe import daemon
from lightprobe.address import Address
from lightprobe.errors import LightprobeError, ProbeError
from lightprobe.setup import settings

UNIT = "lightprobed.service"
#: The daemon opens its sockets and devices at once, and says why it cannot.
_PATIENCE_S = 15.0
#: One that fails at its start has failed by then.
_SETTLED_S = 1.5
_END_S = 15.0
_LOG_LINES = 40


def boot() -> str:
    """Give what is another one after each start of this machine; "" where that is not told."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""


def restart_machine() -> None:
    """Begin to restart this machine."""
    subprocess.run(["systemctl", "--no-block", "reboot"], capture_output=True)


class Service(Protocol):
    """What is started and stopped."""

    def start(self) -> None:
        """Start it if it does not run; raises LightprobeError."""

    def stop(self) -> None:
        """End it: its devices are free. Raises LightprobeError."""

    @property
    def runs(self) -> bool:
        """Whether it does."""

    def log(self) -> list[str]:
        """Its newest lines."""


class Systemd:
    """The service of this machine; needs root."""

    def start(self) -> None:
        """Start it; `systemctl start` returns when it is ready, or has failed."""
        self._tell("start")

    def stop(self) -> None:
        """End it."""
        self._tell("stop")

    @property
    def runs(self) -> bool:
        """Whether it does."""
        done = subprocess.run(["systemctl", "is-active", UNIT], capture_output=True, text=True)
        return done.stdout.strip() in ("active", "activating", "reloading")

    def log(self) -> list[str]:
        """Its newest lines in the journal."""
        command = ["journalctl", f"_SYSTEMD_UNIT={UNIT}", "-n", str(_LOG_LINES), "-o", "cat",
                   "--no-pager"]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, errors="replace")
        return done.stdout.splitlines()

    def _tell(self, verb: str) -> None:
        # A service that has failed too often may start again.
        subprocess.run(["systemctl", "reset-failed", "-q", UNIT], capture_output=True)
        done = subprocess.run(
            ["systemctl", verb, UNIT], capture_output=True, text=True, errors="replace"
        )
        if done.returncode:
            words = " ".join(self.log()[-3:]) if verb == "start" else done.stderr.strip()
            raise LightprobeError(f"setup: {UNIT}: {verb}: {words}")


class Child:
    """A daemon with this configuration, as a child process: where no systemd runs."""

    def __init__(self, config: Path, log: Path) -> None:
        """Take the configuration, and the file that gets its newest run's log lines."""
        self._config, self._log = config, log
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it if it does not run; raises LightprobeError."""
        if self.runs:
            return
        with open(self._log, "wb") as log:
            # It ends with this program, also when that is killed.
            tie = ["setpriv", "--pdeathsig", "TERM"] if shutil.which("setpriv") else []
            self._process = subprocess.Popen(
                [*tie, daemon.find(), f"--config={self._config}"],
                stdin=subprocess.DEVNULL, stdout=log, stderr=log,
            )  # fmt: skip

    def stop(self) -> None:
        """End it."""
        if self._process is None:
            return
        self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process = None

    @property
    def runs(self) -> bool:
        """Whether it does."""
        return self._process is not None and self._process.poll() is None

    def log(self) -> list[str]:
        """Its newest lines."""
        with contextlib.suppress(OSError):
            return self._log.read_text(errors="replace").splitlines()[-_LOG_LINES:]
        return []


def apply(service: Service, file: Path, text: str) -> None:
    """Give the daemon a new configuration; raises LightprobeError, and then the former one counts.

    A configuration that the daemon refuses is not written. One with which it does not run (a port
    that is taken, a device that is none) is taken back.
    """
    existed = file.exists()
    before = settings.read(file)
    settings.check(file, text)
    settings.write(file, text)
    try:
        restart(service, settings.values(text))
    except LightprobeError as error:
        if existed:
            settings.write(file, before, keep=False)
        else:
            file.unlink()
        try:
            restart(service, settings.values(before))
        except LightprobeError as again:
            raise LightprobeError(
                f"{error} — the former settings are back, but do not help: {again}"
            ) from None
        raise LightprobeError(f"{error} — the former settings are back") from None


def restart(service: Service, values: dict[str, list[str]]) -> None:
    """End the daemon and start it; raises LightprobeError if it ends again or does not answer."""
    with contextlib.suppress(LightprobeError):  # it may have failed already
        service.stop()
    service.start()
    started = time.monotonic()
    while time.monotonic() - started < _PATIENCE_S:
        time.sleep(0.1)
        if not service.runs:
            raise LightprobeError(
                f"setup: lightprobed: start: {' '.join(service.log()[-3:]) or 'it has ended'}"
            )
        if time.monotonic() - started > _SETTLED_S and answers(values):
            return
    raise LightprobeError(
        f"setup: lightprobed: start: nobody answers in {_PATIENCE_S:g} s: "
        f"{' '.join(service.log()[-3:])}"
    )


def local_address(values: dict[str, list[str]]) -> str | None:
    """Where a client of this machine may connect, by the settings."""
    for uri in values.get("publish", ["tcp:127.0.0.1:7700"]):
        if uri.startswith(("tcp:", "unix:")):
            return uri.partition("?")[0].replace("tcp:0.0.0.0:", "tcp:127.0.0.1:")
    return None


def answers(values: dict[str, list[str]]) -> bool:
    """Whether the daemon takes connections; True where it has no address for this machine."""
    uri = local_address(values)
    if uri is None:
        return True
    try:
        address = Address.parse(uri)
    except ProbeError:
        return False
    try:
        if address.path is not None:
            with socket.socket(socket.AF_UNIX) as connection:
                connection.settimeout(1)
                connection.connect(address.path)
        else:
            socket.create_connection((address.host or "127.0.0.1", address.port), 1).close()
    except OSError:
        return False
    return True
