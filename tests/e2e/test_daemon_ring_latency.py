"""From a light sensor's pin to a sample in the daemon, in the microcontroller's own time.

The flashed binary runs in simavr in lock-step, and the daemon in simulated time: both go on only
when told to, so how busy this machine is does not count.
"""

import contextlib
import os
import sys
import time
import tty
from pathlib import Path

import pytest
from harness import Daemon
from lightprobe.sim.clock import SimulatedClock
from lightprobe.sim.live import LiveClient
from lightprobe.wire import Subscription

sys.path.append(str(Path(__file__).parents[1] / "firmware"))

from rig import Rig

LIMIT_US = 22_000  # the window of 10 ms that the step falls into, the next one, and the way
EARLY_US = 10_000  # no sample is earlier: one is a mean over 10 ms
SENSORS = 9
DIVIDER_OHM, SERIES_OHM, R10_OHM, GAMMA = 3300.0, 85.0, 14000.0, 0.7  # without calibration
ADC_LSB = 1 / 1023


class Line:
    """The serial line between a microcontroller in lock-step and the daemon."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)

    def run(self, us: int) -> None:
        """Carry what waits, let the microcontroller's time pass, carry what it has said."""
        with contextlib.suppress(BlockingIOError):
            self.rig.send_bytes(os.read(self.master, 4096))
        self.rig.command(f"run {us}")
        for _ in range(int(self.rig.command("frames"))):
            frame = bytes.fromhex(self.rig.process.stdout.readline().split()[3])
            with contextlib.suppress(BlockingIOError):
                os.write(self.master, frame)

    def close(self) -> None:
        os.close(self.master)
        os.close(self.slave)


def shares(health) -> list[float]:
    """What the sensors' pins read, as shares of the supply, back from the illuminance."""
    ohm = [R10_OHM * (lux / 10) ** -GAMMA for lux in health.ring.illuminance_lux]
    return [1 / (1 + (r + SERIES_OHM) / DIVIDER_OHM) for r in ohm]


def millivolts(step: int) -> list[int]:
    return [600 + 400 * k + 150 * step for k in range(SENSORS)]


@pytest.fixture
def line():
    with Rig() as rig:
        rig.exact_adc()
        line = Line(rig)
        yield line
        line.close()


def test_a_step_of_light_arrives_within_22_ms(line, tmp_path):
    clock = SimulatedClock(tmp_path / "time")
    options = [f"--ring=mcu:serial:{os.ttyname(line.slave)}"]
    options += ["--source=sim:/nowhere", f"--simulated-time={tmp_path / 'time'}"]
    with Daemon(*options) as daemon:
        clock.advance(clock.now_ns())
        client = LiveClient(daemon.socket, Subscription(health_period_ms=100))

        def run(us: int) -> None:
            """Both go on, and what has been said until then has arrived."""
            for _ in range(us // 500):
                line.run(500)
                clock.advance(clock.now_ns() + 500_000)

        def health_now():
            """What the daemon knows now: a report comes ten times a second of its time."""
            clock.advance(clock.now_ns() + 200_000_000)
            client.read(0)
            return client.health

        def as_set(step: int) -> bool:
            wanted = [mv / 5000 for mv in millivolts(step)]
            pairs = zip(shares(health_now()), wanted, strict=True)
            return all(abs(got - want) <= ADC_LSB for got, want in pairs)

        for _ in range(100):
            run(100_000)
            if health_now().ring.samples:
                break
        for step in (1, 2, 3):
            run(3_000 + 500 * step)  # at any phase of the averaging
            for k, mv in enumerate(millivolts(step)):
                line.rig.set(**{f"ldr{k}_mv": mv})
            run(EARLY_US)
            assert not as_set(step)
            run(LIMIT_US - EARLY_US)
            # the kernel hands a pty's bytes on in its own time, while the chip's stands still
            assert any(as_set(step) or time.sleep(0.02) for _ in range(100)), shares(health_now())
        client.close()
    clock.close()
