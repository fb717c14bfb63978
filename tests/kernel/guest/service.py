# SPDX-License-Identifier: Apache-2.0
"""The installed service as tests see it: `make install-daemon`, its configuration, systemctl."""

import shutil
import time
from pathlib import Path

from machine import run, wait_for

from daemon import Client

REPO = Path(__file__).resolve().parents[3]
CONFIG = Path("/etc/lightprobe/lightprobed.conf")
SOCKET = Path("/run/lightprobe/lightprobe.sock")
UNIT_FOLDER = Path("/etc/systemd/system/lightprobed.service.d")
DROP_INS = Path("/usr/local/share/lightprobe/drop-ins")


def install() -> None:
    """Install as a user does."""
    run("make", "-C", str(REPO), "install-daemon", timeout_s=300)


def configure(*lines: str, without: str = "") -> None:
    """Write the packaged configuration, with `lines` instead of its own of the same name.

    Its lines with the name `without` go too.
    """
    names = {line.split("=")[0].strip() for line in lines} | {without}
    packaged = (REPO / "packaging/systemd/lightprobed.conf").read_text().splitlines()
    kept = [line for line in packaged if line.split("=")[0].strip() not in names]
    CONFIG.write_text("\n".join([*kept, *lines, ""]))


def add_drop_in(name: str, text: str = "") -> None:
    """Put one of the packaged drop-ins into force, or one with this text."""
    UNIT_FOLDER.mkdir(parents=True, exist_ok=True)
    if text:
        (UNIT_FOLDER / name).write_text(text)
    else:
        shutil.copy(DROP_INS / name, UNIT_FOLDER)
    run("systemctl", "daemon-reload")


def remove_drop_ins() -> None:
    """Leave the unit as it was installed."""
    shutil.rmtree(UNIT_FOLDER, ignore_errors=True)
    run("systemctl", "daemon-reload")


class Service(Client):
    """lightprobed.service, started."""

    def __init__(self) -> None:
        self._since = time.time()
        run("systemctl", "start", "lightprobed")
        super().__init__(SOCKET)

    def log(self) -> str:
        """Return what the journal has of it since this start."""
        return journal(self._since)

    @property
    def pid(self) -> int:
        """Return the main process' number."""
        return int(show("MainPID"))

    def stop(self) -> None:
        """Stop it; it must end well and leave nothing behind."""
        run("systemctl", "stop", "lightprobed")
        self._socket.close()
        state = {name: show(name) for name in ("ActiveState", "Result", "ExecMainStatus")}
        assert state == {"ActiveState": "inactive", "Result": "success", "ExecMainStatus": "0"}
        assert not SOCKET.parent.exists()


def show(name: str) -> str:
    """Return one property of the service."""
    return run("systemctl", "show", "--property", name, "--value", "lightprobed").strip()


def journal(since_unix_s: float) -> str:
    """Return what the service has said, and systemd about it, since this time."""
    return run(
        "journalctl", "--unit=lightprobed", f"--since=@{since_unix_s:.6f}", "--output=cat",
        "--no-pager",
    )  # fmt: skip


def wait_restart(count: int) -> None:
    """Wait until systemd has restarted it so often, and it is ready."""
    wait_for(
        "a restart",
        lambda: int(show("NRestarts")) >= count and show("ActiveState") == "active",
    )
