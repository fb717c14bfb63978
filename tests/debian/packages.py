#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The Debian packages as their users get them, on a clean Debian: `packages.py 12 13`.

A root in a folder, made by mmdebstrap, gets the packages that `make deb RELEASE=...` has built, by
apt and nothing else: installed, at work, upgraded, removed, purged, and from a signed repository.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
REPO = HERE.parents[1]
sys.path[:0] = [str(REPO / "packaging"), str(REPO / "packaging/deb")]

from clean_debian import RELEASES, Root, StepError, make_root, remove, run  # noqa: E402
from installed import CHANGED  # noqa: E402
from repo import KEYRING, make_repository  # noqa: E402

CONFIG = "etc/lightprobe/lightprobed.conf"
PROGRAM = "usr/bin/lightprobed"
APT = "DEBIAN_FRONTEND=noninteractive apt-get"
#: Of the key that signs the repository here, and is thrown away.
KEY = "test@lightprobe.invalid"
MOST_DAEMON_MB = 5
#: What the command's start takes of a core, for a user who cannot write to its folder.
START = """
import resource, subprocess
def used():
    found = resource.getrusage(resource.RUSAGE_CHILDREN)
    return found.ru_utime + found.ru_stime
def start():
    before = used()
    subprocess.run(["setpriv", "--reuid=61184", "--clear-groups", "lightprobe", "--help"],
                   check=True, stdout=subprocess.DEVNULL)
    return used() - before
print(round(min(start() for _ in range(5)), 2))
"""


class Tester:
    """One root and its steps."""

    def __init__(self, root: Root, out: Path) -> None:
        """Begin."""
        self.root, self.out, self.count = root, out, 0

    def there(self, path: str) -> bool:
        """Whether a file is in the root."""
        return (self.root.folder / path).exists()

    def expect(self, right: bool, what: str) -> None:
        """Fail unless it is so."""
        if not right:
            raise StepError(f"Debian {self.root.release}: {what}")

    def step(self, name: str, words: str, *, fails: bool = False) -> str:
        """Run a shell's words in the root as root; with `fails` they must fail."""
        self.count += 1
        command = self.root.command(
            "sh", "-c", f"! {{ {words}; }}" if fails else words, user="root", cwd="/root"
        )
        log = self.out / f"test-{self.count}.log"
        return run(f"Debian {self.root.release}: {name}", command, log)

    def changed_configuration_is_kept(self, after: str) -> None:
        """Fail unless what the user has written is there."""
        path = self.root.folder / CONFIG
        kept = path.is_file() and path.read_text().startswith(CHANGED)
        self.expect(kept, f"after {after} the changed configuration is not there")


def newer(package: Path, folder: Path) -> Path:
    """The same package with a higher version."""
    unpacked = folder / "newer"
    subprocess.run(["dpkg-deb", "-R", package, unpacked], check=True)
    control = unpacked / "DEBIAN/control"
    text = re.sub(r"^(Version: .*)$", r"\1+newer", control.read_text(), flags=re.M)
    control.write_text(text)
    built = folder / f"newer_{package.name}"
    command = ["dpkg-deb", "--root-owner-group", "-Znone", "-b", str(unpacked), str(built)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return built


def by_name(folder: Path) -> dict[str, Path]:
    """The packages of a folder."""
    return {path.name.split("_")[0]: path for path in folder.glob("*.deb")}


def life(test: Tester, packages: Path) -> str:
    """From the installation to the purge; returns what has been seen."""
    folder = test.root.folder / "root/packages"
    shutil.copytree(packages, folder)
    one = by_name(folder)
    shutil.copy(HERE / "installed.py", folder.parent)
    shutil.copy(REPO / "README.md", folder.parent)
    size = one["lightprobed"].stat().st_size / 1e6
    test.expect(size <= MOST_DAEMON_MB, f"lightprobed has {size:.1f} MB")

    told = test.step(
        "apt install ./*.deb",
        f"apt-get update && {APT} install -y --no-install-recommends ./packages/*.deb",
    )
    test.expect("Next: edit /etc/lightprobe/lightprobed.conf" in told, "no next step is named")
    wanted = test.root.folder / "etc/systemd/system/multi-user.target.wants/lightprobed.service"
    test.expect(not wanted.is_symlink(), "the service is enabled before it is configured")
    test.step("groups of the rules", "getent group video dialout i2c gpio")
    seen = test.step("daemon, simulated camera, client", "python3 installed.py README.md")
    start = test.step("the start of the command", f"python3 -c '{START}'")
    test.changed_configuration_is_kept("the change")
    upgrade = newer(one["lightprobed"], test.root.folder / "root")
    test.step("upgrade", f"{APT} install -y ./{upgrade.name}")
    test.changed_configuration_is_kept("the upgrade")
    test.step("remove", f"{APT} remove -y lightprobed lightprobe")
    test.changed_configuration_is_kept("the removal")
    test.expect(not test.there(PROGRAM), "the daemon is there after its removal")
    test.expect(not test.there("usr/lib/lightprobe"), "/usr/lib/lightprobe is left behind")
    pair = test.root.folder / "etc/lightprobe/pair"
    pair.mkdir()
    (pair / "token").write_text("secret")
    test.step("purge", f"{APT} purge -y lightprobed lightprobe lightprobe-dev")
    test.expect(not test.there("etc/lightprobe"), "the configuration is there after the purge")
    command = one["lightprobe"].stat().st_size / 1e6
    return (
        f"lightprobed {size:.2f} MB, lightprobe {command:.0f} MB; "
        f"lightprobe --help takes {start.strip()} s of a core; {seen.splitlines()[-1]}"
    )


def repository(test: Tester, packages: Path) -> str:
    """The packages from a signed repository, and from one that is not trusted."""
    home = test.out / "gnupg"
    home.mkdir(mode=0o700)
    os.environ["GNUPGHOME"] = str(home)
    subprocess.run(
        ["gpg", "--batch", "--quiet", "--passphrase", "", "--quick-generate-key", KEY],
        check=True,
    )
    folder = test.root.folder / "srv/lightprobe"
    (codename,) = make_repository(packages, folder, KEY)
    subprocess.run(["gpgconf", "--kill", "all"], check=True)
    remove(home)
    listed = test.root.folder / "etc/apt/sources.list.d/lightprobe.list"
    keyring = f"/usr/share/keyrings/{KEYRING}"
    listed.write_text(f"deb [signed-by={keyring}] file:/srv/lightprobe {codename} main\n")
    refused = test.step(
        "apt refuses it without the key", "apt-get update -o APT::Update::Error-Mode=any",
        fails=True,
    )  # fmt: skip
    test.expect("is not signed" in refused, "apt does not say that the key is missing")
    test.step(
        "apt installs from it",
        f"cp /srv/lightprobe/{KEYRING} {keyring} && apt-get update && "
        f"{APT} install -y --no-install-recommends lightprobed lightprobe-dev && "
        "lightprobed --version",
    )
    return f"installed from a repository of {codename}"


def check(release: str, packages: Path, out: Path) -> str:
    """All steps on one release."""
    remove(out)
    out.mkdir(parents=True)
    folder = packages / release
    if not by_name(folder):
        raise StepError(f"{folder} has no packages: as root, make deb RELEASE={release}")
    test = Tester(make_root(release, out, variant="minbase"), out)
    told = life(test, folder)
    only = out / "packages"
    only.mkdir()
    (only / release).symlink_to(folder)
    told += f"; {repository(test, only)}"
    remove(test.root.folder)
    return f"Debian {release}: {told}"


def main() -> None:
    """Check the releases that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("releases", nargs="+", choices=RELEASES)
    parser.add_argument("--packages", type=Path, required=True, help="where make deb leaves them")
    parser.add_argument("--out", type=Path, required=True, help="folder for roots and logs")
    options = parser.parse_args()
    if os.geteuid() != 0:
        sys.exit("test-deb: only root can make a root: sudo -E make test-deb")
    packages, out = options.packages.resolve(), options.out.resolve()
    try:
        told = [check(release, packages, out / release) for release in options.releases]
    except StepError as failure:
        sys.exit(f"test-deb: {failure}")
    print("\n".join(told))


if __name__ == "__main__":
    main()
