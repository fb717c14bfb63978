"""`lightprobe doctor`: what works, what does not, and the next step for each."""

from __future__ import annotations

import json
import os
import platform
import stat
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from lightprobe import __version__, daemon
from lightprobe.address import Address
from lightprobe.cli import check, view
from lightprobe.client import DEFAULT_URI, Client
from lightprobe.errors import LightprobeError, ProbeError, ProbeTimeout
from lightprobe.estimate import FLAG_WORDS, MINOR_FAULTS, Estimate, EstimateFlag, flag_names
from lightprobe.installation import install_extras
from lightprobe.wire import Subscription

_RATE_OVER_S = 2.0
#: A probe at its best tells every frame of a slow camera; fewer estimates are worth a look.
_SLOW_HZ = 10.0
_COLOURS = {"ok": "green", "warn": "yellow", "fail": "red", "skip": "dim"}


class Verdict(StrEnum):
    """Outcome of one check."""

    OK = "ok"
    WARN = "warn"  # works, but not as it should
    FAIL = "fail"
    SKIP = "skip"  # could not be looked at, or does not apply here


@dataclass(frozen=True)
class Finding:
    """One check, what it saw, and what to do about it."""

    check: str
    verdict: Verdict
    detail: str
    next_step: str = ""


def command(
    uri: Annotated[str, typer.Argument(help="Address of the probe to look at.")] = DEFAULT_URI,
    wait_s: Annotated[
        float,
        typer.Option(
            "--wait",
            callback=check.number(0.1, 3600, "seconds"),
            help="Seconds to wait for a first estimate.",
        ),
    ] = 5.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
) -> None:
    """Check the installation, the devices, and a running probe; name the next step for each fault.

    The exit code is 1 when something fails; warnings do not fail.
    """
    installed = list(installation())
    hosts_a_probe = any(finding.check == "versions" for finding in installed)
    findings = [*installed, *devices(hosts_a_probe), *probe(uri, wait_s)]
    failed = any(finding.verdict is Verdict.FAIL for finding in findings)
    if as_json:
        print(json.dumps({"ok": not failed, "findings": [asdict(f) for f in findings]}, indent=2))
    else:
        show(findings)
    raise typer.Exit(1 if failed else 0)


def show(findings: list[Finding]) -> None:
    """Print one line per finding, and its next step."""
    console = view.console()
    for finding in findings:
        colour = _COLOURS[finding.verdict]
        console.print(
            f"[{colour}]{finding.verdict.value:4}[/] [bold]{finding.check}[/] "
            f"{escape(finding.detail)}"
        )
        if finding.next_step:
            console.print(f"       → {escape(finding.next_step)}")


# ---------------------------------------------------------------- what is installed


def installation() -> Iterator[Finding]:
    """This package, the daemon's binary, and whether the two belong together."""
    python = f"{__version__} on Python {platform.python_version()}, {platform.machine()}"
    yield Finding("python package", Verdict.OK, python)
    yield _extras()
    try:
        binary = daemon.find()
        version = daemon.version(binary)
    except daemon.NotInstalledError:
        yield Finding("daemon", Verdict.SKIP, "not installed; a client does not need one")
        return
    except (LightprobeError, OSError) as error:
        yield Finding("daemon", Verdict.FAIL, str(error), "build it with `make build`")
        return
    yield Finding("daemon", Verdict.OK, f"{version} at {binary}")
    yield _same_version("versions", version)


#: What each extra of the package brings.
_EXTRAS = {
    "cli": ("typer", "rich"),
    "sim": ("cv2", "OpenEXR", "matplotlib"),
    "mcu": ("serial", "can", "cantools"),
    "calibrate": ("cv2", "OpenEXR", "matplotlib", "serial", "can", "cantools"),
}


def _extras() -> Finding:
    """Which groups of commands are installed."""
    there = {name: all(map(find_spec, modules)) for name, modules in _EXTRAS.items()}
    missing = [name for name, whole in there.items() if not whole]
    words = ", ".join(name for name, whole in there.items() if whole)
    if not missing:
        return Finding("extras", Verdict.OK, words)
    return Finding(
        "extras", Verdict.SKIP, f"{words}; not {', '.join(missing)}",
        f"to use their commands, {install_extras(*missing)}",
    )  # fmt: skip


def _same_version(check: str, software: str) -> Finding:
    """Compare "lightprobed 0.1.0" with this package."""
    other = software.rpartition(" ")[2]
    if other == __version__:
        return Finding(check, Verdict.OK, f"daemon and package are both {__version__}")
    return Finding(
        check, Verdict.WARN, f"daemon {other}, package {__version__}",
        "install both from the same release",
    )  # fmt: skip


# ---------------------------------------------------------------- devices and permissions


def devices(hosts_a_probe: bool) -> Iterator[Finding]:
    """Cameras and serial ports of a machine with a daemon, and whether we may open them."""
    if not hosts_a_probe:
        yield Finding("devices", Verdict.SKIP, "there is no daemon to use them")
        return
    yield _device_class("cameras", "video*", "a 360° camera on USB appears as /dev/videoN")
    yield _device_class(
        "serial ports", "tty[AU][CS][MB]*", "the microcontroller appears as /dev/ttyUSBN or ttyACMN"
    )
    yield from grabbers()


#: Programs that open or detach any serial port they see, and how to keep them off.
_GRABBERS = {
    "brltty": "takes USB serial ports for braille displays, and their /dev/ttyUSBN vanishes: "
    "without a braille display: sudo apt remove brltty, then plug the microcontroller in again",
    "ModemManager": "asks every serial port whether it is a modem, unless a udev rule forbids it: "
    "`make install` installs 71-lightprobe-mcu.rules; then plug the microcontroller in again",
}
_MCU_RULES = "71-lightprobe-mcu.rules"
_RULE_FOLDERS = ("etc/udev/rules.d", "run/udev/rules.d", "usr/local/lib/udev/rules.d",
                 "usr/lib/udev/rules.d", "lib/udev/rules.d")  # fmt: skip


def grabbers(root: Path = Path("/")) -> Iterator[Finding]:
    """Programs that take the microcontroller's serial port, where they run below `root`."""
    running = set(_program_names(root / "proc"))
    ruled = any((root / folder / _MCU_RULES).exists() for folder in _RULE_FOLDERS)
    for name, step in _GRABBERS.items():
        if name in running and not (name == "ModemManager" and ruled):
            what, _, do = step.partition(": ")
            yield Finding(f"program {name}", Verdict.WARN, f"{name} runs; it {what}", do)


def _program_names(proc: Path) -> Iterator[str]:
    """Names of all programs that run."""
    for process in proc.glob("[0-9]*/comm"):
        with suppress(OSError):  # it has ended
            yield process.read_text().strip()


def _device_class(check: str, pattern: str, absent: str) -> Finding:
    paths = sorted(Path("/dev").glob(pattern))
    if not paths:
        return Finding(check, Verdict.SKIP, f"none on this machine ({absent})")
    closed = [path for path in paths if not os.access(path, os.R_OK | os.W_OK)]
    if not closed:
        return Finding(check, Verdict.OK, f"{', '.join(map(str, paths))}: may be opened")
    return Finding(
        check, Verdict.FAIL, f"{', '.join(map(str, closed))}: permission denied", _join(closed[0])
    )


def _join(path: Path) -> str:
    """Say how to get at a device or socket."""
    mode = path.stat()
    group = _group_name(mode.st_gid)
    if mode.st_mode & stat.S_IWGRP:
        return f"sudo usermod -aG {group} $USER, then log in again"
    return f"{path} is closed to its group {group}: see the udev rule, or the socket's ?mode="


def _group_name(number: int) -> str:
    """Name of a group; its number where there is none."""
    try:
        from grp import getgrgid  # not on Windows

        return getgrgid(number).gr_name
    except (ImportError, KeyError):
        return str(number)


# ---------------------------------------------------------------- a running probe


def probe(uri: str, wait_s: float) -> Iterator[Finding]:
    """Connection, greeting, estimate, rate, flags and health of a probe."""
    try:
        address = Address.parse(uri)
    except ProbeError as error:
        yield Finding("address", Verdict.FAIL, str(error), "tcp:HOST:PORT or unix:PATH")
        return
    if address.path is not None:
        finding = _socket(Path(address.path))
        yield finding
        if finding.verdict is Verdict.FAIL:
            return
    with Client(uri, Subscription(max_lights=8, health_period_ms=500)) as client:
        if not client.wait_for(lambda c: c.connected, wait_s):
            why = client.last_error or f"{uri}: no answer in {wait_s:g} s"
            why = why.removesuffix(" (lightprobe doctor)")
            yield Finding("connection", Verdict.FAIL, why, "lightprobed --source=… (see --help)")
            return
        yield from _greeting(client)
        yield from _light(client, wait_s)
        yield from _health(client, wait_s)


def _socket(path: Path) -> Finding:
    """A Unix socket: there, one, ours to open."""
    if not path.exists():
        return Finding(
            "socket", Verdict.FAIL, f"{path}: no such file",
            f"start lightprobed with --publish=unix:{path}",
        )  # fmt: skip
    if not path.is_socket():
        return Finding("socket", Verdict.FAIL, f"{path} is no socket", "name the daemon's socket")
    if not os.access(path, os.R_OK | os.W_OK):
        return Finding("socket", Verdict.FAIL, f"{path}: permission denied", _join(path))
    return Finding("socket", Verdict.OK, f"{path}: may be opened")


_PROCESSING_STEP = (
    "the log of lightprobed says why it is not off; stop it and `lightprobe check-camera SOURCE` "
    "says what that does to the light (docs/users/camera_calibration.md)"
)


def _greeting(client: Client) -> Iterator[Finding]:
    hello = client.hello
    if hello is None:  # lost again already
        yield Finding("connection", Verdict.FAIL, client.last_error or "lost", "try again")
        return
    yield Finding("connection", Verdict.OK, f"{hello.software} at {client.uri}")
    yield _same_version("probe's version", hello.software)
    parts = [f"source {hello.source}", f"preset {hello.preset}", f"clock {hello.clock}"]
    parts += [f"smoothing {hello.smoothing_time_constant_ms} ms"]
    parts += ["wheel" if hello.has_wheel else "no wheel", "ring" if hello.has_ring else "no ring"]
    yield Finding("probe", Verdict.OK, ", ".join(parts))
    if hello.processing:
        words = f"the camera alters the light: {', '.join(hello.processing)}"
        yield Finding("processing", Verdict.WARN, words, _PROCESSING_STEP)


def _light(client: Client, wait_s: float) -> Iterator[Finding]:
    """First estimate, rate, and what its flags say."""
    try:
        estimate = client.receive(wait_s)
    except ProbeTimeout as error:
        step = "is the camera connected? see the source below, and the log of lightprobed"
        yield Finding("estimate", Verdict.FAIL, str(error), step)
        return
    before, started = client.statistics.estimates, time.monotonic()
    time.sleep(_RATE_OVER_S)
    count, elapsed_s = client.statistics.estimates - before, time.monotonic() - started
    estimate = client.latest() or estimate
    age_ms = client.age_ms() or 0.0
    stale = EstimateFlag.STALE in estimate.flags or client.latest() is None
    words = f"{len(estimate.lights)} lamps, SH of order {estimate.sh.order}, {age_ms:.0f} ms old"
    if stale:
        step = "does the camera still send? see the source below"
        yield Finding("estimate", Verdict.FAIL, words + ", stale", step)
    else:
        yield Finding("estimate", Verdict.OK, words)
    yield _rate(count / elapsed_s, stale)
    yield from _flags(estimate)


def _rate(rate_hz: float, stale: bool) -> Finding:
    words = f"{rate_hz:.1f} estimates/s"
    if rate_hz >= _SLOW_HZ or stale:
        return Finding("rate", Verdict.SKIP if stale else Verdict.OK, words)
    step = "is the camera slow, or the machine busy (top)? a faster preset: --preset=fast"
    return Finding("rate", Verdict.WARN, words, step)


_NEXT_STEPS = {
    "EXPOSURE_UNKNOWN": "use a fixed exposure, or a camera that reports it",
    "CLIPPED": "use shorter exposures, or more of them (--brackets)",
    "UNDEREXPOSED": "use a longer exposure or more gain",
    "PARTIAL_VIEW": "check the lenses and masks in the camera file",
    "MORE_LIGHTS": "subscribe to more lights, up to 8",
    "NO_LIGHT": "is the lens cap on?",
    "EXPOSURE_IGNORED": "does another program hold the controls of the camera? "
    "lightprobe check-camera SOURCE",
}


def _flags(estimate: Estimate) -> Iterator[Finding]:
    for name in flag_names(estimate.flags):
        if name != "STALE":
            words = FLAG_WORDS.get(name, "unknown to this version")
            yield Finding(f"flag {name}", Verdict.WARN, words, _NEXT_STEPS.get(name, ""))


def _health(client: Client, wait_s: float) -> Iterator[Finding]:
    """Counters and faults that the daemon tells."""
    if not client.wait_for(lambda c: c.health is not None, wait_s):
        yield Finding(
            "health",
            Verdict.WARN,
            "no health message came",
            "are daemon and package of the same release?",
        )
        return
    health = client.health
    assert health is not None
    verdicts = {"STREAMING": Verdict.OK, "ENDED": Verdict.WARN, "WAITING": Verdict.FAIL}
    verdict = verdicts.get(health.source_state, Verdict.FAIL)
    step = "" if verdict is Verdict.OK else "check cable, power and URI of the source"
    frames = (
        f"{health.source_state.lower()}: {health.frames_received} frames, "
        f"{health.frames_dropped} dropped, {health.frames_rejected} rejected, "
        f"{health.source_reconnects} reconnections"
    )
    yield Finding("source", verdict, frames, step)
    rejected = health.frames_rejected > 0.05 * max(health.frames_received, 1)
    if rejected:
        step = "check cable and hub, and the size in the camera file; see the log of lightprobed"
        yield Finding("frames", Verdict.WARN, "more than one in twenty rejected", step)
    load = (
        f"latency p50 {health.latency_p50_us / 1000:.1f} ms, "
        f"p99 {health.latency_p99_us / 1000:.1f} ms, cpu {health.cpu_percent:.0f} %, "
        f"{health.rss_kib / 1024:.0f} MiB, {health.clients} clients"
    )
    yield Finding("load", Verdict.OK, load)
    if health.places_left_out:
        yield Finding(
            "pixels", Verdict.WARN,
            f"{health.places_left_out} places of the pictures shine by themselves and are left out",
            "stuck pixels, or a light of the box before a lens: the log of lightprobed names them; "
            "so can stuck_pixels in the camera file, which lightprobe check-camera SOURCE writes",
        )  # fmt: skip
    for fault in health.faults:
        verdict = Verdict.WARN if fault.id in MINOR_FAULTS else Verdict.FAIL
        yield Finding(f"fault {fault.id}", verdict, fault.text)
