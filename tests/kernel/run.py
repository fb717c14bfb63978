#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Run the kernel tests: each group in a guest of its own, Debian's kernel in QEMU without KVM.

The guest's root is this machine's, read-only, so it runs what was built here. Results of a group
go to build/kernel/out: GROUP.xml (JUnit), GROUP.console, GROUP.dmesg.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import coverage
from kernel_package import CACHE, Kernel, SetupError, prepare

REPO = Path(__file__).resolve().parents[2]
GUEST = REPO / "tests" / "kernel" / "guest"
OUT = CACHE / "out"
INITRD_MODULES = ("virtio_pci", "9pnet_virtio", "9p", "overlay")
# The console shows the end of every test, and a test has a limit of its own, in the guest's time.
# When nothing shows for so long, the guest itself hangs.
SILENCE_LIMIT_S = 1800
APPLETS = ("sh", "mount", "insmod", "switch_root", "mkdir", "cat", "echo")


@dataclass(frozen=True)
class Group:
    """A set of guest tests (guest/test_NAME.py, guest/test_NAME_*.py) and the machine they need."""

    about: str
    devices: tuple[str, ...] = ()  # further arguments of QEMU; {run} is a short-lived folder
    systemd: bool = False  # it is the guest's first process, and starts udev, journal and the tests


# The longest first: two run at a time.
GROUPS = {
    "uvc": Group("UVC camera in user space, the kernel's uvcvideo, the daemon"),
    "service": Group("the installed service: systemd, udev, camera, wheel, ring", systemd=True),
    "bracket": Group("the simulator's frames through the UVC camera, one exposure and several"),
    "ptp": Group("a camera for stills in user space (FunctionFS), libusb, the daemon"),
    "libcamera": Group("the UVC camera through libcamera and udev"),
    "mcu": Group(
        "the daemon with the microcontroller's firmware, and with a servo hat: every carrier",
        devices=(
            "-chardev socket,id=mcu-a,path={run}/mcu,server=on,wait=off",
            "-chardev socket,id=mcu-b,path={run}/mcu",
            "-device qemu-xhci -device usb-serial,chardev=mcu-a -device usb-serial,chardev=mcu-b",
            "-object can-bus,id=mcu-bus",
            "-device kvaser_pci,canbus=mcu-bus -device kvaser_pci,canbus=mcu-bus",
        ),
    ),
    "demo": Group("what a user with a camera runs: the demo, the client's commands"),
    "can": Group(
        "CAN: vcan, and two Kvaser cards on one bus",
        devices=(
            "-object can-bus,id=bus -device kvaser_pci,canbus=bus -device kvaser_pci,canbus=bus",
        ),
    ),
    "gpio": Group("GPIO: gpio-sim through libgpiod"),
    "imu": Group("a gyroscope: UHID, the kernel's HID sensor driver, IIO"),
    "i2c": Group("I2C: raw transfers to register files"),
    "tty": Group(
        "serial lines: CDC-ACM gadget with unplug, two FTDI adapters",
        devices=(
            "-chardev socket,id=a,path={run}/tty,server=on,wait=off",
            "-chardev socket,id=b,path={run}/tty",
            "-device qemu-xhci -device usb-serial,chardev=a -device usb-serial,chardev=b",
        ),
    ),
}


def initrd_of(kernel: Kernel) -> Path:
    """Path of the guest's small first file system."""
    return kernel.tree / "initrd"


def make_initrd(kernel: Kernel) -> None:
    """Build the first file system: busybox, the modules for the root, guest/init."""
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        for folder in ("bin", "modules", "dev", "proc", "sys", "lower", "upper", "new"):
            (root / folder).mkdir()
        shutil.copy("/bin/busybox", root / "bin")
        for applet in APPLETS:
            (root / "bin" / applet).symlink_to("busybox")
        loads: list[str] = []
        for module in INITRD_MODULES:
            depends = subprocess.run(
                ["/sbin/modprobe", "-d", kernel.tree, "-S", kernel.release, "-D", module],
                check=True, capture_output=True, text=True,
            ).stdout  # fmt: skip
            loads += [line.split()[1] for line in depends.splitlines() if line.startswith("insmod")]
        unique = [Path(path) for path in dict.fromkeys(loads)]
        for path in unique:
            shutil.copy(path, root / "modules")
        (root / "modules" / "list").write_text("\n".join(path.name for path in unique))
        shutil.copy(GUEST / "init", root / "init")
        files = subprocess.run(["find", "."], cwd=root, check=True, capture_output=True).stdout
        with initrd_of(kernel).open("wb") as archive:
            subprocess.run(
                ["cpio", "--create", "--format=newc", "--quiet"],
                cwd=root, input=files, stdout=archive, check=True,
            )  # fmt: skip


def qemu_command(
    kernel: Kernel, name: str, options: argparse.Namespace, run_folder: str
) -> list[str]:
    """Command that boots the guest for one group (or the shell)."""
    append = (
        # On a busy machine the kernel would find its timer dead: it must not try it.
        "console=ttyS0 quiet panic=-1 oops=panic nokaslr mitigations=off no_timer_check"
        f" lp.repo={REPO} lp.modules={kernel.modules} lp.group={name} lp.variant={options.variant}"
        f" lp.select={options.select.replace(' ', '+')}{' lp.nightly' if options.nightly else ''}"
    )
    if name != "shell" and GROUPS[name].systemd:
        append += " systemd.unit=lightprobe-tests.service systemd.show_status=false"
    share = "security_model=none"
    command = (
        # KVM may be present and unusable: emulation is the one way that works everywhere.
        # The guest's time is the count of its instructions, 4 ns each; while it sleeps, its time
        # passes as on this machine. So a busy machine makes the tests last longer, and nothing in
        # the guest late. QEMU can count the instructions of one processor only.
        "qemu-system-x86_64 -accel tcg,thread=single -icount shift=2 -rtc clock=vm"
        " -cpu Nehalem -m 1536 -smp 1"
        " -nodefaults -display none -no-reboot"
        f" -serial {'mon:stdio' if name == 'shell' else 'stdio'}"
        " -device isa-debug-exit,iobase=0xf4,iosize=4"
        f" -virtfs local,path=/,mount_tag=root,{share},readonly=on,multidevs=remap"
        f" -virtfs local,path={OUT},mount_tag=out,{share}"
        f" -kernel {kernel.image} -initrd {initrd_of(kernel)}"
    ).split()
    groups = GROUPS.values() if name == "shell" else (GROUPS[name],)
    for group in groups:
        for devices in group.devices:
            command += devices.format(run=run_folder).split()
    return [*command, "-append", append]


def write_failure(name: str, reason: str, console: str) -> None:
    """Leave a JUnit file that says why the group itself gave none."""
    suite = ElementTree.Element("testsuite", name=name, tests="1", errors="1")
    case = ElementTree.SubElement(suite, "testcase", classname=name, name="guest")
    error = ElementTree.SubElement(case, "error", message=reason)
    error.text = "".join(c for c in console if c.isprintable() or c == "\n")
    ElementTree.ElementTree(suite).write(OUT / f"{name}.xml", encoding="utf-8")


def summary_of(name: str) -> tuple[str, list[str]]:
    """Counts of a group's tests; what they measured, and a line for each one that was skipped."""
    counts = {"passed": 0, "failed": 0, "skipped": 0}
    lines = []
    for case in ElementTree.parse(OUT / f"{name}.xml").iter("testcase"):
        lines += [f"  {p.get('value')}" for p in case.iter("property") if p.get("name") == "figure"]
        skipped = case.find("skipped")
        if skipped is not None:
            counts["skipped"] += 1
            lines.append(f"  skipped {case.get('name')}: {skipped.get('message')}")
        elif case.find("failure") is not None or case.find("error") is not None:
            counts["failed"] += 1
        else:
            counts["passed"] += 1
    return ", ".join(f"{n} {what}" for what, n in counts.items() if n), lines


def complaints_of(name: str) -> list[str]:
    """Lines in which the guest's kernel complained about itself."""
    log = OUT / f"{name}.dmesg"
    lines = log.read_text(errors="replace").splitlines() if log.exists() else []
    return [line for line in lines if any(w in line for w in ("WARNING: CPU", "BUG:", "Oops"))]


def boot(kernel: Kernel, name: str, options: argparse.Namespace) -> str | None:
    """Run one group; None when its tests passed, else the reason in words."""
    console = OUT / f"{name}.console"
    with (
        tempfile.TemporaryDirectory(prefix="lp-kernel-") as folder,
        console.open("wb") as log,
    ):
        qemu = subprocess.Popen(
            qemu_command(kernel, name, options, folder),
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            heard_s = time.monotonic()
            os.set_blocking(qemu.stdout.fileno(), False)
            while qemu.poll() is None:
                if copy_output(qemu.stdout, log, options.verbose):
                    heard_s = time.monotonic()
                elif time.monotonic() - heard_s > SILENCE_LIMIT_S:
                    return f"the guest has been silent for {SILENCE_LIMIT_S} s: it hangs"
                time.sleep(0.05)
            copy_output(qemu.stdout, log, options.verbose)
        finally:
            qemu.kill()
            qemu.wait()
    if not qemu.returncode & 1:
        return f"the guest ended without a result (QEMU's status {qemu.returncode}): a panic?"
    status = qemu.returncode >> 1
    return f"status {status} of the tests" if status else None


def copy_output(pipe, log, verbose: bool) -> bool:
    """Append what the guest printed to its log, and show it when asked to; True if it did print."""
    data = pipe.read()
    if not data:
        return False
    log.write(data)
    log.flush()
    if verbose:
        sys.stdout.buffer.write(data)
        sys.stdout.flush()
    return True


def run_group(kernel: Kernel, options: argparse.Namespace, name: str) -> bool:
    """Run one group and report it; True when it passed."""
    for old in OUT.glob(f"{name}.*"):
        old.unlink()
    started = time.monotonic()
    print(f"kernel: {name}: started: {GROUPS[name].about}", flush=True)
    reason = boot(kernel, name, options)
    console = (OUT / f"{name}.console").read_text(errors="replace")
    if not (OUT / f"{name}.xml").exists():
        reason = reason or "the tests left no report"
        write_failure(name, reason, console[-8000:])
    counts, lines = summary_of(name)
    lines += (f"  the guest's kernel: {line}" for line in complaints_of(name))
    if reason and not options.verbose:
        lines = [*console.splitlines()[-80:], *lines]
    verdict = f"FAILED ({reason}; log: {OUT}/{name}.console)" if reason else "ok"
    lines.append(f"kernel: {name}: {verdict}, {counts}, {time.monotonic() - started:.0f} s")
    print("\n".join(lines), flush=True)
    return reason is None


def run_groups(run: Callable[[str], bool], names: Sequence[str], jobs: int) -> list[str]:
    """Run groups, so many at a time; the names of those that failed."""
    with ThreadPoolExecutor(jobs) as pool:
        passed = list(pool.map(run, names))
    return [name for name, well in zip(names, passed, strict=True) if not well]


def shell(kernel: Kernel, options: argparse.Namespace) -> int:
    """Boot to an interactive shell with the devices of all groups."""
    with tempfile.TemporaryDirectory(prefix="lp-kernel-") as folder:
        return subprocess.call(qemu_command(kernel, "shell", options, folder)) >> 1


def main() -> int:
    """Parse the command line; 0 when every group passed."""
    parser = argparse.ArgumentParser(prog="tests/kernel/run.py", description=__doc__)
    parser.add_argument("groups", nargs="*", metavar="GROUP", help="default: all; see --list")
    parser.add_argument("--list", action="store_true", help="list the groups")
    parser.add_argument("--shell", action="store_true", help="a shell in the guest")
    parser.add_argument("--variant", default="release", help="build of the daemon to run")
    parser.add_argument("--select", default="", help="only tests whose name contains this")
    parser.add_argument("--nightly", action="store_true", help="those with the mark nightly, too")
    parser.add_argument("--jobs", type=int, default=2, help="guests at a time (2)")
    parser.add_argument("--verbose", action="store_true", help="show the guest's console")
    options = parser.parse_args()
    if options.list:
        print("\n".join(f"{name:8s} {group.about}" for name, group in GROUPS.items()))
        return 0
    unknown = set(options.groups) - set(GROUPS)
    if unknown:
        parser.error(f"unknown group {', '.join(sorted(unknown))}; known: {', '.join(GROUPS)}")
    try:
        kernel = prepare()
    except SetupError as error:
        print(f"kernel: {error}", file=sys.stderr)
        return 2
    make_initrd(kernel)
    OUT.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(OUT / "gcov", ignore_errors=True)
    if options.shell:
        return shell(kernel, options)
    names = options.groups or list(GROUPS)
    # A guest waits most of the time: for frames, for time limits, for its own slow disk.
    # They would add to the same counts of coverage at once, though.
    jobs = 1 if options.variant == "cov" else min(options.jobs, len(names))
    run = partial(run_group, kernel, options)
    failed = run_groups(run, names, jobs)
    if failed and jobs > 1:
        print(f"kernel: those that failed, once more and alone: {', '.join(failed)}", flush=True)
        failed = run_groups(run, failed, 1)
    if options.variant == "cov":
        coverage.report(OUT / "gcov", OUT / "coverage.txt")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
