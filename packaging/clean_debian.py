# SPDX-License-Identifier: Apache-2.0
"""A clean Debian in a folder, made by mmdebstrap, with a user: for tests and for packages.

How apt, pip and npm reach their registries is taken over from this machine.
"""

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
REPO = HERE.parent
RELEASES = {"12": "bookworm", "13": "trixie"}
USER, HOME = "probe", "/home/probe"
CLONE = f"{HOME}/lightprobe"
PATH = "/usr/local/bin:/usr/bin:/bin"
#: How this machine's pip and npm reach their registries, and where the root has the files.
REGISTRIES = re.compile(r"(?i)PIP_.*|npm_config_.*|NODE_EXTRA_CA_CERTS|SSL_CERT_FILE|.*_PROXY")
GIVEN = "etc/clean-debian"
ACQUIRE = re.compile(r'Acquire::(?:[\w-]*proxy|https?|Check-\w|Retries)[^"]*"[^"]+";', re.I)
SHOWN_LINES = 40


class StepError(Exception):
    """A step has failed; the text says which one, and where its output is."""


@dataclass(frozen=True)
class Root:
    """A Debian in a folder."""

    release: str
    folder: Path
    environment: tuple[str, ...]  # NAME=VALUE

    def command(
        self, *words: str, network: str = "host", user: str = USER, cwd: str = CLONE
    ) -> list[str]:
        """What runs a command in it; by default in the clone, as the user."""
        environment = ("env", "-i", "-C", cwd, *self.environment)
        if user == "root":
            environment += ("HOME=/root", "USER=root", f"PATH=/usr/sbin:/sbin:{PATH}")
        return [str(HERE / "enter"), network, str(self.folder), user, *environment, *words]


def run(name: str, command: Sequence[str], log: Path) -> str:
    """Run a step, whose output goes to a file; returns the output."""
    print(name, end="", flush=True)
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


def make_root(release: str, out: Path, *, variant: str, include: str = "") -> Root:
    """A clean Debian in out/root, with a user whose clone is an empty folder."""
    folder, options = out / "root", out / "apt.conf"
    options.write_text(apt_options())
    codename = RELEASES[release]
    run(
        f"Debian {release}: a clean root",
        ["unshare", "--mount", "mmdebstrap", "--mode=root", f"--variant={variant}",
         *([f"--include={include}"] if include else []),
         f"--aptopt={options}", "--dpkgopt=force-unsafe-io",
         codename, str(folder), *sources(codename)],
        out / "root.log",
    )  # fmt: skip
    command = ["chroot", str(folder), "useradd", "--create-home", "--shell=/bin/sh", USER]
    subprocess.run(command, check=True)
    give_settings(folder)
    (folder / CLONE[1:]).mkdir()
    own(folder)
    return Root(release, folder, tuple(given_environment(folder)))


def own(folder: Path) -> None:
    """Give the user what lies in the user's home."""
    subprocess.run(["chroot", str(folder), "chown", "-R", f"{USER}:", HOME], check=True)


def unpack_commit(target: Path) -> None:
    """What is committed here."""
    command = ["git", "-C", str(REPO), "archive", "HEAD"]
    archive = subprocess.run(command, check=True, capture_output=True)
    subprocess.run(["tar", "-x", "-C", target], input=archive.stdout, check=True)


def is_committed() -> bool:
    """Whether the working tree is what is committed."""
    return subprocess.run(["git", "-C", str(REPO), "diff", "--quiet", "HEAD"]).returncode == 0


def remove(folder: Path) -> None:
    """Remove a folder, in which nothing is mounted: what is, is so for a step alone."""
    mounts = Path("/proc/self/mounts").read_text()
    if f" {folder}/" in mounts:
        raise StepError(f"{folder}: something is mounted there")
    if folder.exists():
        shutil.rmtree(folder)
