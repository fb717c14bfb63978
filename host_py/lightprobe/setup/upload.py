"""A file that the owner sends to the probe, for a task that uses it once."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
from pathlib import Path

from aiohttp import web

from lightprobe.errors import LightprobeError, UsageError

#: Left free on the card, for settings and calibration.
_RESERVE_BYTES = 16 << 20
#: A sender that is silent for so long has gone.
_SILENT_S = 30.0


class Upload:
    """At most one file. Use within one event loop."""

    def __init__(self, folder: Path) -> None:
        """`folder`: where there is room for it; what an earlier run left there goes."""
        self.path = folder / "upload"
        self._part = folder / ".upload.part"

    def remove(self) -> None:
        """It is used, or not wanted."""
        for file in (self.path, self._part):
            with contextlib.suppress(OSError):
                file.unlink()

    async def receive(self, request: web.Request) -> None:
        """Take the body of a request as the file; a part of it is not kept.

        Raises UsageError, or LightprobeError where there is no room.
        """
        length = request.content_length
        if not length:
            raise UsageError("setup: upload: expected a file, with its length")
        self.remove()
        try:
            free = shutil.disk_usage(self._part.parent).free - _RESERVE_BYTES
            if length > free:
                raise LightprobeError(
                    f"setup: upload: {length / 1e6:.0f} MB, and there is room for "
                    f"{max(free, 0) / 1e6:.0f} MB: use a larger card, of 8 GB or more"
                )
            await self._write(request, length)
        except OSError as error:
            raise LightprobeError(f"setup: upload: {error.strerror}") from None
        finally:
            self._part.unlink(missing_ok=True)

    async def _write(self, request: web.Request, length: int) -> None:
        received = 0
        descriptor = os.open(self._part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "wb") as writing:
            while data := await _some(request):
                await asyncio.to_thread(writing.write, data)
                received += len(data)
        if received != length:
            raise UsageError(f"setup: upload: {received} of {length} bytes arrived: send it again")
        self._part.rename(self.path)


async def _some(request: web.Request) -> bytes:
    """What has arrived; nothing at the end. Raises UsageError when the sender has gone."""
    try:
        async with asyncio.timeout(_SILENT_S):
            return await request.content.readany()
    except TimeoutError:
        raise UsageError(f"setup: upload: nothing came for {_SILENT_S:.0f} s: again") from None
