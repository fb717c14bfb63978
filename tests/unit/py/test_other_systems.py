"""Windows and macOS, as far as Linux can play them: what they lack must not be missed."""

import json
import subprocess
import sys

import pytest
from lightprobe.cli import main

#: Modules that only Unix has, missing for this package's own code; what only Linux can install.
WINDOWS = """
import asyncio, builtins, os, signal, socketserver, sys
UNIX = {"grp", "pwd", "pty", "tty", "termios", "fcntl", "resource"}
real = builtins.__import__
def windows(name, globals=None, *rest):
    ours = (globals or {}).get("__name__", "").startswith("lightprobe")
    if name.split(".")[0] in {"smbus2", "gpiod"} or (ours and name.split(".")[0] in UNIX):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return real(name, globals, *rest)
builtins.__import__ = windows
for module, names in ((asyncio, ["open_unix_connection"]),
                      (socketserver, ["UnixStreamServer"]), (os, ["O_DIRECTORY", "geteuid"]),
                      (signal, ["pthread_sigmask", "SIGHUP"])):
    for name in names:
        delattr(module, name)
"""


def on_windows(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", WINDOWS + code], capture_output=True, text=True)


def command(*words: str) -> subprocess.CompletedProcess[str]:
    return on_windows(
        f"sys.argv = ['lightprobe', *{list(words)}]\nfrom lightprobe.__main__ import main\nmain()"
    )


def test_the_client_is_imported_and_speaks_tcp() -> None:
    done = on_windows(
        "from lightprobe import Client, ProbeError, ProbeTimeout\n"
        "with Client('tcp:127.0.0.1:9') as client:\n"
        "    try:\n        client.receive(0.5)\n"
        "    except ProbeTimeout as error:\n        print(error)\n"
        "try:\n    Client('unix:/x')\n"
        "except ProbeError as error:\n    print(error)\n"
    )
    assert done.returncode == 0, done.stderr
    assert "is lightprobed running" in done.stdout
    assert "no Unix sockets on this system: tcp:HOST:PORT" in done.stdout


@pytest.mark.parametrize(
    "name",
    [
        *main.Root.entries,
        *(f"align {n}" for n in main.Align.entries),
        *(f"calibrate {n}" for n in main.Calibrate.entries),
    ],
)
def test_every_command_has_its_help(name: str) -> None:
    done = command(*name.split(), "--help")
    assert done.returncode == 0, done.stderr
    assert f"lightprobe {name}" in done.stdout


@pytest.mark.parametrize("words", ["simulate", "demo", "control status x"])
def test_what_needs_unix_sockets_says_so(words: str) -> None:
    done = command(*words.split())
    assert done.returncode == 1
    assert "this system has no Unix sockets: use Linux or macOS" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_panel_without_gpio_lines_says_what_it_needs() -> None:
    done = command("panel")
    assert done.returncode == 1
    assert "need Linux and gpiod" in done.stderr
    assert done.stderr.count("\n") == 1


def test_doctor_goes_on() -> None:
    done = command("doctor", "tcp:127.0.0.1:9", "--wait", "0.2", "--json")
    assert done.returncode == 1
    found = {one["check"]: one["verdict"] for one in json.loads(done.stdout)["findings"]}
    assert found["connection"] == "fail"
    assert found["python package"] == "ok"


def test_calibration_files_are_written(tmp_path) -> None:
    path = tmp_path / "ring.ini"
    done = on_windows(
        "from pathlib import Path\nfrom lightprobe.calibrate import files\n"
        f"files.save(Path({str(path)!r}), 'a'); print(files.save(Path({str(path)!r}), 'b'))"
    )
    assert done.returncode == 0, done.stderr
    assert path.read_text() == "b"
    assert path.with_name("ring.ini.~1~").read_text() == "a"
