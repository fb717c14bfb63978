# SPDX-License-Identifier: Apache-2.0
"""Debian's kernel for the guest: fetched, unpacked, given extra modules; cached by version.

A prepared tree, build/kernel/linux-<package version>/, holds what the packages carry (`boot/`,
`lib/modules/`, `usr/src/`) and, under `lib/modules/<release>/extra/`, the modules built here:
raw_gadget, gpio-sim and irq_sim from the source package of the same version, and those of modules/
beside this file.
"""

import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
CACHE = HERE.parents[1] / "build" / "kernel"
MODULES = HERE / "modules"

# Taken from the source package, because Debian's kernel is built without them.
SOURCES = (
    "drivers/usb/gadget/legacy/raw_gadget.c",
    "drivers/gpio/gpio-sim.c",
    "drivers/gpio/gpiolib.h",
    "kernel/irq/irq_sim.c",
)


class SetupError(Exception):
    """The kernel could not be prepared; the message names the step and what to do."""


@dataclass(frozen=True)
class Kernel:
    """A prepared kernel tree."""

    release: str  # as `uname -r` says, 6.1.0-56-amd64
    version: str  # of the Debian package
    tree: Path

    @property
    def image(self) -> Path:
        """Path of the compressed kernel."""
        return self.tree / "boot" / f"vmlinuz-{self.release}"

    @property
    def modules(self) -> Path:
        """Path of the module tree, to be mounted over /lib/modules/<release> in the guest."""
        return self.tree / "lib" / "modules" / self.release


def _run(*command: str | Path, cwd: Path | None = None, timeout_s: float = 300) -> str:
    """Run a command, return what it printed; SetupError shows the end of its errors."""
    try:
        done = subprocess.run(
            command, cwd=cwd, timeout=timeout_s, capture_output=True, text=True, check=False
        )
    except subprocess.TimeoutExpired as expired:
        raise SetupError(f"{command[0]}: no end after {timeout_s:.0f} s") from expired
    if done.returncode:
        tail = "\n".join((done.stdout + done.stderr).splitlines()[-15:])
        raise SetupError(f"{' '.join(map(str, command[:4]))}: failed\n{tail}")
    return done.stdout


def _refresh_lists() -> None:
    sudo = [] if os.geteuid() == 0 else ["sudo"]
    _run(*sudo, "apt-get", "update", timeout_s=180)


def _candidate() -> tuple[str, str] | None:
    """Release and version of the kernel that apt would install; None when apt knows none."""
    shown = subprocess.run(
        ["apt-cache", "show", "--no-all-versions", "linux-image-amd64"],
        capture_output=True,
        text=True,
        check=False,
    ).stdout
    found = re.search(r"linux-image-(\S+) \(= ([^)]+)\)", shown)
    return (found[1], found[2]) if found else None


def _fitting(package: str, version: str) -> str:
    """Version of a package that apt has: this one, or the newest of the same sources.

    While Debian publishes an update, some packages are newer than others.
    """
    listed = subprocess.run(
        ["apt-cache", "madison", package], capture_output=True, text=True, check=False
    ).stdout
    versions = [line.split("|")[1].strip() for line in listed.splitlines() if "|" in line]
    upstream = version.rsplit("-", 1)[0]
    alike = [one for one in versions if one.rsplit("-", 1)[0] == upstream]
    return version if version in versions or not alike else alike[0]


def _download(release: str, version: str, folder: Path) -> dict[str, Path]:
    """Fetch the five packages of one kernel, checked by apt against its signed lists."""
    series = ".".join(release.split(".")[:2])
    flavour = release.rsplit("-", 1)[1]
    names = {
        "image": f"linux-image-{release}",
        "headers": f"linux-headers-{release}",
        "common": f"linux-headers-{release.removesuffix(flavour)}common",
        "kbuild": f"linux-kbuild-{series}",
        "source": f"linux-source-{series}",
    }
    folder.mkdir(parents=True, exist_ok=True)
    _run(
        "apt-get",
        "download",
        *(f"{n}={_fitting(n, version)}" for n in names.values()),
        cwd=folder,
        timeout_s=420,
    )
    return {role: next(folder.glob(f"{name}_*.deb")) for role, name in names.items()}


def _unpack(debs: dict[str, Path], release: str, tree: Path) -> None:
    for role in ("image", "headers", "common", "kbuild"):
        _run("dpkg-deb", "-x", debs[role], tree)
    # The headers' Makefile names the place where the package would be installed.
    makefile = tree / "usr" / "src" / f"linux-headers-{release}" / "Makefile"
    makefile.write_text(makefile.read_text().replace("/usr/src/", f"{tree}/usr/src/"))
    # Of the source package's 130 MB tar ball, four files.
    wanted = " ".join(f"'*/{name}'" for name in SOURCES)
    (tree / "sources").mkdir()
    _run(
        "bash", "-euo", "pipefail", "-c",
        f"dpkg-deb --fsys-tarfile '{debs['source']}' | tar -xO --wildcards '*.tar.xz' |"
        f" tar -xJ --strip-components=1 --wildcards {wanted}",
        cwd=tree / "sources",
    )  # fmt: skip


def _adapt_sources(tree: Path, work: Path) -> None:
    """Copy modules/ and the package's sources into one folder; irq_sim is made a module."""
    shutil.rmtree(work, ignore_errors=True)
    shutil.copytree(MODULES, work)
    for name in SOURCES:
        shutil.copy(tree / "sources" / name, work)
    irq_sim = work / "irq_sim.c"
    text = irq_sim.read_text()
    # Two helpers of the interrupt core are not exported to modules.
    adapted = text.replace("handle_simple_irq(irq_to_desc(irqnum))", "generic_handle_irq(irqnum)")
    if adapted == text:
        raise SetupError("irq_sim.c: not as expected; has the kernel's source changed?")
    irq_sim.write_text(adapted + '#include <linux/module.h>\nMODULE_LICENSE("GPL");\n')


def _build_modules(tree: Path, release: str) -> None:
    work = tree / "build"
    _adapt_sources(tree, work)
    headers = tree / "usr" / "src" / f"linux-headers-{release}"
    _run("make", "-C", headers, f"M={work}", "-j2", "modules", timeout_s=300)
    extra = tree / "lib" / "modules" / release / "extra"
    shutil.rmtree(extra, ignore_errors=True)
    extra.mkdir()
    for module in work.glob("*.ko"):
        shutil.copy(module, extra)
    _run("/sbin/depmod", "-b", tree, release)


def _recipe() -> str:
    """Digest of all that decides what the extra modules are."""
    parts = [Path(__file__), *sorted(MODULES.iterdir())]
    return hashlib.sha256(b"".join(p.read_bytes() for p in parts)).hexdigest()[:16]


def _newest_cached() -> Kernel | None:
    stamps = sorted(CACHE.glob("linux-*/unpacked"), key=lambda p: p.stat().st_mtime)
    if not stamps:
        return None
    tree = stamps[-1].parent
    return Kernel(stamps[-1].read_text(), tree.name.removeprefix("linux-"), tree)


def _unpacked_kernel() -> Kernel:
    candidate = _candidate()
    if not candidate:
        cached = _newest_cached()
        if cached:
            return cached
        _refresh_lists()
        candidate = _candidate()
    if not candidate:
        raise SetupError("apt knows no linux-image-amd64: is this Debian with its main archive?")
    release, version = candidate
    kernel = Kernel(release, version, CACHE / f"linux-{version}")
    if (kernel.tree / "unpacked").exists():
        return kernel
    print(f"kernel: fetching Debian's {release} ({version}), 225 MB", flush=True)
    debs_folder = CACHE / "download"
    try:
        debs = _download(release, version, debs_folder)
    except SetupError:
        # Lists older than the archive name packages that are gone: refresh them once.
        _refresh_lists()
        shutil.rmtree(debs_folder, ignore_errors=True)
        newer = _candidate()
        if newer and newer != candidate:
            return _unpacked_kernel()
        debs = _download(release, version, debs_folder)
    print("kernel: unpacking", flush=True)
    shutil.rmtree(kernel.tree, ignore_errors=True)
    kernel.tree.mkdir(parents=True)
    _unpack(debs, release, kernel.tree)
    (kernel.tree / "unpacked").write_text(release)
    shutil.rmtree(debs_folder)
    return kernel


def prepare() -> Kernel:
    """Return a kernel that is ready to boot, doing only what is missing."""
    if platform.machine() != "x86_64":
        raise SetupError(
            f"this machine is {platform.machine()}: the guest runs the host's own programs,"
            " so the kernel tests need an amd64 machine"
        )
    kernel = _unpacked_kernel()
    stamp = kernel.tree / "modules"
    if not stamp.exists() or stamp.read_text() != _recipe():
        print("kernel: building the modules that Debian leaves out, and our own", flush=True)
        _build_modules(kernel.tree, kernel.release)
        stamp.write_text(_recipe())
    return kernel


if __name__ == "__main__":
    try:
        ready = prepare()
    except SetupError as error:
        sys.exit(f"kernel: {error}")
    print(f"kernel: {ready.release} ({ready.version}) is ready")
