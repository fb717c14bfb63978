#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The README's commands as a new user gives them, on a clean Debian: `run.py 12 13`.

A root in a folder, made by mmdebstrap, gets what is committed here, and a user who may use sudo.
That user builds, installs, pairs, and opens the address that `lightprobe pair` prints in the
release's own Chromium. How apt, pip and npm reach their registries is taken over from this machine.
"""

import argparse
import os
import re
import subprocess
import sys
from pathlib import Path

REPO = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPO / "packaging"))

from clean_debian import (  # noqa: E402
    CLONE,
    RELEASES,
    USER,
    Root,
    StepError,
    is_committed,
    make_root,
    own,
    remove,
    run,
    unpack_commit,
)

#: What the README expects of a user's system.
EXPECTED = "git,make,sudo"
#: What is printed at the end, as an answer to "which versions?".
PACKAGES = ("gcc", "libopencv-core-dev", "libcamera-dev", "libgpiod-dev", "libwebsockets-dev",
            "nanopb", "nodejs", "python3", "chromium")  # fmt: skip


def make_users_root(release: str, out: Path) -> Root:
    """A clean Debian, with the committed files as the clone of a user who may use sudo."""
    root = make_root(release, out, variant="minbase", include=EXPECTED)
    (root.folder / "etc/sudoers.d" / USER).write_text(f"{USER} ALL=(ALL) NOPASSWD: ALL\n")
    unpack_commit(root.folder / CLONE[1:])
    own(root.folder)
    return root


#: Name, what the user gives, and in which network.
STEPS = (
    ("make build", "make build", "host"),
    ("sudo make install", "sudo make install", "host"),
    ("the installed command", "lightprobe --version", "host"),
    ("the installed configuration",
     "lightprobed --config=/etc/lightprobe/lightprobed.conf --check-config", "host"),
    ("Chromium", "packaging/apt-install packaging/apt/web.txt", "host"),
    ("lightprobe pair, and its page", "python3 tests/debian/page.py", "own"),
)  # fmt: skip


def versions(root: Root) -> str:
    """The release and its packages, as a sentence."""
    command = root.command("dpkg-query", "-W", "-f", "${Package} ${Version}\n", *PACKAGES)
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    text = re.sub(r" (?:\d+:)?(.*)-.*", r" \1", text)  # without epoch and Debian's revision
    debian = (root.folder / "etc/debian_version").read_text().strip()
    return f"Debian {debian}: {', '.join(text.splitlines())}"


def check(release: str, out: Path) -> str:
    """All steps on one release; returns what has been seen."""
    remove(out)
    out.mkdir(parents=True)
    root = make_users_root(release, out)
    for number, (name, words, network) in enumerate(STEPS):
        command = root.command("sh", "-c", words, network=network)
        seen = run(f"Debian {release}: {name}", command, out / f"{number}.log")
    shown = next(line for line in seen.splitlines() if line.startswith("the page"))
    told = f"{versions(root)}; {shown}"
    remove(root.folder)
    return told


def main() -> None:
    """Check the releases that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("releases", nargs="+", choices=RELEASES)
    parser.add_argument("--out", type=Path, required=True, help="folder for roots and logs")
    options = parser.parse_args()
    if os.geteuid() != 0:
        sys.exit("test-debian: only root can make a root: sudo -E make test-debian")
    if not is_committed():
        print("test-debian: what is not committed is not tested")
    try:
        told = [check(release, options.out.resolve() / release) for release in options.releases]
    except StepError as failure:
        sys.exit(f"test-debian: {failure}")
    print("\n".join(told))


main()
