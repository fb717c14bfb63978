"""How much light of a world falls on each sensor of the ring."""

from __future__ import annotations

from collections.abc import Callable, Hashable

import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry
from lightprobe.calibrate import ring
from lightprobe.colour import luminance
from lightprobe.geometry import Array
from lightprobe.sim import ldr
from lightprobe.sim.ldr import Ldrs
from lightprobe.sim.moved import change
from lightprobe.sim.scene import Layer, Scene
from lightprobe.sim.world import Behaviour, State, World

#: Map that illuminance is summed over; lamps keep their flux in it.
_MAP_PX = (512, 256)
#: Turning scenes: sensors look up their place at this many azimuths. A lamp at a sensor's horizon
#: is a kink there: the error is a quarter of a step, in radians, of its light.
_AZIMUTHS = 240
#: While the probe tilts: and between so many degrees of elevation.
_ELEVATION_STEP_DEG = 2.0
#: Of the map: pixels are taken together in squares of so many.
_BLOCK_PX = 4

Response = Callable[[Array], Array]


class RingLight:
    """Illuminance on the ring, linear in the lamps' powers; tables are made once per scene."""

    def __init__(self, world: World, cd_m2_per_unit: float, ldrs: Ldrs | None = None) -> None:
        """`cd_m2_per_unit`: luminance of radiance 1. `ldrs`: as they are built; None: perfectly."""
        self._scale = cd_m2_per_unit
        self._directions = ring.directions() if ldrs is None else ldrs.directions()
        response = self._response = perfect if ldrs is None else ldr.response
        self._elevations = _elevations_deg(self._directions, _tilt_deg(world.behaviour))
        self._tables = [_table(scene, self._elevations, response) for scene in world.scenes]
        self._last: tuple[Hashable, Array] | None = None

    def lux(self, state: State) -> Array:
        """Nine illuminances; the last ones are kept, as long as nothing changes."""
        key = (state.act, state.powers.tobytes(), state.rotation.tobytes(), state.movers)
        if self._last is None or self._last[0] != key:
            self._last = (key, self._lux(state))
        return self._last[1].copy()

    def _lux(self, state: State) -> Array:
        powers = np.concatenate([[1.0], state.powers])
        table = np.tensordot(powers, self._tables[state.act], 1)
        azimuth, elevation = _angles_deg(geometry.rotate(state.rotation, self._directions))
        around = np.array([
            np.interp(azimuth, 360 / _AZIMUTHS * np.arange(_AZIMUTHS), row, period=360)
            for row in table
        ])  # fmt: skip
        nine = [np.interp(elevation[k], self._elevations, around[:, k]) for k in range(9)]
        return self._scale * (np.array(nine) + self._moved(state, state.rotation))

    def _moved(self, state: State, to_scene: Array) -> Array:
        """What people and things that move add to each sensor, in the tables' unit."""
        if not state.movers:
            return np.zeros(len(self._directions))
        more = change(state.movers, state.scene, state.powers)
        cosine = geometry.rotate(to_scene, self._directions) @ more.directions.T
        return np.asarray(self._response(cosine) @ luminance(more.light))


def on_ring(scene: Scene) -> Array:
    """∫ luminance · cos on each sensor, (9,), all lamps at full power: exact, from the truth."""
    truth = scene.truth(np.ones(len(scene.lamps)))
    return np.asarray(luminance(truth.irradiance(ring.directions())), dtype=np.float64)


def on_ldrs(scene: Scene, ldrs: Ldrs) -> Array:
    """What counts for each sensor of a real ring, (9,), all lamps at full power."""
    return np.asarray(sum(_layers(scene, ldrs.directions(), ldr.response)))


def perfect(cosine: Array) -> Array:
    """Give what counts for a sensor whose light counts by the cosine."""
    return np.maximum(cosine, 0)


def _angles_deg(directions: Array) -> tuple[Array, Array]:
    """Azimuth from +X to +Z, and elevation, of directions (N, 3)."""
    x, y, z = directions.T
    return np.degrees(np.arctan2(z, x)), np.degrees(np.arcsin(np.clip(y, -1, 1)))


def _tilt_deg(behaviour: Behaviour) -> float:
    """Most by which the probe's up leaves the vertical."""
    if behaviour.path is None:
        return behaviour.nod_deg + behaviour.roll_deg
    if behaviour.is_level:
        return 0.0
    ups = geometry.rotation_matrix(behaviour.path.rotations)[:, 1, 1]
    return float(np.degrees(np.arccos(np.clip(ups.min(), -1, 1))))


def _elevations_deg(directions: Array, tilt_deg: float) -> Array:
    """Elevations that the table needs: those of the sensors, or all that tilting takes them to."""
    own = np.unique(np.round(_angles_deg(directions)[1], 6))
    if not tilt_deg:
        return own
    all_of_them = np.linspace(-90, 90, round(180 / _ELEVATION_STEP_DEG) + 1)
    reach = tilt_deg + _ELEVATION_STEP_DEG
    reached = np.abs(all_of_them[:, None] - own).min(axis=1) <= reach
    return np.asarray(all_of_them[reached])


def _table(scene: Scene, elevations_deg: Array, response: Response) -> Array:
    """Illuminance of base and lamps (1 + lamps, elevations, azimuths)."""
    rows = []
    for elevation in np.radians(elevations_deg):
        count = _AZIMUTHS if np.cos(elevation) > 1e-9 else 1
        azimuth = 2 * np.pi * np.arange(count) / count
        around = np.stack([np.cos(azimuth), np.zeros(count), np.sin(azimuth)], axis=-1)
        normals = np.cos(elevation) * around + np.sin(elevation) * np.array([0.0, 1.0, 0.0])
        parts = np.array(_layers(scene, normals, response))
        rows.append(np.broadcast_to(parts, (len(parts), _AZIMUTHS)))
    return np.stack(rows, axis=1)


def _layers(scene: Scene, normals: Array, response: Response) -> list[Array]:
    """Illuminance of the base and of each lamp, for each normal."""
    layers = scene.render(*_MAP_PX)
    base = Layer(slice(None), layers.base.reshape(-1, 3))
    return [_irradiance(layer, normals, response) for layer in (base, *layers.lamps)]


def _irradiance(layer: Layer, normals: Array, response: Response) -> NDArray[np.float64]:
    """∫ luminance · response over a layer's pixels, for each normal."""
    directions, weight = _blocks(layer)
    return np.array([float(weight @ response(directions @ normal)) for normal in normals])


def _blocks(layer: Layer) -> tuple[Array, Array]:
    """Directions (N, 3) and luminance times solid angle (N,) of blocks of a layer's pixels.

    A block's direction is the mean of its light: what it casts is exact, but where a sensor's
    horizon goes through it.
    """
    width_px, height_px = _MAP_PX
    rows, columns = np.divmod(np.arange(width_px * height_px), width_px)
    block = (rows // _BLOCK_PX * (width_px // _BLOCK_PX) + columns // _BLOCK_PX)[layer.index]
    solid_angle = np.repeat(geometry.equirect_solid_angles(*_MAP_PX), width_px)[layer.index]
    weight = luminance(layer.values.astype(np.float64)) * solid_angle
    directions = geometry.equirect_directions(*_MAP_PX).reshape(-1, 3)[layer.index]
    light = np.stack([np.bincount(block, weight * axis) for axis in directions.T], axis=-1)
    length = np.linalg.norm(light, axis=1)
    lit = length > 0
    return light[lit] / length[lit, None], length[lit]
