"""The ring of light sensors in a simulated world: the firmware in lock-step with its time."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Self

import numpy as np

from lightprobe.calibrate import ring
from lightprobe.geometry import Array
from lightprobe.sim.box import Box
from lightprobe.sim.clock import START_NS

#: How often light reaches the sensors, and their readings the line.
PERIOD_US = 2000
#: A ring as exact as calibration and temperature let it be: relative 1 sigma of each sensor.
CALIBRATED = 0.03


class LiveRing:
    """The microcontroller's box beside a :class:`lightprobe.sim.live.LiveProbe`.

    with LiveRing() as box, LiveProbe(camera, box.daemon_arguments(5.0)) as probe:
        box.shine(lambda: light.lux(probe.link.state_now()))
        probe.apps.append(box)
        probe.run(3.0)
    """

    def __init__(self, firmware: str = "host", seed: int = 0, sigma: float = CALIBRATED) -> None:
        """`sigma`: error of each sensor's calibration, relative, drawn from the seed."""
        self._folder = tempfile.TemporaryDirectory(prefix="lp-ring-")
        folder = Path(self._folder.name)
        self.line, self._file = folder / "mcu", folder / "ring.ini"
        self.box = Box(firmware, self.line, seed, lock_step=True)
        known = ring.Ring(sigma=np.full(ring.SENSORS, sigma), drift_sigma=0.0,
            gamma_sigma=np.full(ring.SENSORS, 0.004),
            series_sigma_ohm=np.full(ring.SENSORS, 8.0))  # fmt: skip
        self._file.write_text(known.text())
        error = np.random.default_rng([seed, 17]).normal(0, sigma, ring.SENSORS)
        true_ohm = known.r10_ohm * np.exp(error * known.gamma)
        self.box.set(adc_offset_lsb=0, **{f"ldr{k}_r10_ohm": true_ohm[k] for k in range(9)},
            **{f"ldr{k}_mux_ohm": known.series_ohm[k] for k in range(9)})  # fmt: skip
        self._lux_now: Callable[[], Array] = lambda: np.zeros(ring.SENSORS)
        self._due_ns = START_NS

    def __enter__(self) -> Self:
        """Give itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the firmware."""
        self.box.__exit__()
        self._folder.cleanup()

    def daemon_arguments(self, cd_m2_per_unit: float | None, sigma: float = 0.02) -> list[str]:
        """Options for lightprobed; `sigma`: relative, of the scale; None: the ring finds it."""
        arguments = [f"--ring=mcu:serial:{self.line}?calibration={self._file}"]
        if cd_m2_per_unit is not None:
            arguments.append(f"--cd-m2-per-unit={cd_m2_per_unit}")
            arguments.append(f"--cd-m2-per-unit-sigma={sigma}")
        return arguments

    def shine(self, lux_now: Callable[[], Array]) -> None:
        """From now on nine illuminances fall on the sensors, asked for every PERIOD_US."""
        self._lux_now = lux_now

    def due_ns(self) -> int:
        """See :class:`lightprobe.sim.live.App`."""
        return self._due_ns

    def work(self) -> None:
        """See :class:`lightprobe.sim.live.App`."""
        self.box.shine(np.asarray(self._lux_now(), dtype=np.float64))
        self.box.run(PERIOD_US)
        self._due_ns += 1000 * PERIOD_US
