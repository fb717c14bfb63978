# SPDX-License-Identifier: Apache-2.0
"""The image of a card in an emulated machine: QEMU's `virt`, not a Raspberry Pi.

The boot loader is U-Boot, built for that machine; its script, kernel and first program are the
card's own. The machine's ports 7702 and 7703 are at ports of this one.
"""

from __future__ import annotations

import os
import shutil
import socket
import struct
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from recorded import SECTOR, blockdev

_PARTITIONS = 446  # their place in a master boot record
#: It starts report.sh, which is not in the image either.
REPORT = """[Unit]
After=NetworkManager.service
[Service]
StandardOutput=tty
TTYPath=/dev/console
ExecStart=/bin/sh /usr/lib/report.sh
"""
ARGUMENTS = (
    "arguments=console=ttyAMA0 ro systemd.volatile=state panic=-1 systemd.log_target=console\n"
)
LOADER = Path("/usr/lib/u-boot/qemu_arm64/u-boot.bin")
#: Partitions, in their order.
BOOT, HALF_A, HALF_B, DATA = range(4)


def free_port() -> int:
    """A port that nobody uses now."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def partitions(disk: Path) -> list[tuple[int, int]]:
    """First byte and length of each, in bytes."""
    with disk.open("rb") as file:
        record = file.read(SECTOR)
    entries = (record[_PARTITIONS + 16 * index :][:16] for index in range(4))
    found = [struct.unpack("<II", entry[8:16]) for entry in entries]
    return [(first * SECTOR, count * SECTOR) for first, count in found if count]


@dataclass
class Card:
    """A copy of the image, which a machine may write."""

    disk: Path

    def _tool(self, *words: str | Path) -> str:
        boot = partitions(self.disk)[BOOT][0]
        command = [str(words[0]), "-i", f"{self.disk}@@{boot}", *map(str, words[1:])]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace")
        if done.returncode != 0:
            raise FileNotFoundError(done.stderr.strip())
        return done.stdout

    def read(self, name: str) -> str:
        """What a file of the first partition says, as any computer reads it."""
        return self._tool("mtype", f"::{name}")

    def has(self, name: str) -> bool:
        """Whether the first partition has such a file."""
        try:
            return bool(self._tool("mdir", "-b", f"::{name}"))
        except FileNotFoundError:
            return False

    def write(self, file: Path, name: str) -> None:
        """Copy a file to the first partition."""
        self._tool("mcopy", "-o", file, f"::{name}")

    def change(self, half: int, script: str) -> None:
        """Change a half by commands of debugfs."""
        root = f"{self.disk}?offset={partitions(self.disk)[half][0]}"
        subprocess.run(["debugfs", "-w", root], input=script, text=True, check=True,
                       capture_output=True)  # fmt: skip


def card(image: Path, folder: Path, more_mb: int = 0) -> Card:
    """A card that is larger than the image by so much, whose system also tells of itself."""
    disk = folder / "card.img"
    subprocess.run(["cp", "--sparse=always", image, disk], check=True)
    os.truncate(disk, disk.stat().st_size + (more_mb << 20))
    unit = folder / "report.service"
    unit.write_text(REPORT)
    folder_there = "/etc/systemd/system"
    script = (
        f"write {unit} {folder_there}/report.service\n"
        f"write {Path(__file__).with_name('report.sh')} /usr/lib/report.sh\n"
        f"symlink {folder_there}/multi-user.target.wants/report.service ../report.service\n"
    )
    found = Card(disk)
    found.change(HALF_A, script)
    arguments = folder / "arguments.env"
    arguments.write_text(ARGUMENTS)
    found.write(arguments, arguments.name)
    return found


@dataclass
class Machine:
    """A machine that runs."""

    process: subprocess.Popen[bytes]
    log: Path
    ports: dict[int, int] = field(default_factory=dict)

    def said(self) -> str:
        """What its console has said."""
        return self.log.read_text(errors="replace")


@contextmanager
def machine(card: Card, folder: Path, log: Path | None = None) -> Iterator[Machine]:
    """Start it; what it writes is recorded in `log` (recorded.py)."""
    if not shutil.which("qemu-system-aarch64"):
        raise FileNotFoundError("qemu-system-aarch64: make test-image installs it")
    ports = {7702: free_port(), 7703: free_port()}
    forwards = "".join(f",hostfwd=tcp:127.0.0.1:{ours}-:{theirs}" for theirs, ours in ports.items())
    console = folder / "console.log"
    console.write_bytes(b"")
    drive = f"driver=raw,file.driver=file,file.filename={card.disk}"
    if log is not None:
        log.write_bytes(b"")
        drive = blockdev(card.disk, log)
    command = [
        "qemu-system-aarch64", "-M", "virt", "-cpu", "cortex-a72", "-m", "1024", "-smp", "2",
        "-accel", "tcg,thread=multi", "-nodefaults", "-display", "none",
        "-serial", f"file:{console}", "-bios", LOADER,
        "-blockdev", f"node-name=card,{drive}",
        "-device", "virtio-blk-pci,drive=card", "-device", "virtio-rng-pci",
        "-netdev", f"user,id=net{forwards}", "-device", "virtio-net-pci,netdev=net,romfile=",
    ]  # fmt: skip
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL)
    try:
        yield Machine(process, console, ports)
    finally:
        process.kill()
        process.wait()
