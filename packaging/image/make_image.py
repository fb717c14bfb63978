#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Make the image of a probe's card, for the Raspberry Pi 4: `make_image.py --out FOLDER`, as root.

The card has three partitions: LP-BOOT, which any computer reads (the Pi's firmware, kernel,
lightprobe.txt), lp-root, which is never written, and lp-data, which grows to the card's size.
Nothing is mounted and no device is needed; programs for ARM64 run emulated. `make image` has built
the daemon before.
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
sys.path.insert(0, str(REPO / "packaging"))

from clean_debian import StepError, mirror, remove, run  # noqa: E402

SUITE = "bookworm"
#: What the Pi's firmware and its kernel come in, and a shell for the first program.
KERNEL = "linux-image-arm64,raspi-firmware,firmware-brcm80211,busybox-static"
FIRMWARE = ("start4.elf", "fixup4.dat")
UNITS = ("lightprobed", "lightprobe-setup", "lightprobe-panel", "lightprobe-image", "avahi-daemon",
         "lightprobe-network.timer", "lightprobe-renew.timer", "NetworkManager",
         "systemd-timesyncd")  # fmt: skip
#: They look at file systems on logical volumes, in the background.
UNUSED_UNITS = ("e2scrub_all.timer", "e2scrub_reap.service")
DROP_INS = ("wss", "i2c")
#: MB. The data partition grows at the first start.
ROOM_MB, BOOT_MB, DATA_MB = 64, 128, 64
APPLETS = ("sh", "mount", "insmod", "switch_root", "cat", "echo", "sleep", "findfs")
#: Pages and translations that nobody reads there; licences stay.
UNREAD = ("usr/share/man", "usr/share/info", "usr/share/locale", "usr/share/lintian",
          "var/cache", "var/log", "var/lib/apt")  # fmt: skip


class Image:
    """What is made, in a folder of its own."""

    def __init__(self, out: Path, daemon: Path) -> None:
        """`daemon`: lightprobed for ARM64."""
        self.out, self.daemon = out, daemon
        self.base, self.kernel = out / "base", out / "kernel"
        self.root, self.boot, self.work = out / "root", out / "boot", out / "work"

    def step(self, name: str, *words: str | Path) -> None:
        """Run a step, whose output goes to a file beside the image."""
        log = self.out / f"{re.sub('[^a-z0-9]+', '-', name.lower())}.log"
        run(name, [str(word) for word in words], log)

    def inside(self, name: str, *words: str) -> None:
        """Run a program of the image's root."""
        self.step(name, HERE / "emulated", "chroot", self.root, "env", "SYSTEMD_OFFLINE=1",
                  "LC_ALL=C.UTF-8", *words)  # fmt: skip

    def debian(self) -> None:
        """Debian's packages, installed; and the kernel's, unpacked. Kept while the lists stay."""
        packages = re.sub(r"#.*", "", (HERE / "packages.txt").read_text()).split()
        wanted = f"{SUITE} {','.join(packages)} {KERNEL}\n"
        made = self.out / "packages"
        if made.exists() and made.read_text() == wanted:
            return
        debian = mirror("Debian")
        if debian is None:
            raise StepError("apt knows no mirror of Debian: apt-get update, then again")
        security = mirror("Debian-Security")
        lines = [f"deb {debian} {SUITE} main non-free-firmware"]
        lines += [f"deb {security} {SUITE}-security main non-free-firmware"] if security else []
        common = ["mmdebstrap", "--mode=root", "--architectures=arm64", "--skip=check/qemu"]
        made.unlink(missing_ok=True)
        for folder in (self.base, self.kernel):
            remove(folder)
        self.step("Debian for ARM64", HERE / "emulated", *common, "--variant=essential",
                  f"--include={','.join(packages)}", SUITE, self.base, *lines)  # fmt: skip
        self.step("kernel for ARM64", *common, "--variant=extract", f"--include={KERNEL}",
                  SUITE, self.kernel, *lines)  # fmt: skip
        made.write_text(wanted)

    def fill(self) -> None:
        """The root: what is of lightprobe, and the settings of a root that is never written."""
        remove(self.root)
        self.step("root", "cp", "-a", self.base, self.root)
        for name in ("modules", "firmware"):  # in /lib, where nothing was installed, only unpacked
            shutil.copytree(self.kernel / "lib" / name, self.root / "usr/lib" / name,
                            symlinks=True, dirs_exist_ok=True)  # fmt: skip
        self.step(
            "lightprobe", "make", "-C", REPO, "install-daemon", "install-python", "install-data",
            f"DESTDIR={self.root}", "PREFIX=/usr", "PROCESSOR=aarch64",
            "INSTALLED_PYTHON=/usr/bin/python3", f"INSTALLED_DAEMON={self.daemon}",
        )  # fmt: skip
        shutil.copytree(HERE / "files", self.root, dirs_exist_ok=True)
        self.settle()
        self.inside("groups", "systemd-sysusers")
        self.inside("services", "systemctl", "enable", *UNITS)
        self.inside("no services", "systemctl", "mask", *UNUSED_UNITS)
        self.inside("the daemon starts", "lightprobed", "--version")
        self.inside("the command starts", "lightprobe", "--version")
        for folder in UNREAD:
            remove(self.root / folder)
            (self.root / folder).mkdir()

    def settle(self) -> None:
        """Files of the root that depend on what was installed."""
        etc, share = self.root / "etc", self.root / "usr/share/lightprobe"
        for name in DROP_INS:
            target = etc / "systemd/system/lightprobed.service.d" / f"{name}.conf"
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(share / "drop-ins" / f"{name}.conf", target)
        announced = etc / "avahi/services/lightprobe.service"
        shutil.copyfile(share / "avahi/lightprobe.service", announced)
        # What is under /etc/lightprobe at the first start, also where the last partition fails.
        factory = share / "image"
        factory.mkdir(exist_ok=True)
        config = (etc / "lightprobe/lightprobed.conf").read_text()
        config, opened = re.subn(r"^# (publish = wss:.*)$", r"\1", config, flags=re.M)
        if opened != 1:
            raise StepError("lightprobed.conf: there is no line `# publish = wss:` to open")
        (factory / "lightprobed.conf").write_text(config)
        for folder in ("data", "boot/firmware"):
            (self.root / folder).mkdir(parents=True, exist_ok=True)
        (etc / "machine-id").write_text("")  # a new one for each start, in memory
        (etc / "resolv.conf").unlink(missing_ok=True)
        (etc / "resolv.conf").symlink_to("/run/NetworkManager/resolv.conf")
        # Without a network and a clock of its own the time is never before the image's.
        (self.root / "usr/lib/clock-epoch").touch()

    def initrd(self) -> None:
        """The first program, with the modules that it loads, in their order."""
        work = self.work / "initrd"
        for folder in ("bin", "modules", "dev", "proc", "sys", "new"):
            (work / folder).mkdir(parents=True, exist_ok=True)
        shutil.copy2(next(self.kernel.glob("**/bin/busybox")), work / "bin/busybox")
        for applet in APPLETS:
            (work / "bin" / applet).symlink_to("busybox")
        shutil.copy2(HERE / "init", work / "init")
        order = self.modules()
        for path in order:
            shutil.copy2(path, work / "modules" / path.name)
        (work / "modules/list").write_text("".join(f"{path.name}\n" for path in order))
        target = self.boot / "initrd.img"
        pack = 'cd "$1" && find . | cpio --quiet -o -H newc | gzip -9 >"$2"'
        self.step("first program", "sh", "-c", pack, "sh", work, target)

    def modules(self) -> list[Path]:
        """Files of the modules, each after those that it needs."""
        release = next((self.root / "usr/lib/modules").iterdir()).name
        self.step("modules", "depmod", "-b", self.root, release)
        order: dict[Path, None] = {}
        for name in re.sub(r"#.*", "", (HERE / "modules.txt").read_text()).split():
            words: list[str | Path] = ["modprobe", "-d", self.root, "-S", release, "-D", name]
            done = subprocess.run(words, capture_output=True, text=True)
            if done.returncode != 0:
                raise StepError(f"module {name}: {done.stderr.strip()}")
            for line in done.stdout.splitlines():
                if line.startswith("insmod "):
                    order[Path(line.split()[1])] = None
        return list(order)

    def fill_boot(self) -> None:
        """The partition that the Pi's firmware reads."""
        remove(self.boot)
        self.boot.mkdir()
        shutil.copyfile(next((self.kernel / "boot").glob("vmlinuz-*")), self.boot / "vmlinuz")
        for name in FIRMWARE:
            shutil.copyfile(self.kernel / "usr/lib/raspi-firmware" / name, self.boot / name)
        for path in self.kernel.glob("usr/lib/linux-image-*/broadcom/bcm2711-rpi-*.dtb"):
            shutil.copyfile(path, self.boot / path.name)
        for name in ("config.txt", "cmdline.txt", "lightprobe.txt"):
            shutil.copyfile(HERE / name, self.boot / name)
        self.initrd()

    def pack(self, name: str) -> Path:
        """The card, and its compressed form, which is returned."""
        data = self.work / "data"
        for folder in ("lightprobe", "timesync", "recordings"):
            (data / folder).mkdir(parents=True)
        used = subprocess.run(["du", "-sm", self.root], capture_output=True, text=True, check=True)
        size_mb = int(used.stdout.split()[0]) * 11 // 10 + ROOM_MB
        inputs = self.work / "in"
        inputs.mkdir()
        quiet = ["mke2fs", "-q", "-t", "ext4", "-m", "0"]
        # lazy: a card is not written in the background at its first start.
        lazy = "lazy_itable_init=0,lazy_journal_init=0,root_owner=0:0"
        self.step("root's file system", *quiet, "-L", "lp-root", "-O", "^has_journal", "-d",
                  self.root, inputs / "root.ext4", f"{size_mb}M")  # fmt: skip
        # Of few inodes, because their tables are written when it grows.
        few = ["-b", "4096", "-i", "65536"]
        self.step("data's file system", *quiet, *few, "-L", "lp-data", "-E", lazy, "-d", data,
                  inputs / "data.ext4", f"{DATA_MB}M")  # fmt: skip
        config = self.work / "genimage.cfg"
        config.write_text(layout(name))
        self.step("partitions", "genimage", "--config", config, "--inputpath", inputs,
                  "--outputpath", self.out, "--tmppath", self.work / "tmp",
                  "--rootpath", self.boot)  # fmt: skip
        self.step("compression", "xz", "-3", "-T0", "-kf", self.out / name)
        return self.out / f"{name}.xz"


def layout(name: str) -> str:
    """The card's partitions, as genimage has them."""
    return f"""
image boot.vfat {{
    mountpoint = "/"
    vfat {{ label = "LP-BOOT" }}
    size = {BOOT_MB}M
}}
image {name} {{
    hdimage {{ partition-table-type = "mbr" align = 4M }}
    partition boot {{ partition-type = 0xC bootable = "true" image = "boot.vfat" }}
    partition root {{ partition-type = 0x83 image = "root.ext4" }}
    partition data {{ partition-type = 0x83 image = "data.ext4" }}
}}
"""


def main() -> None:
    """Make it, and say how large it is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the image")
    parser.add_argument("--daemon", type=Path, required=True, help="lightprobed for ARM64")
    options = parser.parse_args()
    if os.geteuid() != 0:
        sys.exit("image: only root can make a root: sudo -E make image")
    out = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    image = Image(out, options.daemon.resolve())
    try:
        image.debian()
        image.fill()
        remove(image.work)
        image.fill_boot()
        packed = image.pack("lightprobe-pi4.img")
    except (StepError, OSError) as failure:
        sys.exit(f"image: {failure}")
    for path in (packed.with_suffix(""), packed):
        print(f"{path.stat().st_size / 1e6:7.1f} MB  {os.path.relpath(path)}")


if __name__ == "__main__":
    main()
