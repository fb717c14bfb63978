"""Find and run lightprobed: once over some files, or as long as a block lasts."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from lightprobe.errors import LightprobeError, UsageError
from lightprobe.estimate import Estimate
from lightprobe.reflection_map import ReflectionMap
from lightprobe.wire import Decoder, WireError

NAME = "lightprobed"
ENVIRONMENT = "LIGHTPROBED"
USAGE = 2  # exit code of a command line that makes no sense


class DaemonError(LightprobeError):
    """The daemon cannot be found, started, or has refused its work."""


class NotInstalledError(DaemonError):
    """There is no daemon on this machine; a client of another machine's needs none."""


def find() -> Path:
    """Path of lightprobed: $LIGHTPROBED, else beside this Python, else on PATH.

    Raises :class:`NotInstalledError`, or :class:`DaemonError` when the variable names no program.
    """
    wanted = os.environ.get(ENVIRONMENT)
    if wanted:
        if os.access(wanted, os.X_OK) and Path(wanted).is_file():
            return Path(wanted)
        raise DaemonError(f"{NAME}: ${ENVIRONMENT}={wanted}: no executable file there")
    beside = Path(sys.executable).parent / NAME
    if os.access(beside, os.X_OK):
        return beside
    on_path = shutil.which(NAME)
    if on_path:
        return Path(on_path)
    raise NotInstalledError(
        f"{NAME}: not found: tried ${ENVIRONMENT}, {beside} and PATH: build it with `make build`"
    )


def version(binary: Path) -> str:
    """First line of `lightprobed --version`."""
    done = subprocess.run([binary, "--version"], capture_output=True, text=True, timeout=20)
    if done.returncode != 0 or not done.stdout.strip():
        raise DaemonError(f"{binary}: --version: exit {done.returncode}: {_tail(done.stderr)}")
    return done.stdout.splitlines()[0].strip()


@dataclass(frozen=True)
class Once:
    """What `lightprobed --once` gave."""

    estimate: Estimate
    log: list[str]
    reflection_map: ReflectionMap | None  # only with --reflection-map


def estimate_once(arguments: list[str], timeout_s: float = 60) -> tuple[Estimate, list[str]]:
    """One estimate from `lightprobed ARGUMENTS --once --publish=stdout:`, and its log lines."""
    once = run_once(arguments, timeout_s)
    return once.estimate, once.log


def run_once(arguments: list[str], timeout_s: float = 60) -> Once:
    """Run `lightprobed ARGUMENTS --once --publish=stdout:`; DaemonError without an estimate."""
    command = [str(find()), *arguments, "--once", "--publish=stdout:"]
    try:
        done = subprocess.run(command, capture_output=True, timeout=timeout_s)
    except subprocess.TimeoutExpired:
        raise DaemonError(f"{NAME}: no estimate in {timeout_s:g} s: {' '.join(command)}") from None
    log = _tail(done.stderr.decode(errors="replace"))
    if done.returncode != 0:
        kind = UsageError if done.returncode == USAGE else DaemonError
        raise kind(log or f"{NAME}: exit {done.returncode}")
    try:
        messages = Decoder().feed(done.stdout)
    except WireError as error:
        raise DaemonError(
            f"{NAME}: stdout: {error}: are daemon and package of the same version?"
        ) from None
    maps = [message for message in messages if isinstance(message, ReflectionMap)]
    for message in messages:
        if isinstance(message, Estimate):
            return Once(message, log.splitlines(), maps[-1] if maps else None)
    raise DaemonError(f"{NAME}: exit 0 but no estimate among {len(messages)} messages\n{log}")


class Daemon:
    """lightprobed in the background, as long as the `with` block lasts."""

    def __init__(self, arguments: list[str], log: Path) -> None:
        """Take command line and the file that gets its log lines."""
        self.arguments = arguments
        self.log = log
        self.process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        """Start it. Clients connect with back-off, so there is nothing to wait for."""
        with open(self.log, "wb") as log:
            self.process = subprocess.Popen(
                [find(), *self.arguments], stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                start_new_session=True,
            )  # fmt: skip
        return self

    def __exit__(self, *_: object) -> None:
        """Ask it to end; insist after 5 s."""
        assert self.process is not None
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(5)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def check(self) -> None:
        """Raise :class:`DaemonError` with its last words when it has ended by itself."""
        if self.process is not None and self.process.poll() is not None:
            words = last_words(self.log)
            raise DaemonError(f"{NAME}: ended with status {self.process.returncode}: {words}")


def last_words(log: Path) -> str:
    """Give the last lines of a log file."""
    return _tail(log.read_text(errors="replace"))


def _tail(text: str, lines: int = 6) -> str:
    return "\n".join(text.strip().splitlines()[-lines:])
