"""From a light sensor's pin to a sample in the daemon, in the microcontroller's own time.

The flashed binary runs in simavr in lock-step: its time passes only when told to, so how busy this
machine is does not count.
"""

import contextlib
import os
import sys
import tty
from pathlib import Path

import pytest
from harness import LONG_S, Daemon, camera, wait_for

sys.path.append(str(Path(__file__).parents[1] / "firmware"))

from rig import Rig

LIMIT_US = 15_000
FIRST_US, STEP_US = 10_000, 250  # no sample is earlier: one is a mean over 10 ms
SENSORS = 9
DIVIDER_OHM, R10_OHM, GAMMA = 3300.0, 14000.0, 0.7  # without calibration
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
    return [1 / (1 + r / DIVIDER_OHM) for r in ohm]


def millivolts(step: int) -> list[int]:
    return [600 + 400 * k + 150 * step for k in range(SENSORS)]


@pytest.fixture
def line():
    with Rig() as rig:
        line = Line(rig)
        yield line
        line.close()


def test_a_step_of_light_arrives_within_15_ms(line):
    with camera() as cam:
        options = [f"--ring=mcu:serial:{os.ttyname(line.slave)}"]
        with (
            Daemon(f"--source=sim:{cam.path}", *options) as daemon,
            daemon.client(health_period_ms=1) as client,
        ):

            def health_now():
                """One that was written after all that has been carried."""
                before = client.next("health").uptime_ms
                return client.until(lambda h: h.uptime_ms > before + 30, "health")

            def as_set(step: int) -> bool:
                health = health_now()
                wanted = [mv / 5000 for mv in millivolts(step)]
                pairs = zip(shares(health), wanted, strict=True)
                return all(abs(got - want) <= ADC_LSB for got, want in pairs)

            def greeted() -> bool:
                line.run(20_000)
                return bool(client.next("health").ring.samples)

            wait_for(greeted, "the daemon has no sample", LONG_S)
            for step in (1, 2, 3):
                line.run(3_000 + 700 * step)  # at any phase of the averaging
                for k, mv in enumerate(millivolts(step)):
                    line.rig.set(**{f"ldr{k}_mv": mv})
                passed_us = FIRST_US
                line.run(FIRST_US)
                assert not as_set(step)
                while not as_set(step):
                    line.run(STEP_US)
                    passed_us += STEP_US
                    assert passed_us <= LIMIT_US, shares(health_now())
                print(f"step {step}: in the daemon after {passed_us / 1000} ms")
