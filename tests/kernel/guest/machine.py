# SPDX-License-Identifier: Apache-2.0
"""What every group of guest tests needs: run a program, load a driver, wait for something."""

import subprocess
import time
from collections.abc import Callable
from typing import TypeVar

Value = TypeVar("Value")


def run(*command: str, timeout_s: float = 120, check: bool = True) -> str:
    """Run a program and return what it printed (both streams); CalledProcessError on failure."""
    done = subprocess.run(
        command, timeout=timeout_s, check=False, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    if check and done.returncode:
        raise AssertionError(f"{' '.join(command)}: status {done.returncode}\n{done.stdout}")
    return done.stdout


def modprobe(module: str, *parameters: str) -> None:
    """Load a driver; one that is already there stays as it is."""
    run("modprobe", module, *parameters)


def wait_for(what: str, condition: Callable[[], Value], timeout_s: float = 120) -> Value:
    """Poll until `condition` is truthy and return it; AssertionError names `what` otherwise."""
    end = time.monotonic() + timeout_s
    while not (value := condition()):
        if time.monotonic() > end:
            raise AssertionError(f"{what}: not seen in {timeout_s} s")
        time.sleep(0.02)
    return value
