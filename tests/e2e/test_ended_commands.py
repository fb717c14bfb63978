"""Commands that are ended leave nothing behind: no simulator, no daemon, no folder."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
LONG_S = 60


def descendants(pid: int) -> set[int]:
    """Processes that a process has started, and those that they have."""
    parents = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it has ended
        parents[int(folder.name)] = int(words[1])
    found, now = set(), {pid}
    while now:
        now = {child for child, parent in parents.items() if parent in now}
        found |= now
    return found


def runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_for(condition, may_come, what):
    deadline = time.monotonic() + LONG_S
    while not (found := condition()):
        assert may_come(), what
        assert time.monotonic() < deadline, what
        time.sleep(0.1)
    return found


#: Arguments, and how many processes the command starts at least.
COMMANDS = {
    "demo": (["demo", "--scenes", "room", "--output", "{folder}"], 3),
    "check-camera": (["check-camera", "sim:{folder}/nobody", "--patience-s", "100"], 1),
    "calibrate": (["calibrate", "exposure", "sim:{folder}/nobody", "--patience-s", "100"], 1),
}  # fmt: skip


@pytest.mark.usefixtures("released_daemon")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP], ids=lambda one: one.name)
@pytest.mark.parametrize("name", COMMANDS)
def test_what_a_command_has_started_ends_with_it(name, number):
    arguments, most = COMMANDS[name]
    with tempfile.TemporaryDirectory(prefix="lp-") as folder:  # socket paths are short
        process = subprocess.Popen(
            [LIGHTPROBE, *(one.format(folder=folder) for one in arguments)],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            env=os.environ | {"TMPDIR": folder}, start_new_session=True,
            # Where `nohup` has started the tests, it would be ignored.
            preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),
        )  # fmt: skip
        process.stdin.write("\n")  # go on
        process.stdin.flush()
        started = wait_for(
            lambda: len(found := descendants(process.pid)) >= most and found,
            lambda: process.poll() is None, f"{name} starts processes",
        )  # fmt: skip
        time.sleep(0.5)  # a child that is there may not be known to its parent yet
        process.send_signal(number)
        _, err = process.communicate(timeout=LONG_S)
        assert process.returncode == 128 + number, err
        assert "Traceback" not in err
        wait_for(lambda: not any(map(runs, started)), lambda: True, f"{name}: all have ended")
        assert list(Path(folder).glob("lightprobe-*")) == []
