"""What the button does: commands, as data, that run beside the LED and never hold it up."""

from __future__ import annotations

import contextlib
import os
import queue
import subprocess
import sys
import threading
from dataclasses import dataclass

from lightprobe.panel.patterns import State

#: How long a client may ask for the address after a short press.
PAIRING_S = 120
#: The connection of NetworkManager that is the access point.
ACCESS_POINT = "lightprobe"


@dataclass(frozen=True)
class Action:
    """One thing that a press asks for."""

    name: str
    title: str
    command: tuple[str, ...]
    limit_s: float
    next_step: str  # when it has failed
    shown: State | None = None  # while it runs
    undo: tuple[str, ...] = ()  # instead, where `ask` prints a word: it is on already
    ask: tuple[str, ...] = ()


_LIGHTPROBE = (sys.executable, "-P", "-m", "lightprobe")
_NMCLI = ("nmcli", "--wait", "40", "connection")

ACTIONS = {
    action.name: action
    for action in (
        Action(
            "pair", "let a client pair", (*_LIGHTPROBE, "pair", "--hand-out", str(PAIRING_S)),
            PAIRING_S + 30, "run sudo lightprobe pair", State.PAIRING,
        ),
        Action(
            "access-point", "access point on or off", (*_NMCLI, "up", "id", ACCESS_POINT), 60,
            f"is there a connection {ACCESS_POINT}? docs/users/panel.md",
            undo=(*_NMCLI, "down", "id", ACCESS_POINT),
            ask=("nmcli", "--get-values", "GENERAL.STATE", "connection", "show", ACCESS_POINT),
        ),
        Action(
            "shut-down", "shut down", ("systemctl", "poweroff"), 60, "run sudo poweroff",
            State.STOPPING,
        ),
    )
}  # fmt: skip


@dataclass(frozen=True)
class Done:
    """How an action has ended."""

    action: Action
    problem: str  # "": well
    is_on: bool | None = None  # of one with `undo`: how it is now, if that is known
    asked: bool = False  # only how it is; nothing was changed


class Runner:
    """Runs actions in threads of their own, each once at a time."""

    def __init__(self) -> None:
        """Nothing runs yet."""
        self._ended: queue.SimpleQueue[Done] = queue.SimpleQueue()
        self._running: set[tuple[str, bool]] = set()
        self._processes: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._closed = False

    def start(self, action: Action, only_ask: bool = False) -> bool:
        """Begin; False: it runs already. only_ask: how it is, and change nothing."""
        if (action.name, only_ask) in self._running:
            return False
        self._running.add((action.name, only_ask))
        work = threading.Thread(target=self._work, args=(action, only_ask), daemon=True)
        work.start()
        return True

    def ended(self) -> list[Done]:
        """Those that have ended since the last call."""
        done = []
        with contextlib.suppress(queue.Empty):
            while True:
                done.append(self._ended.get_nowait())
                self._running.discard((done[-1].action.name, done[-1].asked))
        return done

    def close(self) -> None:
        """End what still runs."""
        with self._lock:
            self._closed = True
            for process in self._processes:
                process.terminate()

    def _work(self, action: Action, only_ask: bool) -> None:
        try:
            is_on = bool(action.ask) and self._is_on(action)
            if not only_ask:
                self._run(action.undo if is_on else action.command, action.limit_s)
                is_on = not is_on
            done = Done(action, "", is_on if action.undo else None, only_ask)
        except _FailedError as error:
            problem = f"panel: {action.title}: {error}: {action.next_step}"
            done = Done(action, "" if only_ask else problem, asked=only_ask)
        self._ended.put(done)

    def _is_on(self, action: Action) -> bool:
        try:
            return "activated" in self._run(action.ask, action.limit_s)
        except _FailedError:  # the command itself says why
            return False

    def _run(self, command: tuple[str, ...], limit_s: float) -> str:
        """Run to its end and give what it printed; raises _FailedError."""
        try:
            with self._lock:
                if self._closed:
                    raise _FailedError(f"{command[0]}: the panel ends")
                process = subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT, text=True, errors="replace",
                    env=os.environ | {"LC_ALL": "C"},
                )  # fmt: skip
                self._processes.add(process)
        except OSError as error:
            raise _FailedError(f"{command[0]}: start: {error.strerror}") from None
        try:
            printed, _ = process.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            raise _FailedError(f"{command[0]}: no end in {limit_s:g} s") from None
        finally:
            with self._lock:
                self._processes.discard(process)
        if process.returncode:
            lines = printed.strip().splitlines()
            words = lines[-1] if lines else f"status {process.returncode}"
            raise _FailedError(f"{command[0]}: {words}")
        return printed


class _FailedError(Exception):
    pass
