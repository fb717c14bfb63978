"""Libraries of others without the lines that they write to standard error themselves."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_STDERR = 2
#: It is the process's: one at a time takes it away.
_LOCK = threading.Lock()


@contextmanager
def quiet() -> Iterator[None]:
    """Discard what is written to standard error, by C and C++ code too, and by other threads."""
    with _LOCK:
        try:
            kept = os.dup(_STDERR)
        except OSError:  # closed: there is nothing to write to
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, _STDERR)
            yield
        finally:
            os.dup2(kept, _STDERR)
            os.close(kept)
            os.close(nowhere)
