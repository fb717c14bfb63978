"""The command `lightprobe`, also as `python -m lightprobe`."""

from __future__ import annotations

import errno
import os
import signal
import sys
from types import FrameType

from lightprobe.errors import LightprobeError
from lightprobe.installation import install_extras

_INTERRUPTED = 130  # as shells count Ctrl-C


def main() -> None:
    """Run; an error is one message on stderr and an exit code: 1 failed, 2 makes no sense."""
    for number in (signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
        if signal.getsignal(number) is signal.SIG_DFL:  # nohup has its own
            signal.signal(number, _end)
    try:
        sys.exit(_run())
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)


def _end(number: int, _: FrameType | None) -> None:
    """End as Ctrl-C does: what a command has started (simulator, daemon) ends with it."""
    sys.exit(128 + number)


def _run() -> int:
    try:
        from lightprobe.cli.main import run
    except ModuleNotFoundError as error:
        if error.name not in ("typer", "click", "rich"):
            raise
        return _fail(
            f"the command needs {error.name}, which is not installed: {install_extras('cli')}"
        )
    try:
        status = run()
        sys.stdout.flush()
        return status
    except LightprobeError as error:
        return _fail(str(error), error.exit_code)
    except OSError as error:  # of standard output; commands name their own files
        _forget_output()
        if error.errno == errno.EPIPE:  # whoever read it has seen enough
            return 1
        return _fail(f"{error.filename or 'output'}: {error.strerror or error}")


def _fail(message: str, status: int = 1) -> int:
    print(f"lightprobe: {message}", file=sys.stderr)
    return status


def _forget_output() -> None:
    """What is left to write goes nowhere, so that Python does not try again when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


if __name__ == "__main__":
    main()
