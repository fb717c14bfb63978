# SPDX-License-Identifier: Apache-2.0
"""GPIO: simulated lines, driven and read through libgpiod's tools."""

import subprocess
from pathlib import Path

import pytest
from machine import modprobe, run, wait_for

CONFIGFS = Path("/sys/kernel/config")


class Chip:
    """A simulated chip of eight lines."""

    def __init__(self, name: str = "probe", lines: dict[int, str] | None = None) -> None:
        modprobe("irq_sim")
        modprobe("gpio-sim")
        if not (CONFIGFS / "gpio-sim").exists():
            run("mount", "-t", "configfs", "configfs", str(CONFIGFS))
        device = CONFIGFS / "gpio-sim" / name
        for line, label in (lines or {3: "INDEX", 5: "LED"}).items():
            (device / "bank" / f"line{line}").mkdir(parents=True)
            (device / "bank" / f"line{line}" / "name").write_text(label)
        (device / "bank" / "num_lines").write_text("8")
        (device / "live").write_text("1")
        self.name = (device / "bank" / "chip_name").read_text().strip()
        platform = (device / "dev_name").read_text().strip()
        self._device = device
        self._lines = Path("/sys/devices/platform") / platform / self.name

    def remove(self) -> None:
        """Take the chip away again."""
        (self._device / "live").write_text("0")
        for folder in sorted(self._device.rglob("*"), reverse=True):
            if folder.is_dir():
                folder.rmdir()
        self._device.rmdir()

    def pull(self, line: int, direction: str) -> None:
        """Let the outside world pull a line `up` or `down`."""
        (self._lines / f"sim_gpio{line}" / "pull").write_text(f"pull-{direction}")

    def value(self, line: int) -> str:
        """Level of a line, as the outside world sees it."""
        return (self._lines / f"sim_gpio{line}" / "value").read_text().strip()


@pytest.fixture(scope="module")
def chip():
    return Chip()


def test_input_follows_the_pull(chip):
    assert "INDEX" in run("gpioinfo", chip.name)
    chip.pull(3, "up")
    assert run("gpioget", chip.name, "3").strip() == "1"
    chip.pull(3, "down")
    assert run("gpioget", chip.name, "3").strip() == "0"


def test_output_is_seen_outside(chip):
    with subprocess.Popen(["gpioset", "--mode=signal", chip.name, "5=1"]) as holder:
        wait_for("LED on", lambda: chip.value(5) == "1")
        holder.terminate()


def test_edges_are_events(chip):
    chip.pull(3, "down")
    with subprocess.Popen(
        ["stdbuf", "-oL", "gpiomon", "-n", "2", chip.name, "3"], stdout=subprocess.PIPE, text=True
    ) as monitor:
        wait_for("gpiomon", lambda: "gpiomon" in run("gpioinfo", chip.name))
        # One at a time: edges closer than the interrupt's work become one.
        chip.pull(3, "up")
        assert "RISING" in monitor.stdout.readline()
        chip.pull(3, "down")
        assert "FALLING" in monitor.stdout.readline()
