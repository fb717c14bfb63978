"""The texts of faults fit into what clients are sent."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MAX_BYTES = (
    int(re.search(r"char text\[(\d+)\]", (ROOT / "daemon/serve/health.h").read_text())[1]) - 1
)
MCU_FAULTS = tomllib.loads((ROOT / "proto/mcu_faults.toml").read_text())
#: As the service's configuration names the microcontroller, with the longest detail.
OBJECT, DETAIL = "mcu:serial:/dev/lightprobe-mcu", "-32768"


def stopped(file):
    """What a driver adds when it has given up."""
    return re.search(r'#define STOPPED "(.*)"', (ROOT / file).read_text())[1]


@pytest.mark.parametrize("name", MCU_FAULTS)
def test_a_fault_of_the_microcontroller_fits(name):
    fault = MCU_FAULTS[name]
    text = f"{OBJECT}: {name} ({DETAIL}): {fault['means']}: {fault['next_step']}"
    assert len(text.encode()) <= MAX_BYTES, text


def test_the_end_of_the_attempts_fits():
    longest = max(MCU_FAULTS, key=len)
    end = stopped("daemon/drivers/link/mcu_recovery.c")
    text = f"{OBJECT}: {longest}, homed again: {longest}{end}"
    assert len(text.encode()) <= MAX_BYTES, text


def test_a_fault_of_the_servo_hats_wheel_fits():
    code = (ROOT / "daemon/drivers/wheel/timed.c").read_text()
    faults = re.findall(r'fail\(timed, "(\w+)",\s*((?:"[^"]*"\s*)+),', code)
    assert len(faults) > 5
    end = stopped("daemon/drivers/wheel/pca9685/pca9685.c")
    for name, pieces in faults:
        words = "".join(re.findall(r'"([^"]*)"', pieces))
        text = f"pca9685:/dev/i2c-1: {name}: {words}{end}"
        assert len(text.encode()) <= MAX_BYTES, text
