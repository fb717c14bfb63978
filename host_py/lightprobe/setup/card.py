"""A probe that runs from a card of `make image`: which version it is, and updates by RAUC."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from lightprobe.errors import LightprobeError

#: Written by `make image`.
VERSION = Path("/usr/share/lightprobe/image-version")
#: Is there while an update is on trial (update.py of the image).
TRIAL = Path("/run/lightprobe-trial")
_PROGRESS = re.compile(r"\s*(\d{1,3})% (.+)")
_LAST_ERROR = re.compile(r"LastError: (.*?)\s*(?:Installing `.*` failed\s*)?$", re.S)
#: What RAUC says, and what that means to the owner.
_MEANING = (
    (r"bundle format|not a bundle", "it is no update, or only a part of one: fetch it again"),
    (r"signature", "it is not signed with the key of this image: take one of its maker"),
    (r"compatible", "it is for another machine"),
    (r"No space", "the card is full"),
)


@dataclass(frozen=True)
class Halves:
    """The two systems of the card."""

    version: str  # of the one that runs
    running: str  # a or b
    starts_next: str  # after a restart
    kept: bool  # False: the one that runs is a trial, until it has been well for a while


def version() -> str | None:
    """Version of the card's image; None: this machine was not started from one."""
    try:
        return VERSION.read_text().strip()
    except OSError:
        return None


def can_update() -> bool:
    """Whether this machine takes updates of its whole system."""
    return version() is not None and shutil.which("rauc") is not None


def ensure_settled() -> None:
    """Raise LightprobeError while an update is on trial: what stops the daemon would end it."""
    if TRIAL.exists():
        raise LightprobeError(
            "setup: an update is being tried: wait 20 seconds, until the probe has run so long"
        )


def halves() -> Halves:
    """Ask RAUC how the card stands; raises LightprobeError."""
    shown = json.loads(_rauc("status", "--output-format=json"))
    running, primary = shown["booted"], shown["boot_primary"]
    slots = {name: slot for one in shown["slots"] for name, slot in one.items()}
    state = {slot["bootname"]: slot["boot_status"] for slot in slots.values()}
    next_ = slots[primary]["bootname"] if primary in slots else running
    return Halves(version() or "", running, next_, state.get(running) == "good")


def install(file: Path, tell: Callable[[int, str], None]) -> None:
    """Write an update to the half that does not run, which then starts next, as a trial.

    `tell`: percent and step. Raises LightprobeError; then the card starts as before.
    """
    if not can_update():
        raise LightprobeError(
            "update: this machine was not started from a card of `make image`: update its Debian "
            "packages, or its repository (docs/users/image.md)"
        )
    if not file.is_file():
        raise LightprobeError(f"update: {file}: no such file")
    said = []
    with subprocess.Popen(
        ["rauc", "install", str(file.resolve())], stdin=subprocess.DEVNULL, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, errors="replace", start_new_session=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        for line in process.stdout:
            said.append(line)
            if match := _PROGRESS.match(line):
                tell(int(match[1]), match[2].strip().rstrip("."))
    if process.returncode:
        raise LightprobeError(f"update: {file.name}: {why(''.join(said))}")


def why(said: str) -> str:
    """Say why RAUC has refused, in words for the owner, with its own behind them."""
    match = _LAST_ERROR.search(said)
    words = " ".join((match[1] if match else said).split())[-400:] or "no reason was given"
    meaning = next((meant for form, meant in _MEANING if re.search(form, words, re.I)),
                   "the probe starts as before")  # fmt: skip
    return f"{meaning} (RAUC: {words})"


def _rauc(*words: str) -> str:
    try:
        done = subprocess.run(["rauc", *words], capture_output=True, text=True, errors="replace")
    except OSError as error:
        raise LightprobeError(f"update: rauc: start: {error.strerror}") from None
    if done.returncode:
        raise LightprobeError(f"update: rauc {words[0]}: {(done.stderr or done.stdout).strip()}")
    return done.stdout
