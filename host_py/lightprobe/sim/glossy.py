"""Rooms with mirrors and polarized light: glass panes, varnished floors, LCD screens, windows.

All of it stands at a distance, so that a lamp and its image are seen as a mirror shows them to an
eye beside it: the image is the lamp mirrored in the plane of the pane, as far behind it as the lamp
is before it. What is mirrored is polarized by Fresnel's equations, whatever it was before. A mirror
shows lamps, screens, windows and the walls, but no other mirror.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe import geometry, sh
from lightprobe.geometry import Array
from lightprobe.imaging.polarizer import pixel_frame
from lightprobe.lamp import Lamp, disc_pixels
from lightprobe.sim.polarized import Sky, fresnel_amplitudes, map_truth
from lightprobe.sim.scene import Layer, Layers, MapTruth, ProceduralScene, disc_layer

_UP = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, eq=False)
class Panel:
    """A flat rectangle: its centre (3,) in metres from the probe, and its front's normal."""

    centre_m: Array
    normal: Array  # (3,) unit vector towards the probe's side
    width_m: float  # along the horizontal; of a level one along X
    height_m: float

    def hit(self, origins: Array, directions: Array) -> Array:
        """How far from origins (…, 3) rays meet its front (…), m; infinite where they do not."""
        slope = directions @ self.normal
        facing = slope < -1e-6
        far = ((self.centre_m - origins) @ self.normal) / np.where(facing, slope, -1.0)
        right, up = self._axes()
        off = origins + far[..., None] * directions - self.centre_m
        inside = (np.abs(off @ right) <= self.width_m / 2) & (np.abs(off @ up) <= self.height_m / 2)
        return np.where(facing & inside & (far > 1e-6), far, np.inf)

    def _axes(self) -> tuple[Array, Array]:
        # as an eye before it has them
        right = np.cross(_UP, self.normal)
        length = np.linalg.norm(right)
        right = right / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
        return right, np.cross(self.normal, right)

    def axis(self, angle_deg: float) -> Array:
        """Direction (3,) in its plane, so far from horizontal as an eye before it sees it."""
        right, up = self._axes()
        turn = np.radians(angle_deg)
        return np.asarray(np.cos(turn) * right + np.sin(turn) * up)


@dataclass(frozen=True, eq=False)
class Mirror:
    """Smooth glass or varnish over whatever is behind it."""

    panel: Panel
    refractive_index: float = 1.5

    def light(self, stokes: Array, towards: Array, directions: Array) -> Array:
        """What it mirrors (N, 3, RGB) to an eye that looks along directions (N, 3).

        `stokes` (N, 3, RGB): of the light that arrives from `towards` (N, 3); all in the frames of
        those directions. Field by field: across the plane of incidence and in it.
        """
        cosine = np.clip(-(directions @ self.panel.normal), 0.0, 1.0)
        across, along = fresnel_amplitudes(cosine, self.refractive_index)
        s = np.cross(self.panel.normal, directions)
        length = np.linalg.norm(s, axis=-1, keepdims=True)
        other = np.cross(directions, pixel_frame(directions)[0])
        s = np.where(length > 1e-6, s / np.maximum(length, 1e-6), other)
        # light travels against the direction in which its source is seen
        p_in, p_out = np.cross(-towards, s), np.cross(-directions, s)
        right, up = pixel_frame(towards)
        to_right, to_up = pixel_frame(directions)
        a, b, c, d = (
            across * _dot(to, s) * _dot(of, s) + along * _dot(to, p_out) * _dot(of, p_in)
            for to in (to_right, to_up)
            for of in (right, up)
        )
        return _transformed(stokes, a, b, c, d)

    def towards(self, directions: Array) -> Array:
        """Where an eye looks that looks along directions (…, 3) into it."""
        n = self.panel.normal
        return np.asarray(directions - 2 * (directions @ n)[..., None] * n)

    def mirrored_m(self, place_m: Array) -> Array | None:
        """Where the image (3,) of something is; None: it is behind the mirror."""
        away_m = float((place_m - self.panel.centre_m) @ self.panel.normal)
        return place_m - 2 * away_m * self.panel.normal if away_m > 0 else None


def _dot(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(axis=-1))


def _transformed(stokes: Array, a: Array, b: Array, c: Array, d: Array) -> Array:
    """S0, S1, S2 (N, 3, RGB) of fields that a real matrix [[a, b], [c, d]] (N each) changes."""
    a, b, c, d = (one[:, None] for one in (a, b, c, d))
    s0, s1, s2 = np.moveaxis(stokes, 1, 0)
    xx, yy, xy = (s0 + s1) / 2, (s0 - s1) / 2, s2 / 2
    new_xx = a * a * xx + 2 * a * b * xy + b * b * yy
    new_yy = c * c * xx + 2 * c * d * xy + d * d * yy
    new_xy = a * c * xx + (a * d + b * c) * xy + b * d * yy
    return np.stack([new_xx + new_yy, new_xx - new_yy, 2 * new_xy], axis=1)


@dataclass(frozen=True, eq=False)
class Screen:
    """An LCD screen that shows one colour: its light is linearly polarized."""

    panel: Panel
    radiance: Array  # (3,)
    field_deg: float = 45.0  # of the field in its plane, counter-clockwise as an eye sees it
    dolp: float = 0.98

    def stokes(self, directions: Array) -> Array:
        """S0, S1, S2 (N, 3, RGB) as seen along directions (N, 3): the field's part across them."""
        right, up = pixel_frame(directions)
        field = self.panel.axis(self.field_deg)
        x, y = right @ field, up @ field
        square = np.maximum(x * x + y * y, 1e-12)
        part = np.stack(
            [np.ones_like(x), self.dolp * (x * x - y * y) / square, self.dolp * 2 * x * y / square],
            axis=-1,
        )
        return np.asarray(part[..., None] * self.radiance)


@dataclass(frozen=True, eq=False)
class Window:
    """An open window: the clear sky through it."""

    panel: Panel
    sky: Sky

    def stokes(self, directions: Array) -> Array:
        """S0, S1, S2 (N, 3, RGB) as seen along directions (N, 3)."""
        return self.sky.stokes(directions)


@dataclass(frozen=True, eq=False)
class Image:
    """A lamp as a mirror shows it to the probe."""

    lamp: Lamp  # as seen: direction, radius and irradiance
    dolp: float
    mirror: Mirror


@dataclass(frozen=True, eq=False)
class GlossyRoom:
    """Lamps over a smooth gradient, each at a distance, among mirrors, screens and windows."""

    scene: ProceduralScene
    distances_m: tuple[float, ...]  # of its lamps
    mirrors: tuple[Mirror, ...] = ()
    screens: tuple[Screen, ...] = ()
    windows: tuple[Window, ...] = ()

    @property
    def name(self) -> str:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return f"glossy-{self.scene.name}"

    @property
    def lamps(self) -> tuple[Lamp, ...]:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return self.scene.lamps

    def scaled(self, factor: float) -> GlossyRoom:
        """See :class:`lightprobe.sim.scene.Scene`."""
        return replace(
            self,
            scene=self.scene.scaled(factor),
            screens=tuple(replace(one, radiance=factor * one.radiance) for one in self.screens),
            windows=tuple(replace(one, sky=one.sky.scaled(factor)) for one in self.windows),
        )

    def truth(self, powers: ArrayLike, rotation: ArrayLike = geometry.UNTURNED) -> MapTruth:
        """Sum over the map; the lamps are the scene's own."""
        return map_truth(self, powers, rotation)

    @cached_property
    def images(self) -> tuple[Image, ...]:
        """Lamps that the probe sees in mirrors, at least their centres."""
        found = [
            self._image(lamp, distance_m, index)
            for lamp, distance_m in zip(self.lamps, self.distances_m, strict=True)
            for index in range(len(self.mirrors))
        ]
        return tuple(one for one in found if one is not None)

    def _image(self, lamp: Lamp, distance_m: float, index: int) -> Image | None:
        mirror = self.mirrors[index]
        seen = _mirrored_lamp(lamp, distance_m, mirror)
        if seen is None:
            return None
        direction = seen.direction[None]
        far = [float(panel.hit(np.zeros(3), direction)[0]) for panel in self.panels]
        if not np.isfinite(far[index]) or far[index] > min(far):
            return None
        plain = np.zeros((1, 3, 1))
        plain[:, 0] = 1
        s0, s1, s2 = mirror.light(plain, mirror.towards(direction), direction)[0, :, 0]
        return Image(seen.scaled(float(s0)), float(np.hypot(s1, s2) / s0), mirror)

    @property
    def panels(self) -> tuple[Panel, ...]:
        """Everything flat that stands around: mirrors, screens, windows."""
        mirrors = (one.panel for one in self.mirrors)
        return (*mirrors, *(one.panel for one in self._shining()))

    def _shining(self) -> tuple[Screen | Window, ...]:
        return (*self.screens, *self.windows)

    # ---------------------------------------------------------------- rendering

    def render(self, width_px: int, height_px: int) -> Layers:
        """See :class:`lightprobe.sim.scene.Scene`."""
        directions = geometry.equirect_directions(width_px, height_px).reshape(-1, 3)
        origin = np.zeros(3)
        stokes = self._seen(origin, directions)
        far = np.array([panel.hit(origin, directions) for panel in self.panels])
        first = far.argmin(axis=0) if len(far) else np.zeros(len(directions), int)
        shown = [
            np.flatnonzero((first == k) & np.isfinite(far[k])) for k in range(len(self.mirrors))
        ]
        for k, (mirror, index) in enumerate(zip(self.mirrors, shown, strict=True)):
            looking = directions[index]
            points = far[k, index, None] * looking
            towards = mirror.towards(looking)
            stokes[index] += mirror.light(self._seen(points, towards), towards, looking)
        maps = np.moveaxis(stokes, 1, 0).reshape(3, height_px, width_px, 3).astype(np.float32)
        lamps = tuple(
            self._layer(lamp, distance_m, directions, shown, (width_px, height_px))
            for lamp, distance_m in zip(self.lamps, self.distances_m, strict=True)
        )
        return Layers(np.ascontiguousarray(maps[0]), lamps, np.ascontiguousarray(maps[1:]))

    def _seen(self, origins: Array, directions: Array) -> Array:
        """S0, S1, S2 (N, 3, RGB) of all but lamps and mirrors; origins (3,) or (N, 3)."""
        stokes = np.zeros((len(directions), 3, 3))
        stokes[:, 0] = sh.radiance(self.scene.background, directions)
        nearest = np.full(len(directions), np.inf)
        for one in self._shining():
            far = one.panel.hit(origins, directions)
            index = np.flatnonzero(far < nearest)
            nearest[index] = far[index]
            stokes[index] = one.stokes(directions[index])
        return stokes

    def _layer(
        self,
        lamp: Lamp,
        distance_m: float,
        directions: Array,
        shown: list[NDArray[np.intp]],
        size_px: tuple[int, int],
    ) -> Layer:
        """A lamp and its images; `shown`: pixels of each mirror."""
        own = disc_layer(lamp, *size_px)
        parts = [(np.asarray(own.index), own.values, np.zeros((2, *own.values.shape), np.float32))]
        for mirror, visible in zip(self.mirrors, shown, strict=True):
            seen = _mirrored_lamp(lamp, distance_m, mirror)
            if seen is None:
                continue
            index, values = disc_pixels(seen, *size_px)
            inside = np.isin(index, visible)
            index, values = index[inside], values[inside]
            plain = np.zeros((len(index), 3, 3))
            plain[:, 0] = values
            looking = directions[index]
            stokes = mirror.light(plain, mirror.towards(looking), looking).astype(np.float32)
            parts.append((index, stokes[:, 0], np.moveaxis(stokes[:, 1:], 1, 0)))
        indices, values, polarized = zip(*parts, strict=True)
        # a pixel may show the lamp and an image: a layer has each but once
        index, where = np.unique(np.concatenate(indices), return_inverse=True)
        light = np.zeros((3, len(index), 3), np.float32)
        np.add.at(light[0], where, np.concatenate(values))
        for k in range(2):
            np.add.at(light[k + 1], where, np.concatenate(polarized, axis=1)[k])
        return Layer(index, light[0], light[1:])


def _mirrored_lamp(lamp: Lamp, distance_m: float, mirror: Mirror) -> Lamp | None:
    """A lamp as a perfect mirror without edges would show it; None: behind the mirror."""
    place_m = mirror.mirrored_m(distance_m * lamp.direction)
    if place_m is None:
        return None
    further = float(np.linalg.norm(place_m)) / distance_m
    radius_deg = float(np.degrees(np.arcsin(np.sin(np.radians(lamp.radius_deg)) / further)))
    solid_angle = float(geometry.cap_solid_angle_sr(radius_deg))
    return Lamp(geometry.normalize(place_m), radius_deg, solid_angle * lamp.radiance)
