#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Which half of the card starts.

RAUC, which writes an update to the other half, asks `update.py get-primary`, `set-primary HALF`,
`get-state HALF` and `set-state HALF good|bad`, as it asks any boot loader (its custom backend).
`update.py confirm`, when a half was started as a trial: it is kept once it is well; otherwise the
machine starts again, with the former half.

The boot loader's script (boot.cmd) reads two files of the card's first partition: `half.env` says
which half is kept, and `try`, if it is there, that the other one starts once, as a trial.
"""

from __future__ import annotations

import http.client
import os
import ssl
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

from appliance import BOOT, SERVICES, STATE, Run, run_now, writable, write_whole

HALVES = ("a", "b")
KEPT, TRY = "half.env", "try"
GOOD, BAD = "good", "bad"
#: A trial must be well for so long, within so long.
WELL_S, PATIENCE_S = 20.0, 300.0
POLL_S = 2.0
PAGE = "https://127.0.0.1:7703/setup.html"
UNITS = (*SERVICES, "NetworkManager")
#: The units that ran when the update was written: what the owner has broken is no fault of it.
NEEDS = "update-needs"
#: Is there while a half is on trial; the set-up page begins nothing meanwhile.
TRIAL = Path("/run/lightprobe-trial")


class Loader:
    """The two files; the folder and programs are given, so that it can be tested."""

    def __init__(
        self, boot: Path = BOOT, state: Path = STATE, cmdline: str | None = None, run: Run = run_now
    ) -> None:
        """`cmdline`: what the kernel was started with."""
        words = (Path("/proc/cmdline").read_text() if cmdline is None else cmdline).split()
        self.boot, self.state, self.run = boot, state, run
        self.running = "b" if "rauc.slot=b" in words else "a"

    @property
    def kept(self) -> str:
        """The half that starts when nothing is tried, as the boot loader reads it."""
        try:
            lines = (self.boot / KEPT).read_bytes().replace(b"\r\n", b"\n").split(b"\n")
        except OSError:
            return "a"
        said = [line for line in lines if line.startswith(b"half=")]
        return "b" if said and said[-1] == b"half=b" else "a"

    @property
    def trial(self) -> str | None:
        """The half that starts once, at the next start."""
        return other(self.kept) if (self.boot / TRY).exists() else None

    def is_good(self, half: str) -> bool:
        """Whether it may start."""
        return half in (self.kept, self.trial)

    def start_next(self, half: str) -> None:
        """Start it next; if it is not the one that is kept, once. Raises OSError."""
        needed = [unit for unit in UNITS if self._is_active(unit)]
        write_whole(self.state / NEEDS, "".join(f"{unit}\n" for unit in needed))
        with writable(self.boot, self.run):
            if half == self.kept:
                (self.boot / TRY).unlink(missing_ok=True)
            else:
                self._write(TRY, b"once\n")

    def set_good(self, half: str) -> None:
        """Keep it, if it runs: that it runs well is the evidence. Raises OSError."""
        if half == self.running != self.kept:
            with writable(self.boot, self.run):
                self._write(KEPT, f"half={half}\n".encode())

    def set_bad(self, half: str) -> None:
        """It is being written, or does not work. Raises OSError."""
        if half == self.kept:
            raise OSError(f"half {half} is the one that starts: there is no other")
        if self.trial == half:
            self.start_next(self.kept)

    def _write(self, name: str, text: bytes) -> None:
        """In place: FAT has no journal, but one sector is written or not."""
        descriptor = os.open(self.boot / name, os.O_WRONLY | os.O_CREAT, 0o600)
        try:
            os.write(descriptor, text)
            os.ftruncate(descriptor, len(text))
            os.fsync(descriptor)
        finally:
            os.close(descriptor)

    def confirm(self) -> bool:
        """Keep a trial that is well for a while; False: another start is wanted."""
        began = since = time.monotonic()
        while (now := time.monotonic()) - began < PATIENCE_S:
            if not self.well():
                since = now
            elif now - since >= WELL_S and self._keep():
                return True
            time.sleep(POLL_S)
        return False

    def _keep(self) -> bool:
        try:
            self.run(["rauc", "status", "mark-good"])
        except (OSError, subprocess.SubprocessError) as failure:
            print(f"lightprobe: the update is well, and cannot be kept: {failure}", flush=True)
        return self.running == self.kept

    def well(self) -> bool:
        """Whether what ran before the update runs, there is a network, and the page answers.

        The network may be the probe's own.
        """
        try:
            needed = (self.state / NEEDS).read_text().split()
        except OSError:
            needed = list(UNITS)
        return all(self._is_active(unit) for unit in needed) and self._answers()

    def _is_active(self, unit: str) -> bool:
        """Each by itself: of several at once, one would be enough for systemctl."""
        try:
            self.run(["systemctl", "is-active", unit])
        except (OSError, subprocess.SubprocessError):
            return False
        return True

    def _answers(self) -> bool:
        try:
            networks = self.run(["nmcli", "-t", "-f", "DEVICE", "connection", "show", "--active"])
            # The certificate is the probe's own, and the question stays in this machine.
            urllib.request.urlopen(PAGE, timeout=10, context=ssl._create_unverified_context())
        except (OSError, http.client.HTTPException, subprocess.SubprocessError):
            return False
        return bool(set(networks.split()) - {"lo"})


def other(half: str) -> str:
    """Give the other half."""
    return "b" if half == "a" else "a"


def answer(loader: Loader, words: list[str]) -> str | None:
    """Do what RAUC asks, and give what it wants to hear; None: that is nothing that it asks."""
    match words:
        case ["get-primary"]:
            return loader.trial or loader.kept
        case ["get-current"]:
            return loader.running
        case ["set-primary", half] if half in HALVES:
            loader.start_next(half)
            return ""
        case ["get-state", half] if half in HALVES:
            return GOOD if loader.is_good(half) else BAD
        case ["set-state", half, state] if half in HALVES and state in (GOOD, BAD):
            (loader.set_good if state == GOOD else loader.set_bad)(half)
            return ""
    return None


def main() -> None:
    """Do one of them."""
    loader = Loader()
    if sys.argv[1:] == ["confirm"]:
        TRIAL.touch()
        if not loader.confirm():
            sys.exit("lightprobe: the update is not well: the former version starts")
        TRIAL.unlink()
        return
    try:
        said = answer(loader, sys.argv[1:])
    except OSError as failure:
        sys.exit(f"update.py: {failure}")
    if said is None:
        sys.exit("update.py get-primary|set-primary|get-state|set-state|get-current|confirm")
    print(said)


if __name__ == "__main__":
    main()
