#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Make the image of a probe's card, for the Raspberry Pi 4: `make_image.py --out FOLDER`, as root.

The card has four partitions: LP-BOOT, which any computer reads (the Pi's firmware, the boot loader,
lightprobe.txt), two halves for a system with its kernel, of which the second is empty until an
update is written to it, and lp-data, which grows to the card's size. The update is made beside the
image, and signed. Nothing is mounted and no device is needed; programs for ARM64 run emulated.
`make image` has built the daemon before.
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
#: With the Pi's firmware, the boot loader, the kernel, and a shell for the first program.
KERNEL = "linux-image-arm64,raspi-firmware,u-boot-rpi,firmware-brcm80211,busybox-static"
FIRMWARE = ("start4.elf", "fixup4.dat")
UNITS = ("lightprobed", "lightprobe-setup", "lightprobe-panel", "lightprobe-image", "avahi-daemon",
         "lightprobe-confirm", "lightprobe-network.timer", "lightprobe-renew.timer",
         "NetworkManager", "systemd-timesyncd")  # fmt: skip
#: They look at file systems on logical volumes, in the background.
UNUSED_UNITS = ("e2scrub_all.timer", "e2scrub_reap.service")
DROP_INS = ("wss", "i2c")
#: MB. A half has room for what later versions need; the data partition grows at the first start.
BOOT_MB, HALF_MB, DATA_MB = 128, 1600, 64
#: Of the card, so that the halves have names (files/etc/rauc/system.conf) before the kernel runs.
DISK_SIGNATURE = 0x6C707062
APPLETS = ("sh", "mount", "insmod", "switch_root", "cat", "echo", "sleep", "findfs", "reboot")
CERTIFICATE_DAYS = 365 * 20
COMPATIBLE = "lightprobe-pi4"
#: Pages and translations that nobody reads there; licences stay.
UNREAD = ("usr/share/man", "usr/share/info", "usr/share/locale", "usr/share/lintian",
          "var/cache", "var/log", "var/lib/apt")  # fmt: skip


class Image:
    """What is made, in a folder of its own."""

    def __init__(self, out: Path, daemon: Path, keys: Path, version: str) -> None:
        """`daemon`: lightprobed for ARM64; `keys`: folder of what signs updates."""
        self.out, self.daemon, self.version = out, daemon, version
        self.key, self.certificate = keys / "key.pem", keys / "certificate.pem"
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
        (share / "image-version").write_text(self.version + "\n")
        shutil.copyfile(self.certificate, etc / "rauc/keyring.pem")
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
        target = self.root / "boot/initrd.img"
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
        """The partition that the Pi's firmware reads, and the kernel, which is in the root."""
        remove(self.boot)
        self.boot.mkdir()
        kernel = next((self.kernel / "boot").glob("vmlinuz-*"))
        shutil.copyfile(kernel, self.root / "boot/vmlinuz")
        self.initrd()
        loader = self.kernel / "usr/lib/u-boot/rpi_arm64/u-boot.bin"
        shutil.copyfile(loader, self.boot / loader.name)
        for name in FIRMWARE:
            shutil.copyfile(self.kernel / "usr/lib/raspi-firmware" / name, self.boot / name)
        for path in self.kernel.glob("usr/lib/linux-image-*/broadcom/bcm2711-rpi-*.dtb"):
            shutil.copyfile(path, self.boot / path.name)
        for name in ("config.txt", "arguments.env", "lightprobe.txt"):
            shutil.copyfile(HERE / name, self.boot / name)
        (self.boot / "half.env").write_text("half=a\n")
        self.step("boot loader", "mkimage", "-A", "arm64", "-T", "script", "-C", "none", "-d",
                  HERE / "boot.cmd", self.boot / "boot.scr")  # fmt: skip

    def pack(self, name: str) -> Path:
        """The card, and its compressed form, which is returned."""
        data = self.work / "data"
        for folder in ("lightprobe", "timesync", "recordings"):
            (data / folder).mkdir(parents=True)
        inputs = self.work / "in"
        inputs.mkdir()
        quiet = ["mke2fs", "-q", "-t", "ext4", "-m", "0"]
        # lazy: a card is not written in the background at its first start.
        lazy = "lazy_itable_init=0,lazy_journal_init=0,root_owner=0:0"
        self.step("root's file system", *quiet, "-O", "^has_journal", "-d", self.root,
                  inputs / "root.ext4", f"{HALF_MB}M")  # fmt: skip
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

    def ensure_keys(self) -> None:
        """Make key and certificate at the first time; whoever has the key makes updates."""
        there = [path.exists() for path in (self.key, self.certificate)]
        if all(there):
            return
        if any(there):
            raise StepError(f"{self.key.parent}: has a key or a certificate, and not both: put the "
                            "other one back, else probes refuse what is signed")  # fmt: skip
        new = [path for path in (self.key.parent, *self.key.parent.parents) if not path.exists()]
        self.key.parent.mkdir(parents=True, mode=0o700, exist_ok=True)
        self.step(
            "key for updates", "openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt",
            "ec_paramgen_curve:prime256v1", "-nodes", "-keyout", self.key, "-out",
            self.certificate, "-days", str(CERTIFICATE_DAYS), "-subj", "/CN=lightprobe updates",
            "-addext", "keyUsage=critical,digitalSignature,keyCertSign",
        )  # fmt: skip
        owner = os.environ.get("SUDO_UID"), os.environ.get("SUDO_GID")
        for path in (*new, self.key, self.certificate):
            if owner[0] and owner[1]:
                os.chown(path, int(owner[0]), int(owner[1]))
        print(
            f"A key that signs updates was made in {self.key.parent}: keep it, and keep it "
            "secret. Probes with this image take updates that are signed with it alone."
        )

    def pack_update(self, name: str) -> Path:
        """The update: the root's file system, signed."""
        bundle, target = self.work / "bundle", self.out / name
        bundle.mkdir()
        (self.work / "in/root.ext4").rename(bundle / "root.ext4")
        (bundle / "manifest.raucm").write_text(manifest(self.version))
        target.unlink(missing_ok=True)
        self.step("update", "rauc", "bundle", f"--cert={self.certificate}", f"--key={self.key}",
                  "--mksquashfs-args=-comp zstd -Xcompression-level 9", bundle,
                  target)  # fmt: skip
        return target


def manifest(version: str) -> str:
    """What RAUC reads first."""
    return f"""[update]
compatible={COMPATIBLE}
version={version}
[bundle]
format=verity
[image.rootfs]
filename=root.ext4
"""


def layout(name: str) -> str:
    """The card's partitions, as genimage has them."""
    return f"""
image boot.vfat {{
    mountpoint = "/"
    vfat {{ label = "LP-BOOT" }}
    size = {BOOT_MB}M
}}
image {name} {{
    hdimage {{ partition-table-type = "mbr" align = 4M disk-signature = {DISK_SIGNATURE:#x} }}
    partition boot {{ partition-type = 0xC bootable = "true" image = "boot.vfat" }}
    partition a {{ partition-type = 0x83 image = "root.ext4" }}
    partition b {{ partition-type = 0x83 size = {HALF_MB}M }}
    partition data {{ partition-type = 0x83 image = "data.ext4" }}
}}
"""


def main() -> None:
    """Make it, and say how large it is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the image")
    parser.add_argument("--daemon", type=Path, required=True, help="lightprobed for ARM64")
    parser.add_argument("--keys", type=Path, required=True, help="folder of what signs updates")
    parser.add_argument("--version", required=True, help="of this image")
    options = parser.parse_args()
    if os.geteuid() != 0:
        sys.exit("image: only root can make a root: sudo -E make image")
    out = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    image = Image(out, options.daemon.resolve(), options.keys.resolve(), options.version)
    try:
        image.ensure_keys()
        image.debian()
        image.fill()
        remove(image.work)
        image.fill_boot()
        packed = image.pack(f"{COMPATIBLE}.img")
        update = image.pack_update(f"{COMPATIBLE}.raucb")
    except (StepError, OSError) as failure:
        sys.exit(f"image: {failure}")
    for path in (packed.with_suffix(""), packed, update):
        print(f"{path.stat().st_size / 1e6:7.1f} MB  {os.path.relpath(path)}")


if __name__ == "__main__":
    main()
