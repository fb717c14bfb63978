"""The microcontroller's box: its firmware as a process around a simulated wheel and ring.

The firmware is the flashed binary in simavr ("avr") or the same sources built for this machine
("host"). The box has numbers with names (firmware/board/host/world.h): what is built how, what is
broken, what light falls on the LDRs, where the wheel is. Its time is the wall clock's, or a
simulated one (lock-step).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

import numpy as np

from lightprobe.errors import LightprobeError, UsageError
from lightprobe.geometry import Array

FIRMWARES = ("host", "avr", "none")
ENVIRONMENT = "LIGHTPROBE_FIRMWARE"
RESET = "reset"  # stands among the numbers, and resets the microcontroller
_PROGRAMS = {"host": "lightprobe-mcu-host", "avr": "lightprobe-mcu-simavr"}
_TARGETS = {"host": "firmware-host", "avr": "firmware-avr"}
_ELF = "lightprobe-mcu.elf"
_PATIENCE_S = 5.0
_SAMPLES = 9
#: Within such an angle Malus' law is straight enough for one sample (error below 0.1 %).
_STRAIGHT_DEG = 4.0
_AT_REST_DEG = 0.02
_ABOUT_TIME = ("error: not yet", "error: forgotten")


class BoxError(LightprobeError):
    """The firmware's process cannot be started, or has ended."""


def find(firmware: str, lock_step: bool = False) -> list[str]:
    """Command line of a firmware, in real time or in lock-step.

    From $LIGHTPROBE_FIRMWARE (a folder), beside Python, on PATH.
    """
    program = _PROGRAMS[firmware]
    folder = os.environ.get(ENVIRONMENT)
    tried = [Path(folder or Path(sys.executable).parent) / program]
    if not folder:
        tried += [Path(path) for path in [shutil.which(program)] if path]
    for path in tried:
        if os.access(path, os.X_OK) and path.is_file():
            break
    else:
        raise BoxError(
            f"simulate: firmware {firmware}: no {program} in {tried[0].parent}"
            f"{'' if folder else ' or on PATH'}: build it with `make {_TARGETS[firmware]}`, "
            f"or name its folder in ${ENVIRONMENT}"
        )
    if firmware == "host":
        return [str(path), *(["--lock-step"] if lock_step else [])]
    elf = path.resolve().parent / _ELF
    if not elf.is_file():
        raise BoxError(f"simulate: firmware avr: {elf} is missing: build it with `make firmware`")
    return [str(path), str(elf), *([] if lock_step else ["--real-time"])]


class Box:
    """A running firmware; a context manager. All methods may be called from any thread."""

    def __init__(
        self,
        firmware: str,
        pty: Path,
        seed: int = 0,
        eeprom: Path | None = None,
        lock_step: bool = False,
    ) -> None:
        """`pty`: symbolic link to make, the serial line. `eeprom`: file that keeps parameters.

        `lock_step`: its time goes on in :meth:`run` only.
        """
        self._lock = threading.Lock()
        self._lux = np.full(9, -1.0)
        command = [*find(firmware, lock_step), "--pty", str(pty), "--seed", str(seed + 1)]
        if eeprom is not None:
            command += ["--eeprom", str(eeprom)]
        # It ends with its standard input: also when this process is killed.
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True, bufsize=1, start_new_session=True,
        )  # fmt: skip
        self.names = frozenset(self.command("names").split()) | {RESET}

    def __enter__(self) -> Self:
        """Give itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the firmware; the serial line goes with it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def command(self, *lines: str) -> str:
        """Send commands; give the last one's answer. UsageError when the box refuses one."""
        with self._lock:
            stdin, stdout = self._process.stdin, self._process.stdout
            assert stdin is not None
            assert stdout is not None
            try:
                stdin.write("".join(f"{line}\n" for line in lines))
                answers = [stdout.readline() for _ in lines]
            except (OSError, ValueError):
                answers = [""]
        if not all(answers):
            raise self._ended()
        for line, answer in zip(lines, answers, strict=True):
            if answer.startswith("error: ") and answer.strip() not in _ABOUT_TIME:
                raise UsageError(f"simulate: box: {line}: {answer.removeprefix('error: ').strip()}")
        return answers[-1].strip()

    def _ended(self) -> BoxError:
        try:
            status: int | str = self._process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            status = "unknown"
        assert self._process.stderr is not None
        words = self._process.stderr.read().strip() if status != "unknown" else ""
        return BoxError(f"simulate: firmware: ended with status {status}: {words or 'no word'}")

    def set(self, **numbers: float) -> None:
        """Set numbers of the box; `reset` resets the microcontroller."""
        lines = [
            RESET if name == RESET else f"set {name} {value:.9g}" for name, value in numbers.items()
        ]
        if lines:
            self.command(*lines)

    def shine(self, lux: Array) -> None:
        """Let illuminances (9,) fall on the ring; those that it has already are not sent again."""
        if not np.array_equal(lux, self._lux):
            self.set(**{f"ldr{k}_lux": float(value) for k, value in enumerate(lux)})
            self._lux = np.array(lux, dtype=np.float64)

    def run(self, us: int) -> None:
        """Let time go on, in lock-step, and put on the line what the firmware has sent."""
        self.command(f"run {us}", "flush")

    def get(self, name: str) -> float:
        """Read a number of the box."""
        return float(self.command(f"get {name}"))

    def angles_deg(self, from_ns: int, to_ns: int) -> tuple[float, ...] | None:
        """Angles that the wheel went through from `from_ns` to `to_ns` (CLOCK_MONOTONIC).

        None when that is so long ago (3 s) that the box has forgotten. One for a wheel at rest,
        else so many at equal distance in time that Malus' law is nearly straight between them.
        Waits until the box has got there.
        """
        deadline = time.monotonic() + _PATIENCE_S
        while True:
            answer = self.command(f"angles {from_ns} {to_ns} {_SAMPLES}")
            if answer == "error: forgotten":
                return None
            if not answer.startswith("error"):
                break
            if time.monotonic() > deadline:
                raise BoxError(
                    "simulate: firmware: its clock does not advance: is the process stopped?"
                )
            time.sleep(0.001)
        return thinned(np.array([float(word) for word in answer.split()]))


def thinned(angles_deg: Array) -> tuple[float, ...]:
    """Give fewer samples of a motion, at the middles of equal parts; see Box.angles_deg."""
    span = float(np.ptp(angles_deg))
    if span < _AT_REST_DEG:
        return (round(float(angles_deg.mean()), 2),)
    parts = min(int(np.ceil(span / _STRAIGHT_DEG)), len(angles_deg))
    middles = (np.arange(parts) + 0.5) / parts * (len(angles_deg) - 1)
    return tuple(np.interp(middles, np.arange(len(angles_deg)), angles_deg).tolist())


class Illumination(threading.Thread):
    """Keeps the light on the box's ring as it is in the world, until :meth:`stop`."""

    PERIOD_S = 0.02
    _WORTH = 5e-4  # smaller relative changes are not told

    def __init__(
        self, box: Box, lux_now: Callable[[], Array], on_error: Callable[[], None]
    ) -> None:
        """`lux_now` gives nine illuminances; `on_error` is called when the box has ended."""
        super().__init__(daemon=True)
        self._box, self._lux_now, self._on_error = box, lux_now, on_error
        self._ending = threading.Event()
        self.fixed_lux: float | None = None  # the same on all nine instead, as in a light box
        self.error: BoxError | None = None

    def run(self) -> None:
        """See :class:`threading.Thread`."""
        told = np.full(9, -1.0)
        while not self._ending.wait(self.PERIOD_S):
            lux = self._lux_now() if self.fixed_lux is None else np.full(9, self.fixed_lux)
            if np.all(np.abs(lux - told) <= self._WORTH * told):
                continue
            try:
                self._box.set(**{f"ldr{k}_lux": float(value) for k, value in enumerate(lux)})
            except BoxError as error:
                self.error = error
                self._on_error()
                return
            told = lux

    def stop(self) -> None:
        """End; returns when it has ended."""
        self._ending.set()
        self.join()
