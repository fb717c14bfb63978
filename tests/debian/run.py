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
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
REPO = HERE.parents[1]
RELEASES = {"12": "bookworm", "13": "trixie"}
#: What the README expects of a user's system.
EXPECTED = "git,make,sudo"
USER, HOME = "probe", "/home/probe"
CLONE = f"{HOME}/lightprobe"
PATH = "/usr/local/bin:/usr/bin:/bin"
#: How this machine's pip and npm reach their registries, and where the root has the files.
REGISTRIES = re.compile(r"(?i)PIP_.*|npm_config_.*|NODE_EXTRA_CA_CERTS|SSL_CERT_FILE|.*_PROXY")
GIVEN = "etc/test-debian"
ACQUIRE = re.compile(r'Acquire::(?:[\w-]*proxy|https?|Check-\w|Retries)[^"]*"[^"]+";', re.I)
#: What is printed at the end, as an answer to "which versions?".
PACKAGES = ("gcc", "libopencv-core-dev", "libcamera-dev", "libgpiod-dev", "libwebsockets-dev",
            "nanopb", "nodejs", "python3", "chromium")  # fmt: skip
SHOWN_LINES = 40


class StepError(Exception):
    """A step has failed; the text says which one, and where its output is."""


@dataclass(frozen=True)
class Root:
    """A Debian in a folder."""

    release: str
    folder: Path
    environment: tuple[str, ...]  # NAME=VALUE

    def command(self, *words: str, network: str = "host") -> list[str]:
        """What runs a command in the clone, as the user."""
        environment = ("env", "-i", "-C", CLONE, *self.environment)
        return [str(HERE / "enter"), network, str(self.folder), USER, *environment, *words]


def run(name: str, command: Sequence[str], log: Path) -> str:
    """Run a step, whose output goes to a file; returns the output."""
    print(f"test-debian: {name}", end="", flush=True)
    began = time.monotonic()
    with log.open("w") as file:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=file, stderr=file)
    print(f": {time.monotonic() - began:.0f} s", flush=True)
    text = log.read_text(errors="replace")
    if done.returncode != 0:
        print("\n".join(text.splitlines()[-SHOWN_LINES:]), file=sys.stderr)
        raise StepError(f"{name}: failed with status {done.returncode}; its output: {log}")
    return text


def mirror(label: str) -> str | None:
    """Where this machine gets the packages of a label; None where it gets none."""
    command = [str(REPO / "packaging/mirror"), label]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    return done.stdout.strip() or None


def sources(codename: str) -> list[str]:
    """Lines of sources.list: a release, what has been mended in it since, and for its security."""
    debian, security = mirror("Debian"), mirror("Debian-Security")
    if debian is None:
        raise StepError("apt knows no mirror of Debian: apt-get update, then again")
    lines = [f"deb {debian} {codename} main", f"deb {debian} {codename}-updates main"]
    return lines + ([f"deb {security} {codename}-security main"] if security else [])


def apt_options() -> str:
    """This machine's settings of how apt fetches."""
    command = ["apt-config", "dump", "--format", '%f "%v";%n', "Acquire"]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return "".join(f"{line}\n" for line in text.splitlines() if ACQUIRE.fullmatch(line))


def given_environment(folder: Path) -> Iterator[str]:
    """The user's environment. Files that this machine's names for pip and npm are copied."""
    yield from (f"HOME={HOME}", f"USER={USER}", f"PATH={PATH}", "LANG=C.UTF-8")
    (folder / GIVEN).mkdir()
    for name, value in os.environ.items():
        if not REGISTRIES.fullmatch(name):
            continue
        copied = folder / GIVEN / name
        if Path(value).is_file():
            shutil.copyfile(value, copied)
        elif Path(value).is_dir():
            shutil.copytree(value, copied)
        yield f"{name}={f'/{GIVEN}/{name}' if copied.exists() else value}"


def give_settings(folder: Path) -> None:
    """Copy this machine's files that say how to reach registries."""
    home = Path.home()
    for source, target in (
        (Path("/etc/resolv.conf"), "etc/resolv.conf"),
        (Path("/etc/hosts"), "etc/hosts"),
        (Path("/etc/pip.conf"), "etc/pip.conf"),
        (home / ".config/pip/pip.conf", f"{HOME[1:]}/.config/pip/pip.conf"),
        (home / ".npmrc", f"{HOME[1:]}/.npmrc"),
    ):
        if source.is_file():
            (folder / target).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, folder / target)


def add_user(folder: Path) -> None:
    """A user who may use sudo."""
    chroot = ["chroot", str(folder)]
    subprocess.run([*chroot, "useradd", "--create-home", "--shell=/bin/sh", USER], check=True)
    (folder / "etc/sudoers.d" / USER).write_text(f"{USER} ALL=(ALL) NOPASSWD: ALL\n")


def make_root(release: str, out: Path) -> Root:
    """A clean Debian, with the committed files as the user's clone."""
    folder, options = out / "root", out / "apt.conf"
    options.write_text(apt_options())
    codename = RELEASES[release]
    run(
        f"Debian {release}: a clean root",
        ["unshare", "--mount", "mmdebstrap", "--mode=root", "--variant=minbase",
         f"--include={EXPECTED}", f"--aptopt={options}", "--dpkgopt=force-unsafe-io",
         codename, str(folder), *sources(codename)],
        out / "root.log",
    )  # fmt: skip
    add_user(folder)
    give_settings(folder)
    root = Root(release, folder, tuple(given_environment(folder)))
    clone = folder / CLONE[1:]
    clone.mkdir()
    archive = subprocess.run(
        ["git", "-C", REPO, "archive", "HEAD"], check=True, capture_output=True
    )
    subprocess.run(["tar", "-x", "-C", clone], input=archive.stdout, check=True)
    subprocess.run(["chroot", folder, "chown", "-R", f"{USER}:", HOME], check=True)
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
    root = make_root(release, out)
    for number, (name, words, network) in enumerate(STEPS):
        command = root.command("sh", "-c", words, network=network)
        seen = run(f"Debian {release}: {name}", command, out / f"{number}.log")
    shown = next(line for line in seen.splitlines() if line.startswith("the page"))
    told = f"{versions(root)}; {shown}"
    remove(root.folder)
    return told


def remove(folder: Path) -> None:
    """Remove a folder, in which nothing is mounted: what is, is so for a step alone."""
    mounts = Path("/proc/self/mounts").read_text()
    if f" {folder}/" in mounts:
        raise StepError(f"{folder}: something is mounted there")
    if folder.exists():
        shutil.rmtree(folder)


def main() -> None:
    """Check the releases that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("releases", nargs="+", choices=RELEASES)
    parser.add_argument("--out", type=Path, required=True, help="folder for roots and logs")
    options = parser.parse_args()
    if os.geteuid() != 0:
        sys.exit("test-debian: only root can make a root: sudo -E make test-debian")
    if subprocess.run(["git", "-C", REPO, "diff", "--quiet", "HEAD"]).returncode != 0:
        print("test-debian: what is not committed is not tested")
    try:
        told = [check(release, options.out.resolve() / release) for release in options.releases]
    except StepError as failure:
        sys.exit(f"test-debian: {failure}")
    print("\n".join(told))


main()
