"""A furnished box with round lamps in it: a procedural room that the eye can read.

Lamps are glowing spheres, so each is a disc from the probe and lights the walls by the inverse
square of its distance. A lamp's layer holds both: the disc, which is the lamp of the truth, and
what it makes of the walls, which is ambient light and goes when the lamp goes. Light that has
bounced more than once is one constant per lamp, from the walls' mean reflectance.

More pictures may hang on the walls, and cupboards may stand or hang anywhere: they hide lamps and
walls, are lit, and cast no shadows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.errors import UsageError
from lightprobe.geometry import Array
from lightprobe.lamp import Lamp
from lightprobe.sim.scene import Layer, Layers, MapTruth, disc_layer, lit_lamps

#: Size of the map that truth is summed over; twice as many pixels each way change it by 0.03 %.
_TRUTH_PX = (512, 256)
# Corners of the room in metres; the probe is at the origin unless it walks.
_LOW, _HIGH = np.array([-2.6, -1.3, -3.4]), np.array([2.2, 1.4, 2.6])
# Reflectance of the faces −x, +x, −y (floor), +y (ceiling), −z, +z.
_WALLS = np.array(
    [[.62, .60, .55], [.62, .60, .55], [.36, .24, .15], [.80, .80, .78], [.30, .42, .52],
     [.62, .60, .55]]
)  # fmt: skip
#: A window's worth of daylight, as radiance of every wall: what is left when all lamps are off.
_DAYLIGHT = np.array([0.010, 0.012, 0.016])
#: Cells along each side of a wall, whole numbers of which its pictures cover.
_CELLS = 48


@dataclass(frozen=True)
class Cupboard:
    """A box along the walls: two opposite corners (m from the room's middle), and its colour."""

    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]
    reflectance: tuple[float, float, float] = (0.25, 0.2, 0.15)


@dataclass(frozen=True)
class Bulb:
    """A glowing sphere: where it is (m from the probe), its radius, and its colour."""

    position_m: tuple[float, float, float]
    radius_m: float
    radiance: tuple[float, float, float]

    def seen_from(self, place_m: tuple[float, float, float]) -> Bulb:
        """Give the same bulb with the probe elsewhere."""
        x, y, z = np.subtract(self.position_m, place_m).tolist()
        return replace(self, position_m=(x, y, z))

    def lamp(self) -> Lamp:
        """Give what the probe sees of it: a disc of uniform radiance."""
        position = np.array(self.position_m)
        radius_deg = float(np.degrees(np.arcsin(self.radius_m / np.linalg.norm(position))))
        solid_angle = float(geometry.cap_solid_angle_sr(radius_deg))
        return Lamp(geometry.normalize(position), radius_deg, solid_angle * np.array(self.radiance))


_BULBS = (
    Bulb((-1.1, 0.85, -1.6), 0.10, (62.0, 50.0, 34.0)),  # hanging, warm
    Bulb((1.1, 0.9, 1.0), 0.13, (30.0, 32.0, 36.0)),  # hanging, cool
    Bulb((1.5, 0.1, -2.2), 0.16, (20.0, 11.0, 5.0)),  # standing, orange
    Bulb((-1.9, -0.2, 1.4), 0.08, (14.0, 30.0, 70.0)),  # small, blue
)


@dataclass(frozen=True)
class Room:
    """The room, with some of its bulbs, at some brightness; equal ones are rendered once."""

    name: str = "room"
    bulbs: tuple[Bulb, ...] = _BULBS
    brightness: float = 1.0
    place_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # where the probe is
    pictures: int = 0  # which coloured pictures hang on walls and lie on the floor; 0: none
    cupboards: tuple[Cupboard, ...] = ()
    shows_bulbs: bool = True  # False: they light the room, and are not seen

    @property
    def lamps(self) -> tuple[Lamp, ...]:
        """See :class:`lightprobe.sim.scene.Scene`; also those that a cupboard hides."""
        return tuple(bulb.lamp().scaled(self.brightness) for bulb in self._seen())

    def scaled(self, factor: float) -> Room:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return replace(self, brightness=factor * self.brightness)

    def contains(self, places_m: Array) -> NDArray[np.bool_]:
        """Tell which places (…, 3) are inside the walls, and in no cupboard."""
        free = np.all((places_m > _LOW) & (places_m < _HIGH), axis=-1)
        for one in self.cupboards:
            free &= ~np.all((places_m > one.low_m) & (places_m < one.high_m), axis=-1)
        return np.asarray(free)

    def seen_from(self, place_m: tuple[float, float, float]) -> Room:
        """Give the same room with the probe elsewhere; UsageError outside its walls."""
        if not self.contains(np.array(place_m)):
            raise UsageError(f"room: {place_m}: the probe would be outside its walls")
        return replace(self, place_m=place_m)

    def _seen(self) -> tuple[Bulb, ...]:
        """Bulbs as the probe sees them from its place."""
        return tuple(bulb.seen_from(self.place_m) for bulb in self.bulbs)

    def render(self, width_px: int, height_px: int) -> Layers:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return _rendered(self, width_px, height_px)

    def truth(self, powers: ArrayLike, rotation: ArrayLike = geometry.UNTURNED) -> MapTruth:
        """Sum over the map; lamps in closed form."""
        radiance = self.render(*_TRUTH_PX).compose(powers)
        return MapTruth(radiance, rotation, lit_lamps(self.lamps, powers, rotation))


@lru_cache(maxsize=4)
def _rendered(room: Room, width_px: int, height_px: int) -> Layers:
    directions = geometry.equirect_directions(width_px, height_px)
    point, normal, reflectance = _surfaces(room, directions)
    base = (room.brightness * _DAYLIGHT * reflectance / 0.5).astype(np.float32)
    far_m = np.linalg.norm(point, axis=-1).ravel() if room.cupboards else None
    layers = []
    for bulb, lamp in zip(room._seen(), room.lamps, strict=True):
        glow = room.brightness * reflectance / np.pi * _irradiance(bulb, point, normal)
        flat = glow.reshape(-1, 3).astype(np.float32)
        if room.shows_bulbs:
            disc = disc_layer(lamp, width_px, height_px)
            index, values = disc.index, disc.values
            if far_m is not None:
                before = far_m[index] > np.linalg.norm(bulb.position_m)
                index, values = np.asarray(index)[before], values[before]
            # The disc hides the wall behind it; at its rim, by the share that it covers.
            cover = values[:, 1] / np.float32(lamp.radiance[1])
            flat[index] += values - cover[:, None] * flat[index]
        layers.append(Layer(slice(None), flat))
    return Layers(base, tuple(layers))


def _surfaces(room: Room, directions: Array) -> tuple[Array, Array, Array]:
    """What rays from the probe meet: point, normal towards them, reflectance; (H, W, 3).

    Points are seen from the probe.
    """
    place_m = np.array(room.place_m)
    point, normal, reflectance = _walls(directions, place_m, room.pictures)
    for one in room.cupboards:
        safe = np.where(np.abs(directions) < 1e-12, 1e-12, directions)
        low, high = (np.array(corner) - place_m for corner in (one.low_m, one.high_m))
        enters = np.where(safe > 0, low, high) / safe
        reach = enters.max(axis=-1, keepdims=True)
        leaves = np.min(np.where(safe > 0, high, low) / safe, axis=-1, keepdims=True)
        nearer = reach < np.linalg.norm(point, axis=-1, keepdims=True)
        meets = nearer & (reach > 0) & (reach < leaves)
        face = np.where(enters == reach, -np.sign(safe), 0.0)
        point = np.where(meets, reach * safe, point)
        normal = np.where(meets, face, normal)
        reflectance = np.where(meets, np.array(one.reflectance), reflectance)
    return point, normal, reflectance


def _walls(directions: Array, place_m: Array, pictures: int = 0) -> tuple[Array, Array, Array]:
    """Where rays from the probe meet the walls: point, inward normal, reflectance; (H, W, 3).

    Points are seen from the probe, which is at `place_m`.
    """
    safe = np.where(np.abs(directions) < 1e-12, 1e-12, directions)
    reach = np.where(safe > 0, (_HIGH - place_m) / safe, (_LOW - place_m) / safe)
    axis = reach.argmin(axis=-1)
    point = safe * np.take_along_axis(reach, axis[..., None], -1)
    positive = np.take_along_axis(safe, axis[..., None], -1)[..., 0] > 0
    normal = np.zeros_like(safe)
    np.put_along_axis(normal, axis[..., None], np.where(positive, -1.0, 1.0)[..., None], -1)
    face = 2 * axis + positive
    reflectance = _WALLS[face] * _pattern(point + place_m, face)[..., None]
    if pictures:
        cell = ((point + place_m - _LOW) / (_HIGH - _LOW) * _CELLS).astype(np.intp)
        cell = np.clip(cell, 0, _CELLS - 1)
        along, up = np.array([2, 0, 0])[axis], np.array([1, 2, 1])[axis]
        u = np.take_along_axis(cell, along[..., None], -1)[..., 0]
        v = np.take_along_axis(cell, up[..., None], -1)[..., 0]
        colour = _pictures(pictures)[face, v, u]
        reflectance = np.where(colour > 0, colour, reflectance)
    return point, normal, reflectance


@lru_cache(maxsize=4)
def _pictures(seed: int) -> Array:
    """Reflectance (6, _CELLS, _CELLS, 3) of the pictures on each face; 0: the wall itself."""
    rng = np.random.default_rng(seed)
    found = np.zeros((6, _CELLS, _CELLS, 3))
    for face in (0, 1, 2, 4, 5):
        for _ in range(rng.integers(3, 8)):
            high, wide = rng.integers(4, _CELLS // 3, 2)
            top, left = rng.integers(2, _CELLS - high - 1), rng.integers(2, _CELLS - wide - 1)
            colour = rng.uniform(0.05, 0.85) * rng.uniform(0.4, 1, 3)
            found[face, top : top + high, left : left + wide] = colour
    return found


def _pattern(point: Array, face: NDArray[np.intp]) -> Array:
    """Floor boards, a door, pictures, skirting: factors of reflectance, for the eye to hold on."""
    x, y, z = point[..., 0], point[..., 1], point[..., 2]
    factor = np.ones(face.shape)
    boards = np.floor(x / 0.18)
    factor[face == 2] = (0.8 + 0.2 * np.sin(boards * 12.9898) ** 2)[face == 2]
    factor[(face != 2) & (face != 3) & (y < _LOW[1] + 0.12)] = 0.5  # skirting
    door = (face == 1) & (np.abs(z - 0.9) < 0.45) & (y < 0.75)
    factor[door] = 0.45
    for centre, width, height, shade in ((-1.2, 0.5, 0.35, 0.3), (0.6, 0.35, 0.45, 0.55)):
        picture = (face == 4) & (np.abs(x - centre) < width) & (np.abs(y - 0.15) < height)
        factor[picture] = shade
    shelf = (face == 0) & (np.abs(z + 1.2) < 0.8) & (np.abs((y + 0.2) % 0.5 - 0.25) < 0.04)
    factor[shelf] = 0.25
    return factor


def _irradiance(bulb: Bulb, point: Array, normal: Array) -> Array:
    """Irradiance (H, W, 3) on the walls by a glowing sphere, first light and a constant bounce."""
    towards = np.array(bulb.position_m) - point
    square = np.maximum((towards**2).sum(axis=-1), bulb.radius_m**2)
    cosine = np.maximum((towards * normal).sum(axis=-1) / np.sqrt(square), 0)
    first = np.pi * bulb.radius_m**2 / square * cosine  # of radiance 1
    sides = _HIGH - _LOW
    area = 2 * (sides[0] * sides[1] + sides[1] * sides[2] + sides[2] * sides[0])
    reflectance = float(luminance(_WALLS).mean())
    power = 4 * np.pi**2 * bulb.radius_m**2
    bounced = power / area * reflectance / (1 - reflectance)
    return np.asarray((first + bounced)[..., None] * np.array(bulb.radiance))
