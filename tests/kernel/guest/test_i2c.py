# SPDX-License-Identifier: Apache-2.0
"""I2C: a bus that takes raw transfers, as a microcontroller's mailbox needs them."""

from pathlib import Path

import pytest
from machine import modprobe, run

PARAMETERS = Path("/sys/module/i2c_rdwr/parameters")


def load_bus() -> str:
    """Load the module: chips at 0x40 and 0x68, nine sensors at 0x10 behind 0x70 and 0x71.

    Returns the number of the bus.
    """
    modprobe("i2c-dev")
    modprobe("i2c_rdwr", "chips=0x40,0x68", "muxes=0x70,0x71", "sensor=0x10")
    for adapter in Path("/sys/class/i2c-adapter").iterdir():
        if (adapter / "name").read_text().strip() == "lightprobe register files":
            return adapter.name.removeprefix("i2c-")
    raise AssertionError("no adapter appeared")


@pytest.fixture(scope="module")
def bus():
    """Number of the bus."""
    return load_bus()


def test_registers_keep_what_was_written(bus):
    run("i2ctransfer", "-y", bus, "w3@0x40", "0x10", "0xab", "0xcd")
    assert run("i2ctransfer", "-y", bus, "w1@0x40", "0x10", "r2").split() == ["0xab", "0xcd"]
    assert run("i2ctransfer", "-y", bus, "w1@0x68", "0x10", "r2").split() == ["0x00", "0x00"]


def test_absent_chip_does_not_answer(bus):
    assert "Error" in run("i2ctransfer", "-y", bus, "r1@0x41", check=False)


def test_faults_on_request(bus):
    (PARAMETERS / "nack").write_text(str(0x40))
    assert "Error" in run("i2ctransfer", "-y", bus, "r1@0x40", check=False)
    (PARAMETERS / "nack").write_text("-1")
    run("i2ctransfer", "-y", bus, "r1@0x40")
