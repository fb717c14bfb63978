# SPDX-License-Identifier: Apache-2.0
"""A gyroscope through the kernel's HID sensor driver and IIO, and the daemon's driver of it."""

import subprocess
import time
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import pytest
from imu import Imu
from machine import modprobe, wait_for

from daemon import BUILD

DEVICES = Path("/sys/bus/iio/devices")
KERNEL = BUILD.parent / "kernel"
SAMPLES = KERNEL / "bin" / "gyro_samples"


@pytest.fixture(scope="module", autouse=True)
def _drivers():
    for module in ("uhid", "hid-sensor-hub", "hid-sensor-gyro-3d"):
        modprobe(module)


class Motion:
    """What the gyroscope tells now, in degrees per second."""

    def __init__(self) -> None:
        self.rates = (0.0, 0.0, 0.0)

    def __call__(self, t_s: float) -> tuple[float, float, float]:
        return self.rates


@pytest.fixture
def motion():
    return Motion()


@pytest.fixture
def imu(request, motion):
    """Plug a gyroscope in; what is plugged in is unplugged after the test."""
    plugged: list[Imu] = []

    def plug() -> Imu:
        plugged.append(Imu(motion))
        wait_for("the gyroscope", lambda: any(DEVICES.glob("iio:device*/in_anglvel_scale")))
        return plugged[-1]

    yield plug
    for one in plugged:
        with suppress(OSError):
            one.unplug()


class Samples:
    """Lines of gyro_samples, as they come."""

    def __init__(self, uri: str, folder: Path) -> None:
        self._out, self._log = folder / "samples", folder / "log"
        with self._out.open("w") as out, self._log.open("w") as log:
            self._process = subprocess.Popen([SAMPLES, uri], stdout=out, stderr=log)

    @property
    def log(self) -> str:
        return self._log.read_text()

    def lines(self) -> list[list[float]]:
        """Time in s, three rates and sigma in degrees per second."""
        whole = self._out.read_text().split("\n")[:-1]
        return [[float(n) * (1e-9 if k == 0 else 1) for k, n in enumerate(line.split())]
                for line in whole]  # fmt: skip

    def close(self) -> None:
        self._process.terminate()
        assert self._process.wait(60) == 0


@pytest.fixture
def samples(request, tmp_path):
    def start(uri: str = "iio:") -> Samples:
        read = Samples(uri, tmp_path)
        request.addfinalizer(read.close)
        return read

    return start


def near(rates: list[float], wanted: tuple[float, float, float], by: float = 0.05) -> bool:
    return all(abs(a - b) < by for a, b in zip(rates, wanted, strict=True))


def test_rates_axes_and_times(imu, motion, samples, record_property):
    device = imu()
    motion.rates = (30.0, -20.0, 10.5)
    read = samples()
    wait_for("samples", lambda: len(read.lines()) > 50)
    for line in read.lines():
        assert near(line[1:4], (30.0, -20.0, 10.5)), line
        assert line[4] == pytest.approx(3.0), "an offset that is not known yet"
    times = [line[0] for line in read.lines()]
    assert all(a < b for a, b in pairwise(times))
    assert abs(times[-1] - time.monotonic()) < 60, "CLOCK_MONOTONIC"
    assert device.interval_ms == 5, "200 samples a second were asked for"
    steps = sorted(b - a for a, b in pairwise(times))
    record_property("figure", f"gyroscope: a sample every {1000 * steps[len(steps) // 2]:.1f} ms")


def test_the_offset_is_found_at_rest(imu, motion, samples):
    imu()
    motion.rates = (0.8, -0.4, 1.2)
    read = samples("iio:gyro_3d?rate_hz=100")
    wait_for("rest", lambda: read.lines() and read.lines()[-1][4] < 1)
    assert near(read.lines()[-1][1:4], (0.0, 0.0, 0.0))
    motion.rates = (20.8, -0.4, 1.2)
    wait_for("a turn", lambda: read.lines()[-1][1] > 10)
    assert near(read.lines()[-1][1:4], (20.0, 0.0, 0.0))


def test_it_is_waited_for_and_may_go_and_come_again(imu, samples):
    read = samples()
    wait_for("a word", lambda: "is the gyroscope connected" in read.log)
    first = imu()
    wait_for("samples", lambda: len(read.lines()) > 10)
    first.unplug()
    wait_for("a word", lambda: "has it been unplugged" in read.log)
    count = len(read.lines())
    imu()
    wait_for("samples again", lambda: len(read.lines()) > count + 10)
    assert read.log.count("is the gyroscope connected") <= 2, "said once, not at every try"


def test_the_wrong_name(imu, samples):
    imu()
    read = samples("iio:accel_3d")
    wait_for("a word", lambda: "is the gyroscope connected" in read.log)
    assert not read.lines()


def test_the_daemon_says_when_its_gyroscope_goes(imu, start):
    device = imu()
    picture = next((KERNEL / "pictures").glob("640x320_*.jpg"))
    daemon = start(f"file:{picture}?rate=10", "--orientation=iio:")

    def told(health) -> bool:
        return any(fault.id == "orientation-silent" for fault in health.faults)

    daemon.wait_health("the sensor", lambda health: health.estimates and not told(health))
    device.unplug()
    daemon.wait_health("the fault", told)
    imu()
    daemon.wait_health("the sensor again", lambda health: not told(health))
    assert "is over" in daemon.stop()
