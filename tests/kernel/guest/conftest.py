# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the tests that run inside the guest (see README.md of tests/kernel)."""

import os
import signal
from pathlib import Path

import pytest

TEST_LIMIT_S = 600

if "LP_GUEST" not in os.environ:
    # These files are for the guest's kernel: `make test-kernel` runs them there.
    collect_ignore_glob = ["test_*.py"]


@pytest.fixture(autouse=True)
def _time_limit(request):
    """End a test that hangs; a longer limit by `@pytest.mark.limit_s(n)`."""
    marker = request.node.get_closest_marker("limit_s")
    limit_s = marker.args[0] if marker else TEST_LIMIT_S

    def give_up(signum, frame):
        raise TimeoutError(f"no end after {limit_s} s")

    signal.signal(signal.SIGALRM, give_up)
    signal.alarm(limit_s)
    yield
    signal.alarm(0)


# What only some groups need is imported by what needs it: importing takes seconds here.


@pytest.fixture
def make_camera(request):
    """Make a camera that is closed after the test: make_camera(**options)."""
    from camera import Camera

    def make(**options: object) -> Camera:
        camera = Camera(**options)
        request.addfinalizer(camera.close)
        return camera

    return make


@pytest.fixture
def camera(make_camera):
    """A camera, unplugged."""
    return make_camera()


@pytest.fixture
def start(request):
    """Start a daemon that is stopped after the test: start(source, *options)."""
    from daemon import Daemon

    def begin(source: str, *options: str, **more) -> Daemon:
        daemon = Daemon(source, *options, **more)
        request.addfinalizer(daemon.stop)
        return daemon

    return begin


@pytest.fixture(scope="session")
def simulator():
    """Socket of a simulator in this guest; it serves one camera after the other."""
    from room import simulate

    link = Path("/run/sim.sock")
    with simulate(link) as process:
        yield link
        process.kill()


@pytest.fixture(scope="module")
def vcan():
    """Name of a virtual CAN interface that is up."""
    from machine import modprobe, run

    modprobe("vcan")
    modprobe("can-raw")
    run("ip", "link", "add", "dev", "vcan0", "type", "vcan")
    run("ip", "link", "set", "up", "vcan0")
    return "vcan0"


@pytest.fixture(scope="module")
def kvaser():
    """Names of two interfaces on one bus at 500 kbit/s."""
    from machine import modprobe, run, wait_for

    modprobe("can-raw")
    modprobe("kvaser_pci")
    for name in ("can0", "can1"):
        wait_for(name, lambda name=name: name in run("ip", "-br", "link"))
        run("ip", "link", "set", name, "type", "can", "bitrate", "500000", "restart-ms", "100")
        run("ip", "link", "set", name, "up")
    return "can0", "can1"


def pytest_runtest_logreport(report):
    """Show a failure at once: a guest that hangs later never comes to the summary."""
    if report.failed:
        print(f"\n{report.longreprtext}", flush=True)


def pytest_configure(config):
    """Declare the markers used here."""
    config.addinivalue_line("markers", "limit_s(seconds): a time limit other than the usual")
    config.addinivalue_line("markers", "nightly: only `make test-nightly-kernel` runs it")
