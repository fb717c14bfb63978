# SPDX-License-Identifier: Apache-2.0
"""The daemon on a servo hat: registers on an I2C bus, the comb's sensor on a GPIO line.

A servo and a wheel read the hat's registers and pull the line; slowly, as this machine is emulated.
"""

import ctypes
import fcntl
import os
import signal
import threading
import time
from pathlib import Path

import pytest
from lightprobe_proto import lightprobe_pb2 as pb
from machine import modprobe, wait_for
from test_gpio import Chip

from daemon import BUILD, Daemon

HAT = 0x40
I2C_RDWR = 0x0707
LED0 = 0x06
LINE = 3
FIRST_DEG, PITCH_DEG, EDGES = -16.5, 6.0, 34
BUILDS = (BUILD, BUILD.parent / "gpiod2")  # on the system's libgpiod, and on version 2
Phase = pb.Wheel.Phase


class Message(ctypes.Structure):
    """struct i2c_msg."""

    _fields_ = (
        ("addr", ctypes.c_uint16),
        ("flags", ctypes.c_uint16),
        ("len", ctypes.c_uint16),
        ("buf", ctypes.c_char_p),
    )


class Transfer(ctypes.Structure):
    """struct i2c_rdwr_ioctl_data."""

    _fields_ = (("msgs", ctypes.POINTER(Message)), ("nmsgs", ctypes.c_uint32))


class Wheel(threading.Thread):
    """A servo that follows the hat's pulses, and its wheel under a sensor."""

    def __init__(self, bus: str, chip: Chip) -> None:
        super().__init__(daemon=True)
        self._bus = os.open(bus, os.O_RDWR)
        self._chip = chip
        self.deg = 37.0
        self.stuck = False
        self.pulse_us = 0.0
        self._ended = threading.Event()
        self._level = self._tooth()
        self._chip.pull(LINE, "down" if self._level else "up")
        self.start()

    def _below(self) -> int:
        return min(max(-int(-(self.deg - FIRST_DEG) // PITCH_DEG), 0), EDGES)

    def _tooth(self) -> bool:
        return self._below() % 2 == 1

    def _read_pulse_us(self) -> float:
        values = ctypes.create_string_buffer(4)
        register = ctypes.create_string_buffer(bytes([LED0]), 1)
        messages = (Message * 2)(
            Message(HAT, 0, 1, ctypes.cast(register, ctypes.c_char_p)),
            Message(HAT, 1, 4, ctypes.cast(values, ctypes.c_char_p)),
        )
        fcntl.ioctl(self._bus, I2C_RDWR, Transfer(messages, 2))
        _, _, low, high = values.raw
        return 0.0 if high & 0x10 else (high << 8 | low) * 1e6 / (4096 * 50)

    def step(self, elapsed_s: float) -> None:
        """Turn towards what the pulse asks for; show every edge on the way."""
        try:
            self.pulse_us = self._read_pulse_us()
        except OSError:
            return
        if self.pulse_us == 0 or self.stuck:
            return
        asked = (self.pulse_us - 800) / 7.407
        most = 400 * elapsed_s
        goal = self.deg + min(max(asked - self.deg, -most), most)
        while self.deg != goal:
            self.turn_to(self.deg + min(max(goal - self.deg, -2), 2))

    def turn_to(self, deg: float) -> None:
        """Be there, at most one edge further."""
        self.deg = deg
        if self._tooth() != self._level:
            self._level = not self._level
            self._chip.pull(LINE, "down" if self._level else "up")

    def run(self) -> None:
        """Follow until stop()."""
        before = time.monotonic()
        while not self._ended.wait(0.005):
            now = time.monotonic()
            self.step(now - before)
            before = now

    def stop(self) -> None:
        """End it and wait."""
        self._ended.set()
        self.join()
        self.step(0)
        os.close(self._bus)


def register_bus() -> str:
    """Device of a bus with register files at the hat's address."""
    modprobe("i2c-dev")
    modprobe("i2c_rdwr", "chips=0x40,0x68")
    for adapter in Path("/sys/class/i2c-adapter").iterdir():
        if (adapter / "name").read_text().strip() == "lightprobe register files":
            return f"/dev/{adapter.name}"
    raise AssertionError("no adapter appeared")


@pytest.fixture(scope="module")
def bus():
    return register_bus()


@pytest.fixture(scope="module")
def chip():
    chip = Chip()
    chip.pull(LINE, "up")
    return chip


def hat(bus: str, chip: Chip, line: int = LINE, build: Path = BUILD) -> Daemon:
    rotator = f"pca9685:{bus}?chip={chip.name}&line={line}&slew_deg_s=20&lag_ms=20"
    return Daemon("sim:/run/no-camera", f"--rotator={rotator}", "--wheel-angles=0,45", build=build)


def faults(health: pb.Health) -> set[str]:
    return {f.id for f in health.faults} - {"source-waiting"}


def settled_at(angle_deg: float):
    return lambda h: (
        h.wheel.phase == Phase.SETTLED and h.wheel.measured_deg == angle_deg and not faults(h)
    )


@pytest.mark.parametrize(
    "build", [pytest.param(BUILDS[0], marks=pytest.mark.nightly), BUILDS[1]],
    ids=lambda build: build.name,
)  # fmt: skip
def test_moves_slips_and_a_hat_that_goes(bus, chip, build):
    nack = Path("/sys/module/i2c_rdwr/parameters/nack")
    wheel = Wheel(bus, chip)
    daemon = hat(bus, chip, build=build)
    try:
        for angle in (0, 45):
            daemon.wait_health(f"at {angle}", settled_at(angle), timeout_s=120)
            assert abs(wheel.deg - angle) < 3 * 1.7
        wheel.stuck = True
        # Which of the two depends on where it stands.
        names = {"INDEX_NEVER", "INDEX_ALWAYS"}
        daemon.wait_health("stuck", lambda h: faults(h) & names, timeout_s=120)
        wheel.stuck = False
        daemon.wait_health("free", settled_at(45), timeout_s=120)
        nack.write_text(str(HAT))
        health = daemon.wait_health("hat gone", lambda h: faults(h) == {"pca9685-waiting"})
        assert health.wheel.phase == Phase.ABSENT
        assert any("address and power" in f.text for f in health.faults)
        nack.write_text("-1")
        daemon.wait_health("hat back", settled_at(0), timeout_s=120)
    finally:
        nack.write_text("-1")
        daemon.stop()
        wheel.stop()
    assert wheel.pulse_us == 0  # let go


def test_pulses_end_when_the_daemon_is_killed(bus, chip):
    wheel = Wheel(bus, chip)
    daemon = hat(bus, chip)
    try:
        daemon.wait_health("at 0", settled_at(0), timeout_s=120)
        wait_for("pulses", lambda: wheel.pulse_us > 0)
        daemon.stop(by=signal.SIGKILL)
        wait_for("no pulses", lambda: wheel.pulse_us == 0)
    finally:
        daemon.stop(by=signal.SIGKILL)
        wheel.stop()


@pytest.mark.parametrize("build", BUILDS, ids=lambda build: build.name)
def test_a_line_that_is_not_there_is_named(bus, chip, build):
    daemon = hat(bus, chip, line=99, build=build)
    health = daemon.wait_health("no line", lambda h: "pca9685-waiting" in faults(h))
    assert any("gpioinfo" in f.text for f in health.faults)
    daemon.stop()
