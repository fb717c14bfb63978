"""Files that are the old ones or the new ones at any moment, also when the power fails."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def replacing(file: Path) -> Iterator[BinaryIO]:
    """Let the block write what takes the file's place when the block ends, on the disk.

    It is readable for its owner alone, unless the block changes that. If anything goes wrong the
    former file stays. Raises OSError.
    """
    part = file.with_name(f".{file.name}.part")
    try:
        part.unlink(missing_ok=True)
        with open(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as out:
            yield out
            out.flush()
            os.fsync(out.fileno())
        part.replace(file)
        settle(file.parent)
    finally:
        part.unlink(missing_ok=True)


def settle(folder: Path) -> None:
    """Have names that were changed in a folder on the disk; raises OSError."""
    if not hasattr(os, "O_DIRECTORY"):  # Windows: folders are not opened, nor need they be
        return
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
