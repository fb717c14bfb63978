# SPDX-License-Identifier: Apache-2.0
"""A recording: what `lightprobe replay` and `lightprobe align` read from a file of anybody's."""

import os
from contextlib import suppress
from pathlib import Path

from lightprobe import recording
from lightprobe.errors import LightprobeError

#: More are not looked at: each is read like the one before.
MOST_MESSAGES = 10_000


def one_input(data: bytes) -> None:
    """Read the bytes as a file; only LightprobeError may come out."""
    file = os.memfd_create("recording")
    try:
        os.write(file, data)
        notes: list[str] = []
        with suppress(LightprobeError):
            for count, recorded in enumerate(recording.read(Path(f"/proc/self/fd/{file}"), notes)):
                assert recorded.time_ns >= 0
                if count > MOST_MESSAGES:
                    break
        assert all(notes)
    finally:
        os.close(file)
