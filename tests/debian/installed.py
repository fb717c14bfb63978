#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The installed packages at work, inside the root, as root: `installed.py README`.

There is no systemd in the root: the unit's command is run with the user, groups and folder that the
unit asks systemd for. Instead of a camera there is a simulated one. The client is the README's.
"""

import re
import shutil
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

UNIT = Path("/usr/lib/systemd/system/lightprobed.service")
CONFIG = Path("/etc/lightprobe/lightprobed.conf")
FOLDER = Path("/run/lightprobe")
PYTHON = "/usr/lib/lightprobe/venv/bin/python"
#: One of the numbers that systemd gives to users that exist only while a service runs.
DYNAMIC_USER = 61184
LIMIT_S = 60
CHANGED = "# changed by the test\n"


def as_service_user(unit: str) -> list[str]:
    """What runs a command as the service does."""
    assert re.search(r"^DynamicUser=yes$", unit, re.M)
    groups = re.search(r"^SupplementaryGroups=(.*)$", unit, re.M)
    assert groups is not None
    return ["setpriv", f"--reuid={DYNAMIC_USER}", f"--regid={DYNAMIC_USER}", "--no-new-privs",
            f"--groups={groups[1].replace(' ', ',')}", "--bounding-set=-all"]  # fmt: skip


def wait_for(path: Path, process: "subprocess.Popen[bytes]") -> None:
    """Until a file exists, as long as the process that makes it runs."""
    end = time.monotonic() + LIMIT_S
    while not path.exists():
        if process.poll() is not None or time.monotonic() > end:
            sys.exit(f"{path} does not come")
        time.sleep(0.1)


def client(readme: str) -> str:
    """The README's client."""
    block = re.search(r"^```python\n(from lightprobe import Client\n.*?)^```$", readme, re.M | re.S)
    assert block is not None
    return block[1]


def main() -> None:
    """Fail unless the client receives a lamp."""
    for compiler in ("gcc", "cc", "clang", "make"):
        if shutil.which(compiler):
            sys.exit(f"{compiler} is installed: this is no machine without a compiler")
    unit = UNIT.read_text()
    service = as_service_user(unit)
    FOLDER.mkdir(exist_ok=True)
    shutil.chown(FOLDER, DYNAMIC_USER, DYNAMIC_USER)
    camera = FOLDER / "camera"
    text = CONFIG.read_text().replace("\nsource = v4l2:\n", f"\nsource = sim:{camera}\n")
    assert str(camera) in text
    CONFIG.write_text(CHANGED + text)
    command = re.search(r"^ExecStart=(.*)$", unit, re.M)
    assert command is not None
    words = command[1].split()
    subprocess.run([*words, "--check-config"], check=True)
    with ExitStack() as stack:

        def start(words: list[str]) -> "subprocess.Popen[bytes]":
            process = subprocess.Popen(words, stdout=subprocess.PIPE)
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        simulator = start(
            [*service, "lightprobe", "simulate", "--socket", str(camera), "--act-s", "0",
             "--scenes", "procedural:1", "--size", "960x480", "--rate", "10"]
        )  # fmt: skip
        wait_for(camera, simulator)
        daemon = start([*service, *words])
        wait_for(FOLDER / "lightprobe.sock", daemon)
        who = Path(f"/proc/{daemon.pid}/status").read_text()
        assert f"\nUid:\t{DYNAMIC_USER}\t" in who
        program = client(Path(sys.argv[1]).read_text())
        receiver = start(["timeout", str(LIMIT_S), PYTHON, "-u", "-c", program])
        assert receiver.stdout is not None
        line = receiver.stdout.readline().decode().strip()
        if not line:
            sys.exit("the README's client receives no lamp")
        print(f"the README's client received: {line}")


if __name__ == "__main__":
    main()
