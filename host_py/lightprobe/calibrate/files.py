"""Calibration files: written whole or not at all, and the former one is kept.

Every kind of calibration writes text through :func:`save`. What a file holds, and the version of
its format, is the business of the kind.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from lightprobe.errors import LightprobeError
from lightprobe.whole_file import settle


class CalibrationError(LightprobeError):
    """A calibration that cannot be had, read or kept; names object, stage and next step."""


def save(path: Path, text: str) -> Path | None:
    """Write `text` to `path`; gives where the former file is kept, None when there was none.

    The new file appears at once and whole, and is on the disk when this returns: a power cut leaves
    the old one or the new one. The former becomes PATH.~1~, PATH.~2~, …, the highest the newest.
    Raises :class:`CalibrationError`; the former file is then still in its place.
    """
    temporary: str | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        with open(handle, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, _mode(path))
        kept = _keep(path)
        os.replace(temporary, path)
        settle(path.parent)
    except OSError as error:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
        raise CalibrationError(
            f"calibrate: {path}: write: {error.strerror}: "
            "free some space, or name another file with --output"
        ) from None
    return kept


def _mode(path: Path) -> int:
    """Permissions of the former file, or those of a new one."""
    if path.exists():
        return path.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def _keep(path: Path) -> Path | None:
    """Give the former file one more name."""
    if not path.exists():
        return None
    number = 1 + max((_number(old) for old in path.parent.glob(f"{path.name}.~*~")), default=0)
    kept = path.with_name(f"{path.name}.~{number}~")
    os.link(path, kept)
    return kept


def _number(path: Path) -> int:
    text = path.name.rpartition(".~")[2].removesuffix("~")
    return int(text) if text.isdecimal() else 0
