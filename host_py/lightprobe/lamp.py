"""A lamp as truth states it: a disc of uniform radiance, far away."""

from __future__ import annotations

from dataclasses import dataclass

from lightprobe import geometry
from lightprobe.geometry import Array


@dataclass(frozen=True, eq=False)
class Lamp:
    """A lamp at full power: what it adds to the background."""

    direction: Array  # (3,) unit vector towards it, probe frame
    radius_deg: float  # of the disc with the same solid angle
    irradiance: Array  # (3,) RGB, ∫ L dω of what it adds

    @property
    def radiance(self) -> Array:
        """Mean radiance (3,) that it adds."""
        return self.irradiance / float(geometry.cap_solid_angle_sr(self.radius_deg))

    def scaled(self, factor: float) -> Lamp:
        """Give the same lamp, brighter by a factor."""
        return Lamp(self.direction, self.radius_deg, factor * self.irradiance)
