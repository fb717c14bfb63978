#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Make a signed repository for apt of the packages that `make deb` has built.

`repo.py --packages FOLDER --out FOLDER --key KEY`: FOLDER/12 and FOLDER/13, where there are
packages, become the releases bookworm and trixie. A web server can hand out the folder as it is.
"""

import argparse
import gzip
import shutil
import subprocess
import sys
from pathlib import Path

REPO = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPO / "packaging"))

from clean_debian import RELEASES, StepError, remove  # noqa: E402

NO_KEY = """KEY is missing: it names the gpg key that signs, as in
    make apt-repo KEY=packages@example.org
`gpg --list-secret-keys` lists those that you have; to make one:
    gpg --quick-generate-key packages@example.org default sign never"""
KEYRING = "lightprobe.gpg"


def output(*command: str, cwd: Path | None = None) -> bytes:
    """What a command prints."""
    done = subprocess.run(command, cwd=cwd, capture_output=True)
    if done.returncode != 0:
        raise StepError(f"{command[0]}: {done.stderr.decode(errors='replace').strip()}")
    return done.stdout


def check_key(key: str) -> None:
    """Fail unless gpg can sign with it."""
    command = ["gpg", "--batch", "--list-secret-keys", "--", key]
    if not key or subprocess.run(command, capture_output=True).returncode != 0:
        raise StepError(NO_KEY if not key else f"gpg has no secret key {key!r}; {NO_KEY}")


def architectures(packages: list[Path]) -> list[str]:
    """The processors that the packages are for."""
    return sorted({path.stem.rsplit("_", 1)[1] for path in packages} - {"all"})


def add_release(codename: str, packages: list[Path], out: Path, key: str) -> None:
    """Copy the packages of one release, list them, and sign the list."""
    pool, dist = out / "pool" / codename, out / "dists" / codename
    pool.mkdir(parents=True)
    for path in packages:
        shutil.copy2(path, pool)
    found = architectures(packages)
    for one in found:
        folder = dist / "main" / f"binary-{one}"
        folder.mkdir(parents=True)
        pooled = str(pool.relative_to(out))
        listed = output("apt-ftparchive", "--arch", one, "packages", pooled, cwd=out)
        (folder / "Packages").write_bytes(listed)
        (folder / "Packages.gz").write_bytes(gzip.compress(listed, mtime=0))
    said = {"Origin": "lightprobe", "Label": "lightprobe", "Suite": codename, "Codename": codename,
            "Components": "main", "Architectures": " ".join(found)}  # fmt: skip
    options = [f"-oAPT::FTPArchive::Release::{name}={text}" for name, text in said.items()]
    release = dist / "Release"
    text = output("apt-ftparchive", *options, "release", str(dist.relative_to(out)), cwd=out)
    release.write_bytes(text)
    sign = ("gpg", "--batch", "--yes", "--local-user", key)
    output(*sign, "--clearsign", "--output", str(dist / "InRelease"), str(release))
    output(*sign, "--armor", "--detach-sign", "--output", str(dist / "Release.gpg"), str(release))


def make_repository(packages: Path, out: Path, key: str) -> list[str]:
    """Make it anew; returns the releases that it has."""
    check_key(key)
    by_release = {name: sorted((packages / name).glob("*.deb")) for name in RELEASES}
    if not any(by_release.values()):
        raise StepError(f"{packages} has no packages: make deb, or make deb RELEASE=12 or 13")
    remove(out)
    out.mkdir(parents=True)
    for name, found in by_release.items():
        if found:
            add_release(RELEASES[name], found, out, key)
    (out / KEYRING).write_bytes(output("gpg", "--batch", "--export", "--", key))
    return [RELEASES[name] for name, found in by_release.items() if found]


def main() -> None:
    """Make it, and say how apt is told of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--packages", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--key", default="", help="of gpg, that signs")
    options = parser.parse_args()
    try:
        releases = make_repository(options.packages, options.out, options.key)
    except StepError as failure:
        sys.exit(f"apt-repo: {failure}")
    print(
        f"apt-repo: {options.out} has {', '.join(releases)}. Let a web server hand it out; users:\n"
        f"    sudo cp {KEYRING} /usr/share/keyrings/\n"
        "    echo 'deb [signed-by=/usr/share/keyrings/lightprobe.gpg] ADDRESS "
        f"{releases[-1]} main' | sudo tee /etc/apt/sources.list.d/lightprobe.list"
    )


if __name__ == "__main__":
    main()
