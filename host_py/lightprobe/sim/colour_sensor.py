"""Nine colour sensors on a ring, as the VEML6040: what they read of the light that falls on them.

Photodiodes under filters are linear. Their colours overlap (the data sheet draws the curves; the
shares here are read off it by eye), each colour has a gain of its own that depends on the type, and
each sensor one of its own. They sit as crookedly as the LDRs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightprobe.calibrate import ring
from lightprobe.geometry import Array
from lightprobe.sim.scene import Scene

#: How much of linear red, green and blue (Rec. 709) each colour of the sensor sees; a white wall
#: is 1, 1, 1.
OVERLAP = np.array([[0.84, 0.14, 0.02], [0.10, 0.80, 0.10], [0.02, 0.18, 0.80]])
#: Relative 1 sigma: of a colour's gain by type, and of a sensor's against its type.
_TYPE_SIGMA, _SENSOR_SIGMA, _SEAT_SIGMA_DEG = 0.1, 0.02, 2.0


@dataclass(frozen=True, eq=False)
class ColourSensors:
    """Nine of them, calibrated as to how bright they see a white light."""

    gain: Array  # (9, 3)
    seats_deg: Array  # (9, 2)

    @classmethod
    def draw(cls, rng: np.random.Generator) -> ColourSensors:
        """Take nine from a reel."""
        by_type = np.exp(_TYPE_SIGMA * rng.standard_normal(3))
        by_sensor = np.exp(_SENSOR_SIGMA * rng.standard_normal((ring.SENSORS, 1)))
        seats = _SEAT_SIGMA_DEG * rng.standard_normal((ring.SENSORS, 2))
        return cls(by_type * by_sensor, seats)

    def read(self, scene: Scene, noise: float, rng: np.random.Generator) -> Array:
        """Readings (9, 3) of a scene with all lamps at full power, per unit of radiance."""
        truth = scene.truth(np.ones(len(scene.lamps)))
        light = np.maximum(truth.irradiance(ring.directions(self.seats_deg)), 0)
        return np.asarray(light @ OVERLAP.T * self.gain * rng.normal(1, noise, (ring.SENSORS, 3)))
