"""A probe as a whole, for end-to-end tests: simulator and daemon."""

import contextlib
import subprocess
import sys
from pathlib import Path

import pytest
from lightprobe import daemon

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"


#: The scenes' smallest lamps clip at 100 µs: these tests want all of the light.
SHORT_EXPOSURES = ("--exposure-min-us", "1", "--exposure-step-us", "0")


@contextlib.contextmanager
def running_probe(folder, *simulate, faults="", daemon_options=()):
    """A simulator and a daemon; yields the address of the daemon."""
    camera, uri = folder / "sim.sock", f"unix:{folder / 'probe.sock'}"
    command = [LIGHTPROBE, "simulate", "--socket", camera, "--size", "960x480", "--scenes",
               "procedural:3", "--act-s", "0", *SHORT_EXPOSURES, *simulate]  # fmt: skip
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    simulator = subprocess.Popen(command, start_new_session=True, **quiet)
    source = f"--source=sim:{camera}{'?' + faults if faults else ''}"
    try:
        with daemon.Daemon(
            [source, f"--publish={uri}", *daemon_options], folder / "log"
        ) as running:
            yield uri
            running.check()
        assert "Sanitizer" not in (folder / "log").read_text()
    finally:
        simulator.terminate()
        simulator.wait(30)


@pytest.fixture(scope="session")
def probe():
    """Give what starts a probe: `with probe(folder, simulate options…) as uri`."""
    return running_probe
