"""`lightprobe mcu flash`: write the firmware to the microcontroller, by avrdude."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from lightprobe.errors import UsageError
from lightprobe.mcu.link import McuError
from lightprobe.mcu.session import DEFAULT_PORT, ENVIRONMENT, session
from lightprobe.sim.box import ENVIRONMENT as FOLDER

_HEX = "lightprobe-mcu.hex"


def command(
    port: Annotated[
        str, typer.Option("--port", "-p", envvar=ENVIRONMENT, help="serial:DEVICE; no other.")
    ] = DEFAULT_PORT,
    file: Annotated[
        Path | None, typer.Option("--hex", help="Intel HEX; default: what `make firmware` built.")
    ] = None,
    boot_baud: Annotated[int, typer.Option(help="Of the boot loader; old Nanos: 57600.")] = 115200,
    verify: Annotated[bool, typer.Option(help="Greet the new firmware afterwards.")] = True,
) -> None:
    """Write the firmware through an Arduino's boot loader, and greet it. Parameters stay."""
    scheme, _, device = port.removeprefix("mcu:").partition("?")[0].partition(":")
    if scheme != "serial" or not device:
        raise UsageError(
            f"mcu: flash: {port}: the boot loader is on the serial line: serial:DEVICE"
        )
    hex_file = file or default_hex()
    if not hex_file.is_file():
        raise UsageError(f"mcu: flash: {hex_file}: no such file: build it with `make firmware`")
    if shutil.which("avrdude") is None:
        raise McuError("mcu: flash: avrdude is not installed: apt install avrdude")
    done = subprocess.run(
        ["avrdude", "-p", "m328p", "-c", "arduino", "-P", device, "-b", str(boot_baud),
         "-U", f"flash:w:{hex_file}:i"]
    )  # fmt: skip
    if done.returncode != 0:
        raise McuError(
            f"mcu: flash: {device}: avrdude ended with status {done.returncode}: is lightprobed "
            "off the port? an old boot loader? --boot-baud=57600"
        )
    if verify:
        with session(port) as link:
            parts = (link.greeting[f"firmware_{part}"] for part in ("major", "minor", "patch"))
            print(f"{port}: firmware {'.'.join(map(str, parts))} answers")


def default_hex() -> Path:
    """Firmware of this installation: $LIGHTPROBE_FIRMWARE, or where `make firmware` puts it."""
    folder = os.environ.get(FOLDER)
    if folder:
        return Path(folder) / _HEX
    # build/venv/bin/python is beside build/firmware.
    return Path(sys.executable).parents[2] / "firmware" / _HEX
