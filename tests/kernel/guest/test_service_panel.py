# SPDX-License-Identifier: Apache-2.0
"""lightprobe-panel.service: with what systemd lets it do, it drives the LED, and shuts down."""

from pathlib import Path

import pytest
from machine import run, wait_for
from service import REPO, install
from test_gpio import Chip

LED, BUTTON = 7, 2


@pytest.fixture(scope="module", autouse=True)
def _installed():
    """The command is the repository's; shutting down is a target that ends nothing."""
    install()
    command = Path("/usr/local/bin/lightprobe")
    command.write_text(f'#!/bin/sh\nexec {REPO}/build/venv/bin/python -P -m lightprobe "$@"\n')
    command.chmod(0o755)
    # The repository's Python may lie in a home, which the installed one does not.
    drop_in = Path("/etc/systemd/system/lightprobe-panel.service.d/home.conf")
    drop_in.parent.mkdir(parents=True, exist_ok=True)
    drop_in.write_text("[Service]\nProtectHome=no\n")
    Path("/etc/systemd/system/poweroff.target").write_text("[Unit]\nDescription=as if off\n")
    run("systemctl", "daemon-reload")


def said() -> str:
    return run("journalctl", "--unit=lightprobe-panel", "--output=cat", "--no-pager")


def test_the_panel_lights_the_led_and_shuts_down():
    chip = Chip("panel", {LED: "GPIO27", BUTTON: "GPIO22"})
    chip.pull(BUTTON, "up")
    run("systemctl", "start", "lightprobe-panel")
    try:
        wait_for("the LED", lambda: chip.value(LED) == "1")
        wait_for("its word", lambda: "panel: starting" in said())
        chip.pull(BUTTON, "down")
        # The LED of the zone in which letting go shuts down: fast, after seven seconds.
        run("sleep", "8")
        chip.pull(BUTTON, "up")
        wait_for(
            "the shutdown",
            lambda: run("systemctl", "is-active", "poweroff.target", check=False) == "active\n",
        )
        wait_for("its word", lambda: "panel: stopping: shut down" in said())
    finally:
        print(said())
    run("systemctl", "stop", "lightprobe-panel")
    assert chip.value(LED) == "0"
