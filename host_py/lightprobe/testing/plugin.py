"""The pytest plug-in: `pytest_plugins = ["lightprobe.testing.plugin"]` in conftest.py brings it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace

import pytest

from lightprobe.testing.box import RealBox, SimulatedBox
from lightprobe.testing.camera import Camera
from lightprobe.testing.faults import FAULTS
from lightprobe.testing.options import Options
from lightprobe.testing.probe import Probe, make_box
from lightprobe.testing.room import Room

_PROBE = pytest.StashKey[Probe]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --lightprobe-port and --lightprobe-real-time."""
    group = parser.getgroup("lightprobe")
    group.addoption(
        "--lightprobe-port",
        metavar="DEVICE",
        help="Run the tests with a real box on this serial port, such as /dev/ttyUSB0, in real "
        "time. Tests that break the box are skipped.",
    )
    group.addoption(
        "--lightprobe-real-time",
        action="store_true",
        help="Let the probe's time be this machine's.",
    )
    group.addoption(
        "--lightprobe-fault",
        metavar="NAME",
        choices=sorted(FAULTS),
        help="Let every test begin with this fault, to see which ones notice: a name of "
        "lightprobe.testing.FAULTS.",
    )


@pytest.fixture
def probe_options() -> Options:
    """What the other fixtures are made of; override it in a module, a class or conftest.py."""
    return Options()


@pytest.fixture
def _options(probe_options: Options, pytestconfig: pytest.Config) -> Options:
    """Those of the test and of the command line."""
    port = pytestconfig.getoption("--lightprobe-port")
    real_time = pytestconfig.getoption("--lightprobe-real-time") or bool(port)
    return replace(probe_options, real_time=True) if real_time else probe_options


@pytest.fixture
def room(_options: Options) -> Room:
    """The light around the probe; see :class:`lightprobe.testing.Room`."""
    return Room(_options.ambient, _options.behaviour)


@pytest.fixture
def camera(room: Room, _options: Options) -> Camera:
    """A simulated camera in the room; see :class:`lightprobe.testing.Camera`."""
    return Camera(room, _options)


@pytest.fixture
def box(_options: Options, pytestconfig: pytest.Config) -> Iterator[SimulatedBox | RealBox | None]:
    """The microcontroller with wheel and ring; None with Options(box=False)."""
    made = make_box(_options, pytestconfig.getoption("--lightprobe-port"))
    with made if isinstance(made, SimulatedBox) else nullcontext():
        yield made


@pytest.fixture
def probe(
    request: pytest.FixtureRequest,
    room: Room,
    camera: Camera,
    box: SimulatedBox | RealBox | None,
    _options: Options,
) -> Iterator[Probe]:
    """A daemon with camera and box, and a connected client; see :class:`Probe`."""
    with Probe(room, camera, box, _options) as running:
        request.node.stash[_PROBE] = running
        planted = request.config.getoption("--lightprobe-fault")
        if planted:
            running.fault(planted)
        yield running


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]):  # type: ignore[no-untyped-def]
    """Put the daemon's log under the report of a test that failed."""
    report = yield
    probe = item.stash.get(_PROBE, None)
    if report.when == "call" and report.failed and probe is not None:
        report.sections.append((f"lightprobed, at {probe.t_s:.2f} s", probe.log))
    return report
