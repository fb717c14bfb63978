#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What a user does after `make install`, in the root: pair, start what it prints, open the page.

Instead of a camera there is a simulated one, from the installed command, too. Everything that is
used here is installed, except for what steers Chromium (page.mjs).
"""

import re
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

HERE = Path(__file__).resolve().parent
LIMIT_S = 120


def wait_for(path: Path, process: "subprocess.Popen[bytes]") -> None:
    """Until a file exists, as long as the process that makes it runs."""
    end = time.monotonic() + LIMIT_S
    while not path.exists():
        if process.poll() is not None or time.monotonic() > end:
            sys.exit(f"{path} does not come")
        time.sleep(0.1)


def paired() -> tuple[str, str]:
    """The address that `lightprobe pair` prints, and the command that serves it."""
    text = subprocess.run(["lightprobe", "pair"], check=True, stdout=subprocess.PIPE).stdout
    told = text.decode()
    print(told, flush=True)
    address = re.search(r"^address +(\S+)$", told, re.M)
    command = re.search(r"^next .*\n\n(.*)\n", told, re.M)
    if address is None or command is None:
        sys.exit("lightprobe pair prints no address, or no command")
    return address[1], command[1]


def main() -> None:
    """Fail unless the page shows the simulated light."""
    address, command = paired()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))

        def start(words: list[str]) -> "subprocess.Popen[bytes]":
            process = subprocess.Popen(words)
            stack.callback(process.wait)
            stack.callback(process.terminate)
            return process

        camera = folder / "camera"
        simulator = start(
            ["lightprobe", "simulate", "--socket", str(camera), "--scenes", "procedural:1",
             "--act-s", "0", "--size", "960x480", "--rate", "10"]
        )  # fmt: skip
        wait_for(camera, simulator)
        served = command.replace("--source=v4l2:", f"--source=sim:{camera}")
        if served == command:
            sys.exit(f"the command names no camera to replace: {command}")
        start(["sh", "-c", f"exec {served}"])
        done = subprocess.run(["node", str(HERE / "page.mjs"), address])
    sys.exit(done.returncode)


main()
