"""The light around the probe, which a test changes while time goes on."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from lightprobe import geometry
from lightprobe.calibrate import ring
from lightprobe.colour import luminance
from lightprobe.errors import UsageError
from lightprobe.geometry import Array
from lightprobe.lamp import Lamp
from lightprobe.sim.movers import Card
from lightprobe.sim.scene import Truth
from lightprobe.sim.textured import TexturedScene
from lightprobe.sim.world import Behaviour, ChangingWorld, State
from lightprobe.testing.options import CD_M2_PER_UNIT

Colour = Sequence[float]
WHITE = (1.0, 1.0, 1.0)
_LENS_CAP = Card(0.0, 0.0, 180.0)


@dataclass(eq=False)
class RoomLamp:
    """A lamp of the room, as :meth:`Room.lamp` made it. Set it by its methods."""

    room: Room
    azimuth_deg: float  # 0 ahead, positive to the right
    elevation_deg: float
    irradiance: float  # on a surface that faces it, luminance
    radius_deg: float
    colour: tuple[float, float, float]
    is_on: bool = True

    def move(self, azimuth_deg: float, elevation_deg: float) -> None:
        """Put it elsewhere, in degrees. UsageError for an impossible place; it stays then."""
        self._become(azimuth_deg=azimuth_deg, elevation_deg=elevation_deg)

    def switch(self, on: bool) -> None:
        """Switch it on or off."""
        self.is_on = on
        self.room.show()

    def dim(self, irradiance: float) -> None:
        """Make it as bright as this; see :meth:`Room.lamp`. UsageError below 0."""
        self._become(irradiance=irradiance)

    def _become(self, **numbers: float) -> None:
        changed = copy(self)
        for name, value in numbers.items():
            setattr(changed, name, value)
        changed.true()  # refuses what cannot be
        for name, value in numbers.items():
            setattr(self, name, value)
        self.room.show()

    def remove(self) -> None:
        """Take it out of the room."""
        self.room.lamps.remove(self)
        self.room.show()

    @property
    def direction(self) -> Array:
        """Unit vector (3,) towards it, in the room's frame."""
        return geometry.direction_from_angles(self.azimuth_deg, self.elevation_deg)

    def true(self) -> Lamp:
        """Give the lamp as truth states it. UsageError for numbers that no lamp can have."""
        numbers = (self.azimuth_deg, self.elevation_deg, self.irradiance, self.radius_deg)
        fine = np.isfinite(numbers).all() and abs(self.elevation_deg) <= 90
        if not (fine and self.irradiance >= 0 and 0.1 <= self.radius_deg <= 45):
            raise UsageError(
                f"room: lamp at {self.azimuth_deg:g}°, {self.elevation_deg:g}°, irradiance "
                f"{self.irradiance:g}, radius {self.radius_deg:g}°: expected finite angles, an "
                "elevation of −90…90°, an irradiance of 0 or more and a radius of 0.1…45°"
            )
        return Lamp(self.direction, self.radius_deg, self.irradiance * _tint(self.colour))


class Room:
    """A plain room with lamps. Changes show in the next exposure of the camera.

    Radiance has the unit of estimates: 1 is full scale of the camera at an exposure of one second,
    and 10 cd/m². Irradiance is its sum over directions, in the same unit.
    """

    def __init__(self, ambient: float = 30.0, behaviour: Behaviour | None = None) -> None:
        """`ambient`: radiance of walls, floor and ceiling, the mean of their patches."""
        self.lamps: list[RoomLamp] = []
        self._ambient, self._colour = ambient, WHITE
        self._lux: tuple[Hashable, Array] | None = None
        self.world = ChangingWorld(self._scene(), behaviour)

    def lamp(
        self,
        azimuth_deg: float,
        elevation_deg: float,
        irradiance: float = 100.0,
        radius_deg: float = 5.0,
        colour: Colour = WHITE,
    ) -> RoomLamp:
        """Add a lamp that is on, and give it.

        Azimuth 0 is ahead and positive to the right; elevation is up. `irradiance` is what it
        casts on a surface that faces it, luminance; the default is about as much as the room
        (94). A lamp of 5° radius with more than 190 clips without a film, one with half the radius
        at a quarter of that: the camera's shortest exposure is 100 µs. `colour` is linear RGB and
        counts by its ratios. UsageError for impossible numbers.
        """
        one = RoomLamp(self, azimuth_deg, elevation_deg, irradiance, radius_deg, _rgb(colour))
        one.true()
        self.lamps.append(one)
        self.show()
        return one

    def ambient(self, radiance: float, colour: Colour = WHITE) -> None:
        """Make the room itself as bright as this. UsageError below 0."""
        if not (np.isfinite(radiance) and radiance >= 0):
            raise UsageError(f"room: ambient {radiance:g}: expected a radiance of 0 or more")
        self._ambient, self._colour = radiance, _rgb(colour)
        self.show()

    def darken(self) -> None:
        """Switch everything off: lamps and the room itself."""
        self.lamps.clear()
        self.ambient(0.0)

    def cover_lens(self, covered: bool = True) -> None:
        """Put a cap on the camera's lens, or take it off. The ring still sees the light."""
        self.world.card = _LENS_CAP if covered else None

    def show(self) -> None:
        """Take over what was changed in :attr:`lamps`."""
        self.world.scene = self._scene()

    def truth(self) -> Truth:
        """Give the light that the probe should report, in the room's frame."""
        scene = self.world.scene
        return scene.truth(np.ones(len(scene.lamps)))

    def lux(self, state: State) -> Array:
        """Illuminance (9,) on the sensors of the ring in a state of the world, in lux."""
        key = (state.act, state.powers.tobytes(), state.rotation.tobytes())
        if self._lux is None or self._lux[0] != key:
            truth = state.scene.truth(state.powers, state.rotation)
            light = luminance(truth.irradiance(ring.directions()))
            self._lux = (key, np.asarray(CD_M2_PER_UNIT * light))
        return self._lux[1]

    def _scene(self) -> TexturedScene:
        lamps = tuple(one.true() for one in self.lamps if one.is_on and one.irradiance > 0)
        return TexturedScene("room", self._ambient * _tint(self._colour), lamps)


def _rgb(colour: Colour) -> tuple[float, float, float]:
    rgb = [float(one) for one in colour]
    if not (len(rgb) == 3 and np.isfinite(rgb).all() and min(rgb) >= 0 and max(rgb) > 0):
        raise UsageError(f"room: colour {tuple(colour)}: expected red, green, blue of 0 or more")
    return rgb[0], rgb[1], rgb[2]


def _tint(colour: Colour) -> Array:
    """Colour (3,) of luminance 1."""
    rgb = np.asarray(colour, dtype=np.float64)
    return np.asarray(rgb / luminance(rgb))
