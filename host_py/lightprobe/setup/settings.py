"""The daemon's configuration file, changed by name: comments and everything else stay as they are.

Lines are NAME = VALUE; "#" begins a comment line, " ;" a comment after a value.
"""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from lightprobe import daemon
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.whole_file import replacing

_LINE = re.compile(r"^\s*([a-z][a-z0-9-]*)\s*=(.*)$")
_EXAMPLE = re.compile(r"^\s*#\s*([a-z][a-z0-9-]*)\s*=")
_NAME = re.compile(r"[a-z][a-z0-9-]{0,40}")
_LONGEST_VALUE = 2047
_CHECK_S = 30.0
#: Where the service's copies are, and where they come from (packaging/systemd/drop-ins/wss.conf).
_CREDENTIALS, _PAIR = "/run/credentials/lightprobed.service", "/etc/lightprobe/pair"


def values(text: str) -> dict[str, list[str]]:
    """All settings of a configuration, by name, in their order."""
    found: dict[str, list[str]] = {}
    for line in text.split("\n"):
        match = _LINE.match(line)
        if match:
            value = re.split(r"\s;", match[2], maxsplit=1)[0].strip()
            found.setdefault(match[1], []).append(value)
    return found


def changed(text: str, wanted: Mapping[str, Sequence[str]]) -> str:
    """The configuration with other values of some settings; raises UsageError.

    No values: the setting goes, and the daemon's default counts. New lines stand where the former
    ones stood, else behind their example, else at the end.
    """
    end = "\r\n" if "\r\n" in text else "\n"
    lines = text.rstrip("\r\n").split(end) if text.strip() else []
    for name, wishes in wanted.items():
        if not _NAME.fullmatch(name):
            raise UsageError(f"setup: {name[:40]!r}: no name of a setting (lightprobed --help)")
        new = [f"{name} = {_checked(name, value)}" for value in wishes]
        places = [i for i, line in enumerate(lines) if _names(_LINE, line, name)]
        examples = [i for i, line in enumerate(lines) if _names(_EXAMPLE, line, name)]
        at = places[0] if places else examples[-1] + 1 if examples else len(lines)
        lines = [line for i, line in enumerate(lines) if i not in places]
        lines[at:at] = new
    return end.join(lines) + end


def _names(form: re.Pattern[str], line: str, name: str) -> bool:
    match = form.match(line)
    return match is not None and match[1] == name


def _checked(name: str, value: str) -> str:
    value = value.strip()
    if not value or len(value.encode()) > _LONGEST_VALUE:
        raise UsageError(f"setup: {name}: a value of 1 to {_LONGEST_VALUE} bytes")
    if not value.isprintable():
        raise UsageError(f"setup: {name}: a value is one line of text")
    if re.search(r"\s;", value):
        raise UsageError(f'setup: {name}: a value has no " ;" in it: a comment begins there')
    return value


def read(file: Path) -> str:
    """The configuration as it is; "" where there is none. Raises LightprobeError."""
    try:
        with open(file, encoding="utf-8-sig", newline="") as text:
            return text.read()
    except FileNotFoundError:
        return ""
    except (OSError, UnicodeDecodeError) as error:
        raise LightprobeError(f"setup: {file}: read: {error}") from None


def check(file: Path, text: str) -> None:
    """Have the daemon read a configuration for `file`; raises UsageError with its words.

    The service's copies of key, certificate and token are there only while it runs: they are looked
    for where they are copied from.
    """
    text = text.replace(_CREDENTIALS, _PAIR)
    try:
        handle, name = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.", suffix=".check")
    except OSError as error:
        raise LightprobeError(f"setup: {file.parent}: write: {error.strerror}") from None
    try:
        with open(handle, "w", encoding="utf-8", newline="") as out:
            out.write(text)
        done = subprocess.run(
            [daemon.find(), f"--config={name}", "--check-config"],
            capture_output=True, text=True, errors="replace", timeout=_CHECK_S,
        )  # fmt: skip
    except UnicodeEncodeError:
        raise UsageError(f"setup: {file}: it holds what is no text") from None
    except subprocess.TimeoutExpired:
        raise LightprobeError(f"setup: {file}: check: no answer in {_CHECK_S:g} s") from None
    finally:
        os.unlink(name)
    if done.returncode:
        words = (done.stderr or done.stdout).strip().replace(name, str(file))
        raise UsageError(words or f"setup: {file}: check: exit {done.returncode}")


def write(file: Path, text: str, *, keep: bool = True) -> None:
    """Replace the file: whole or not at all, also when the power fails.

    It keeps its owner and permissions. `keep`: the former one becomes FILE.old. Raises
    LightprobeError.
    """
    file = file.resolve()
    try:
        with replacing(file) as out:
            out.write(text.encode())
            before = file.stat() if file.exists() else None
            if before:
                os.fchown(out.fileno(), before.st_uid, before.st_gid)
            os.fchmod(out.fileno(), before.st_mode & 0o777 if before else 0o644)
            if before and keep:
                old, link = file.with_name(f"{file.name}.old"), file.with_name(f".{file.name}.link")
                link.unlink(missing_ok=True)
                os.link(file, link)
                link.replace(old)
    except (OSError, UnicodeEncodeError) as error:
        raise LightprobeError(f"setup: {file}: write: {error}") from None
