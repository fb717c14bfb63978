"""The firmware in its simulated box on a serial line, and what is true of the box."""

from __future__ import annotations

import socket
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from harness import BUILD, LONG_S, wait_for
from lightprobe.mcu import messages as mcu

FIRMWARE = BUILD / "firmware"


def ask(control: socket.socket, line: str) -> str:
    """Send one command to a box; RuntimeError when it answers with an error."""
    control.sendall(line.encode() + b"\n")
    answer = b""
    while not answer.endswith(b"\n"):
        part = control.recv(65536)
        assert part, "the box has ended"
        answer += part
    if answer.startswith(b"error"):
        raise RuntimeError(f"{line}: {answer.decode()}")
    return answer.decode().strip()


def until(link: mcu.Mcu, wanted: Callable[[mcu.Event], bool]) -> mcu.Event:
    """Wait for an event of a box's firmware."""
    end = time.monotonic() + LONG_S
    while time.monotonic() < end:
        for event in link.events(0.5):
            if wanted(event):
                return event
            if time.monotonic() > end:
                break
    raise AssertionError("what was waited for did not come")


class Box:
    """The firmware as a process, or the flashed binary in simavr.

    In real time, or in lock-step: then its time passes only in :meth:`run`.
    """

    def __init__(self, target: str = "host", seed: int = 1, lock_step: bool = False) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="lp-box-")
        self.folder = Path(self._folder.name)
        self.tty = self.folder / "tty"
        self.target = target
        self.seed = seed
        self.lock_step = lock_step
        self.process: subprocess.Popen[bytes] | None = None
        self.control: socket.socket | None = None

    def start(self) -> Box:
        """Start it and wait for its line."""
        control = self.folder / "control"
        control.unlink(missing_ok=True)
        options = ["--pty", self.tty, "--control", control, "--seed", str(self.seed)]
        command: list[str | Path] = [FIRMWARE / "lightprobe-mcu-host-asan"]
        command += ["--lock-step"] if self.lock_step else []
        if self.target == "avr":
            command = [FIRMWARE / "lightprobe-mcu-simavr", FIRMWARE / "lightprobe-mcu.elf"]
            command += [] if self.lock_step else ["--real-time"]
        command += options
        self.process = subprocess.Popen(command)
        wait_for(control.exists, "the box's control socket")
        self.control = socket.socket(socket.AF_UNIX)
        self.control.connect(str(control))
        wait_for(self.tty.exists, "the box's line")
        return self

    def __enter__(self) -> Box:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()
        self._folder.cleanup()

    def stop(self) -> None:
        """End it, as a cut cable or supply would."""
        if self.control:
            self.control.close()
        if self.process:
            self.process.terminate()
            self.process.wait()

    def command(self, line: str) -> str:
        """Send one command; RuntimeError when it answers with an error."""
        assert self.control is not None
        return ask(self.control, line)

    def set(self, **numbers: float) -> None:
        """Set numbers of the box (firmware/board/host/world.h)."""
        for name, value in numbers.items():
            self.command(f"set {name} {value}")

    def run(self, us: int) -> None:
        """Let time pass, in lock-step."""
        self.command(f"run {us}")

    def flush(self) -> None:
        """Put on the line what the firmware has sent meanwhile: the daemon's time is there, too."""
        self.command("flush")

    def angles(self, from_ns: int, to_ns: int, count: int = 8) -> list[float]:
        """Where the wheel truly was, by CLOCK_MONOTONIC; in lock-step by the box's own time."""
        return [float(a) for a in self.command(f"angles {from_ns} {to_ns} {count}").split()]


def monotonic_ns(unix_ns: int) -> int:
    """CLOCK_MONOTONIC of a Unix time of now."""
    return unix_ns - time.time_ns() + time.monotonic_ns()
