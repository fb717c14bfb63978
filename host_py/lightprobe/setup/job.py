"""One running task: its process, what it says, and the Enter that it waits for."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
import tempfile
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lightprobe.setup.tasks import Task

_MOST_LINES, _LONGEST_LINE = 2000, 2000
_END_S = 30.0


@dataclass(eq=False)
class Job:
    """A task that runs or has run. Use within one event loop."""

    task: Task
    writes: Path | None  # camera file
    folder: tempfile.TemporaryDirectory[str] = field(
        default_factory=lambda: tempfile.TemporaryDirectory(prefix="lightprobe-setup-")
    )
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=_MOST_LINES))
    said: int = 0  # lines so far, also those that are gone
    status: int | None = None  # exit status; None: it runs
    began_s: float = field(default_factory=time.monotonic)
    began_ns: int = field(default_factory=time.time_ns)
    ended_s: float | None = None
    _process: asyncio.subprocess.Process | None = None
    _stopped: bool = False
    _answered: int = 0  # lines that had been said

    async def run(self, words: Sequence[str]) -> None:
        """Run `lightprobe WORDS` to its end; what it says becomes lines."""
        environment = os.environ | {"COLUMNS": "100", "NO_COLOR": "1", "PYTHONUNBUFFERED": "1"}
        if self._stopped:  # before it has begun
            self.end(1)
            return
        try:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable, "-P", "-m", "lightprobe", *words,
                stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.STDOUT, env=environment, cwd=self.folder.name,
                start_new_session=True,
            )  # fmt: skip
            if self._stopped:
                await self.stop()
            output = self._process.stdout
            assert output is not None
            rest = b""
            while data := await output.read(4096):
                *whole, rest = (rest + data).split(b"\n")
                rest = rest[-_LONGEST_LINE:]
                for line in whole:
                    self.say(line.decode(errors="replace").rstrip())
            if rest:
                self.say(rest.decode(errors="replace").rstrip())
            self.end(await self._process.wait())
        except OSError as error:
            self.say(f"setup: {self.task.name}: start: {error.strerror}")
            self.end(1)

    def end(self, status: int) -> None:
        """It has ended so."""
        self.status, self.ended_s = status, time.monotonic()

    def say(self, line: str) -> None:
        """Add a line."""
        self.lines.append(line[:_LONGEST_LINE])
        self.said += 1

    @property
    def waits(self) -> bool:
        """Whether it has asked, and nobody has answered."""
        since = min(self.said - self._answered, 2)  # a question may be folded
        asked = since > 0 and "Enter" in " ".join(list(self.lines)[-since:])
        return self.task.asks and asked and self.status is None

    def answer(self, skip: bool) -> bool:
        """Press Enter; skip: leave the step out. False: it has not asked."""
        if not (self.waits and self._process and self._process.stdin):
            return False
        self._answered = self.said
        self._process.stdin.write(b"s\n" if skip else b"\n")
        return True

    async def stop(self) -> None:
        """End it, as Ctrl-C does, and in the end without asking, unless it must not be cut off."""
        self._stopped = True
        process = self._process
        if process is None or process.returncode is not None:
            return
        numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGKILL]
        for number in numbers[:1] if self.task.ends_by_itself else numbers:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, number)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(process.wait(), _END_S)
                return

    def _has_written(self) -> bool:
        if self.writes is None or self.status is None or not self.writes.is_file():
            return False
        return self.writes.stat().st_mtime_ns >= self.began_ns

    def told(self, after: int) -> dict[str, Any]:
        """What the page shows: lines behind the first `after`, and how it stands."""
        new = max(self.said - max(after, self.said - len(self.lines)), 0)
        ended_s = self.ended_s if self.ended_s is not None else time.monotonic()
        there = [name for name in self.task.files if (Path(self.folder.name) / name).is_file()]
        return {
            "task": self.task.name, "status": self.status, "said": self.said, "waits": self.waits,
            "lines": list(self.lines)[len(self.lines) - new :],
            "seconds": ended_s - self.began_s, "files": there,
            "written": str(self.writes) if self._has_written() else None,
        }  # fmt: skip
