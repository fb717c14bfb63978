#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Build the Debian packages of what is committed: `build.py --out FOLDER [--release 12|13]`.

Without a release they are built on this machine, which has what building needs (`make deb`). With
one, in a clean root of it that gets nothing but the Build-Depends; only root can make a root. The
packages go to FOLDER/RELEASE.
"""

import argparse
import datetime
import os
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

REPO = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPO / "packaging"))

from clean_debian import (  # noqa: E402
    CLONE,
    HOME,
    RELEASES,
    StepError,
    is_committed,
    make_root,
    own,
    remove,
    run,
    unpack_commit,
)

LISTS = ("build", "firmware", "deb")
#: Where the project has its version.
VERSION = re.compile(r"^VERSION := (\S+)$", re.M)


def git(*words: str) -> str:
    """What git says of this clone."""
    done = subprocess.run(["git", "-C", REPO, *words], capture_output=True, text=True)
    if done.returncode != 0:
        raise StepError(f"git {words[0]}: {done.stderr.strip()}; build packages in a clone of git")
    return done.stdout.strip()


def release_here() -> str:
    """The Debian of this machine."""
    system = platform.freedesktop_os_release()
    release = system.get("VERSION_ID", "")
    if system["ID"] != "debian" or release not in RELEASES:
        raise StepError(
            f"this is {system.get('PRETTY_NAME', 'an unknown system')}, and packages are for "
            "Debian 12 and 13: as root, make deb RELEASE=12 or 13"
        )
    return release


def version(release: str) -> str:
    """The project's version, and the time of the commit: a later commit is an upgrade."""
    found = VERSION.search((REPO / "daemon/daemon.mk").read_text())
    if found is None:
        raise StepError("daemon/daemon.mk: there is no line VERSION := ...")
    when = datetime.datetime.fromtimestamp(int(git("log", "-1", "--format=%ct")), datetime.UTC)
    return f"{found[1]}+{when:%Y%m%d.%H%M%S}~deb{release}"


def build_depends() -> list[str]:
    """The packages of the lists that `make deb` installs here."""
    texts = [(REPO / f"packaging/apt/{name}.txt").read_text() for name in LISTS]
    return [word for text in texts for word in re.sub(r"#.*", "", text).split()]


def prepare(source: Path, release: str) -> None:
    """A source tree with the folder debian/."""
    unpack_commit(source)
    debian = source / "debian"
    shutil.copytree(source / "packaging/deb/debian", debian)
    control = debian / "control"
    needed = "".join(f" {name},\n" for name in build_depends())
    control.write_text(control.read_text().replace("@BUILD_DEPENDS@\n", needed))
    maintainer = re.search(r"^Maintainer: (.*)$", control.read_text(), re.M)
    assert maintainer is not None
    (debian / "changelog").write_text(
        f"lightprobe ({version(release)}) {RELEASES[release]}; urgency=medium\n\n"
        f"  * Commit {git('rev-parse', 'HEAD')}.\n\n"
        f" -- {maintainer[1]}  {git('log', '-1', '--format=%cD')}\n"
    )


def collect(parent: Path, target: Path) -> list[Path]:
    """Move the packages into an empty folder."""
    remove(target)
    target.mkdir(parents=True)
    return [Path(shutil.move(path, target)) for path in sorted(parent.glob("*.deb"))]


def build(release: str, work: Path, *, clean: bool) -> Path:
    """Build in a folder of work; returns the folder in which the packages lie."""
    os.environ["DEB_BUILD_OPTIONS"] = f"parallel={os.cpu_count()}"
    words = ["dpkg-buildpackage", "--build=binary", "--no-sign", "--no-check-builddeps"]
    log = work / "build.log"
    if not clean:
        source = work / "lightprobe"
        source.mkdir()
        prepare(source, release)
        run(f"Debian {release}: the packages", ["env", "-C", str(source), *words], log)
        return work
    root = make_root(release, work, variant="buildd")
    prepare(root.folder / CLONE[1:], release)
    own(root.folder)
    wanted = "apt-get update && DEBIAN_FRONTEND=noninteractive apt-get build-dep -y ./"
    command = root.command("sh", "-c", f"{wanted} --no-install-recommends", user="root")
    run(f"Debian {release}: its Build-Depends", command, work / "build-dep.log")
    options = f"DEB_BUILD_OPTIONS={os.environ['DEB_BUILD_OPTIONS']}"
    run(f"Debian {release}: the packages", root.command("env", options, *words[:-1]), log)
    return root.folder / HOME[1:]


def main() -> None:
    """Build and say where the packages are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--release", choices=RELEASES, help="build in a clean root of it")
    parser.add_argument("--out", type=Path, required=True, help="folder for the packages")
    options = parser.parse_args()
    clean = options.release is not None
    if clean and os.geteuid() != 0:
        sys.exit("deb: only root can make a clean root: sudo -E make deb RELEASE=...")
    out = options.out.resolve()
    try:
        if not is_committed():
            print("deb: what is not committed is not in the packages")
        release = options.release or release_here()
        work = out / f"work-{release}"
        remove(work)
        work.mkdir(parents=True)
        found = collect(build(release, work, clean=clean), out / release)
        remove(work)
    except StepError as failure:
        sys.exit(f"deb: {failure}")
    for path in found:
        print(f"{path.stat().st_size / 1e6:7.2f} MB  {os.path.relpath(path)}")


if __name__ == "__main__":
    main()
