"""How much light of a world falls on each sensor of the ring."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry
from lightprobe.calibrate import ring
from lightprobe.colour import luminance
from lightprobe.geometry import Array
from lightprobe.sim.scene import Layer, Scene
from lightprobe.sim.world import State, World

#: Map that illuminance is summed over; lamps keep their flux in it.
_MAP_PX = (512, 256)
#: Turning scenes: sensors around the equator look up their place at this many azimuths. A lamp at
#: a sensor's horizon is a kink there: the error is a quarter of a step, in radians, of its light.
_AZIMUTHS = 240
_BLOCK = 8192


class RingLight:
    """Illuminance on the ring, linear in the lamps' powers; tables are made once per scene."""

    def __init__(self, world: World, cd_m2_per_unit: float) -> None:
        """`cd_m2_per_unit`: luminance of radiance 1."""
        self._scale = cd_m2_per_unit
        self._tables = [_table(scene) for scene in world.scenes]

    def lux(self, state: State) -> Array:
        """Nine illuminances."""
        powers = np.concatenate([[1.0], state.powers])
        around, up = np.split(powers @ self._tables[state.act], [_AZIMUTHS])
        # The scene turns to the right: as if the sensors turned to the left, clockwise from above.
        azimuth_deg = 45.0 * np.arange(8) - state.yaw_deg
        step = 360 / _AZIMUTHS
        equator = np.interp(azimuth_deg, step * np.arange(_AZIMUTHS), around, period=360)
        return self._scale * np.concatenate([equator, up])


def on_ring(scene: Scene) -> Array:
    """∫ luminance · cos on each sensor, (9,), all lamps at full power: exact, from the truth."""
    truth = scene.truth(np.ones(len(scene.lamps)))
    return np.asarray(luminance(truth.irradiance(ring.directions())), dtype=np.float64)


def _table(scene: Scene) -> Array:
    """Illuminance of base and lamps (1 + lamps, azimuths + 1), the last one from above."""
    layers = scene.render(*_MAP_PX)
    azimuth = 2 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    around = np.stack([np.cos(azimuth), np.zeros(_AZIMUTHS), np.sin(azimuth)], axis=-1)
    normals = np.vstack([around, ring.directions()[8]])
    base = Layer(slice(None), layers.base.reshape(-1, 3))
    return np.stack([_irradiance(layer, normals) for layer in (base, *layers.lamps)])


def _irradiance(layer: Layer, normals: Array) -> NDArray[np.float64]:
    """∫ luminance · cos over a layer's pixels, for each normal."""
    directions = geometry.equirect_directions(*_MAP_PX).reshape(-1, 3)[layer.index]
    solid_angle = np.repeat(geometry.equirect_solid_angles(*_MAP_PX), _MAP_PX[0])[layer.index]
    weight = luminance(layer.values.astype(np.float64)) * solid_angle
    total = np.zeros(len(normals))
    for start in range(0, len(weight), _BLOCK):
        part = slice(start, start + _BLOCK)
        total += np.maximum(normals @ directions[part].T, 0) @ weight[part]
    return total
