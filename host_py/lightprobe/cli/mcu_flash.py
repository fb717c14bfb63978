"""`lightprobe mcu flash`: write the firmware to the microcontroller, by avrdude."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from lightprobe import installation
from lightprobe.errors import UsageError
from lightprobe.mcu.link import McuError, keep_dtr
from lightprobe.mcu.session import DEFAULT_PORT, ENVIRONMENT, session, words
from lightprobe.sim.box import ENVIRONMENT as FOLDER

#: Optiboot listens for one second after a reset. On a busy machine avrdude can miss it where it
#: cannot reset the chip itself, as on a line without DTR.
_ATTEMPTS = 3
_ATMEGABOOT_BAUD = 57600
#: Boot loaders of the ATmega328P are in its last 2 KiB, or less.
_BOOT_LOADER = 0x7800
_ATMEGABOOT_WARNING = (
    "lightprobe: mcu: flash: warning: this boot loader (ATmegaBOOT) hangs after a watchdog reset "
    "until the power is cut: burn Optiboot with a programmer (docs/builders/bring_up.md)"
)


def command(
    port: Annotated[
        str,
        typer.Option(
            "--port",
            "-p",
            envvar=ENVIRONMENT,
            help="serial:DEVICE; the boot loader speaks on the serial line only.",
        ),
    ] = DEFAULT_PORT,
    file: Annotated[
        Path | None, typer.Option("--hex", help="Intel HEX; default: what `make build` built.")
    ] = None,
    boot_baud: Annotated[
        int,
        typer.Option(
            min=300, max=2_000_000, help="Baud rate of the boot loader; old Nanos: 57600."
        ),
    ] = 115200,
    verify: Annotated[
        bool, typer.Option(help="Check that it answers, else put the former one back.")
    ] = True,
) -> None:
    """Write the firmware through the boot loader of an Arduino, and check that it answers.

    Parameters in the EEPROM stay. When it does not answer, the former firmware is written back.
    """
    scheme, _, device = port.removeprefix("mcu:").partition("?")[0].partition(":")
    if scheme != "serial" or not device:
        raise UsageError(
            f"mcu: flash: {port}: the boot loader is on the serial line: serial:DEVICE"
        )
    hex_file = file or default_hex()
    if not hex_file.is_file():
        raise UsageError(
            f"mcu: flash: {hex_file}: no such file: build it with `make firmware`, "
            "or name one with --hex"
        )
    if shutil.which("avrdude") is None:
        raise McuError("mcu: flash: avrdude is not installed: apt install avrdude")
    if boot_baud == _ATMEGABOOT_BAUD:
        print(_ATMEGABOOT_WARNING, file=sys.stderr)
    wanted = f"flash:w:{hex_file}:i"
    if not verify:
        _program(port, device, boot_baud, wanted)
        return
    handle, name = tempfile.mkstemp(prefix="lightprobe-former-", suffix=".hex")
    os.close(handle)
    former = Path(name)
    try:
        _program(port, device, boot_baud, f"flash:r:{former}:i", stays=False)
    except McuError:
        former.unlink()
        raise
    with _undisturbed(), _kept(former):
        try:
            _program(port, device, boot_baud, wanted)
            print(f"{port}: firmware {_answer(port)} answers")
        except McuError as error:
            if ": in use" in str(error):  # nothing is known against the new one
                raise
            _put_back(port, device, boot_baud, former, str(error))


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Ctrl-C and SIGTERM wait until the block ends, for avrdude, too: half a firmware is none."""
    if os.name == "nt":
        yield
        return
    waiting = {signal.SIGINT, signal.SIGTERM}
    signal.pthread_sigmask(signal.SIG_BLOCK, waiting)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, waiting)


@contextmanager
def _kept(former: Path) -> Iterator[None]:
    """The former firmware, deleted when it is of no more use; else it is said where it is."""
    try:
        yield
    except _PutBackError:
        former.unlink()
        raise
    except BaseException:
        print(f"lightprobe: mcu: flash: the former firmware is kept in {former}", file=sys.stderr)
        raise
    former.unlink()


class _PutBackError(McuError):
    """The former firmware runs again."""


def _program(port: str, device: str, boot_baud: int, memory: str, *, stays: bool = True) -> None:
    """Read or write by avrdude; tries again, as the boot loader listens briefly.

    `stays`: the next opening of the line does not reset the chip.
    """
    avrdude = ["avrdude", "-p", "m328p", "-c", "arduino", "-P", device, "-b", str(boot_baud),
               "-U", memory]  # fmt: skip
    for attempt in range(1, _ATTEMPTS + 1):
        with words(port, "open"), _locked(device) as descriptor:
            status = subprocess.run(avrdude).returncode
            # A fall of DTR lets the next opening reset the chip.
            if descriptor is not None:
                keep_dtr(descriptor, keep=status == 0 and stays)
        if status == 0:
            return
        print(f"lightprobe: mcu: flash: {device}: attempt {attempt} of {_ATTEMPTS}: avrdude ended "
              f"with status {status}", file=sys.stderr)  # fmt: skip
    raise McuError(
        f"mcu: flash: {device}: avrdude ended with status {status}: is it the right "
        f"port? for an old boot loader add --boot-baud=57600"
    )


def _answer(port: str) -> str:
    """Version of the firmware that answers; raises McuError."""
    with session(port) as link:
        return ".".join(str(link.greeting[f"firmware_{part}"])
                        for part in ("major", "minor", "patch"))  # fmt: skip


def _put_back(port: str, device: str, boot_baud: int, former: Path, why: str) -> NoReturn:
    """Write the former firmware again; raises McuError that says what runs now."""
    program = _without_boot_loader(former.read_text())
    if not _has_program(program):
        raise McuError(f"mcu: flash: {device}: {why}; there was no former firmware: try again")
    cut = former.with_suffix(".program.hex")
    cut.write_text(program)
    try:
        _program(port, device, boot_baud, f"flash:w:{cut}:i")
        version = _answer(port)
    except McuError as error:
        raise McuError(
            f"mcu: flash: {device}: the new firmware does not answer ({why}), and the former one "
            f"could not be brought back ({error}): look at the wiring, then try again"
        ) from None
    finally:
        cut.unlink()
    raise _PutBackError(
        f"mcu: flash: {device}: the new firmware does not answer ({why}): the former one is back, "
        f"and firmware {version} answers"
    )


def _has_program(intel_hex: str) -> bool:
    """Whether any byte differs from those of an erased chip."""
    data = (line[9:-2] for line in intel_hex.splitlines() if line[7:9] == "00")
    return any(set(bytes_) - {"F", "f"} for bytes_ in data)


def _without_boot_loader(intel_hex: str) -> str:
    """Leave out what lies where a boot loader may be: it must not write over itself."""
    kept = []
    for line in intel_hex.splitlines():
        is_data = line[7:9] == "00"
        if not is_data or int(line[3:7], 16) < _BOOT_LOADER:
            kept.append(line)
    return "\n".join(kept) + "\n"


@contextmanager
def _locked(device: str) -> Iterator[int | None]:
    """Keep lightprobed and other tools off the port, which avrdude itself does not do."""
    if os.name == "nt":  # which gives a port to one program alone
        yield None
        return
    import fcntl

    descriptor = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield descriptor
    finally:
        os.close(descriptor)


def default_hex() -> Path:
    """Firmware of $LIGHTPROBE_FIRMWARE, or of this installation."""
    file, folder = installation.firmware(), os.environ.get(FOLDER)
    return Path(folder) / file.name if folder else file
