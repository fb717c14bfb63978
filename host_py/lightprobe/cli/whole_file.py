"""Files of commands: written whole or not at all."""

from __future__ import annotations

from pathlib import Path

from lightprobe.errors import LightprobeError


def write(command: str, file: Path, data: bytes) -> None:
    """Replace `file`; LightprobeError that names it when that fails: a former file is as it was."""
    half_done = file.with_name(f".{file.name}.part")
    try:
        half_done.write_bytes(data)
        half_done.replace(file)
    except OSError as error:
        half_done.unlink(missing_ok=True)
        raise LightprobeError(f"{command}: {file}: write: {error.strerror}") from None
