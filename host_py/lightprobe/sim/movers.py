"""People and things that move around the probe: where they are at a time, what they look like.

They live in the scene's frame, as a layer over the map of the whole sphere: each is a patch that
lets a share of what is behind it through and adds light of its own. :mod:`lightprobe.sim.moved`
draws them and says what is true then.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lightprobe import sh
from lightprobe.geometry import Array

#: Height of the probe above the floor.
_EYE_M = 1.4
#: Of a person: half the width of the body, radius and height of the head, belt against height.
_BODY_M, _HEAD_M, _NECK_M, _BELT = 0.25, 0.12, 0.27, 0.55
#: Albedo of skin; trousers have this share of the jacket's.
_SKIN, _TROUSERS = np.array([0.45, 0.32, 0.26]), 0.6
#: Walkers go so far to each side of where they are nearest.
_REACH_M = 4.0
#: The door: bearing, width, elevations of its ends, seconds in which it opens, all light beside.
_DOOR_DEG, _DOOR_WIDTH_DEG, _DOOR_ENDS_DEG, _DOOR_OPENS_S = 120.0, 40.0, (-40.0, 25.0), 1.0
#: Leaves: bearing and elevation of the middle, albedo, size of one; all green.
_LEAVES_DEG, _LEAVES_UP_DEG, _LEAF_DEG = -120.0, 20.0, 4.0
_LEAF = np.array([0.08, 0.16, 0.05])
#: The screen: bearing, elevation, height by width, pictures a second, seconds from cut to cut.
_SCREEN_DEG, _SCREEN_UP_DEG, _SCREEN_SHAPE, _SCREEN_HZ, _CUT_S = 180.0, -5.0, 9 / 16, 24.0, 1.5
#: Of its white: times the light that a white wall gives.
_SCREEN_WHITE = 4.0


@dataclass(frozen=True)
class Window:
    """Part of an equirectangular map: rows from `top`, and columns that may wrap."""

    top: int
    columns: NDArray[np.intp]  # (w,)
    elevation: Array  # (h, 1), radians
    beside: Array  # (1, w), radians to the right of the middle
    pixel: float  # radians

    @classmethod
    def of(
        cls, size_px: tuple[int, int], azimuth_deg: float, half_deg: float, low_deg: float,
        high_deg: float,
    ) -> Window:  # fmt: skip
        """All pixels of a map (width, height) that something between these bounds may touch."""
        width, height = size_px
        pixel = np.pi / height
        middle = np.radians(azimuth_deg) / pixel + (width - 1) / 2
        half = min(np.radians(half_deg) / pixel + 1, (width - 1) / 2)
        columns = np.arange(int(np.ceil(middle - half)), int(np.floor(middle + half)) + 1)
        top = max(int(np.radians(90 - high_deg) / pixel) - 1, 0)
        rows = np.arange(top, min(int(np.radians(90 - low_deg) / pixel) + 2, height))
        elevation = np.asarray(np.pi / 2 - (rows + 0.5) * pixel, dtype=np.float64)
        return cls(
            top, columns % width, elevation[:, None], ((columns - middle) * pixel)[None], pixel
        )

    def inside(self, from_edge: Array) -> Array:
        """Share of each pixel that is covered; `from_edge`: radians from its middle inwards."""
        return np.asarray(np.clip(0.5 + from_edge / self.pixel, 0, 1))

    def rectangle(self, half_deg: float, low_deg: float, high_deg: float) -> Array:
        """Share (h, w) of each pixel that lies in a rectangle about the middle."""
        across = self.inside(np.radians(half_deg) - np.abs(self.beside))
        above = self.inside(self.elevation - np.radians(low_deg))
        return np.asarray(across * above * self.inside(np.radians(high_deg) - self.elevation))


@dataclass(frozen=True, eq=False)
class Patch:
    """What a mover does to a map: `keep` × what is behind + `light`."""

    window: Window
    keep: NDArray[np.float32]  # (h, w, 1)
    light: NDArray[np.float32]  # (h, w, 3)

    @property
    def rows(self) -> slice:
        """Rows of the map that it lies on; the columns are the window's."""
        return slice(self.window.top, self.window.top + len(self.keep))

    def hide(self, radiance: NDArray[np.float32]) -> None:
        """Take what it hides from a map (H, W, C), in place."""
        part = radiance[self.rows]
        part[:, self.window.columns] = self.keep * part[:, self.window.columns]

    def lay(self, radiance: NDArray[np.float32]) -> None:
        """Lay it over a map (H, W, 3), in place."""
        part = radiance[self.rows]
        part[:, self.window.columns] = self.keep * part[:, self.window.columns] + self.light


class Mover(Protocol):
    """One person or thing at a moment; equal ones look alike."""

    def patch(self, size_px: tuple[int, int], scene_sh: Array) -> Patch:
        """Draw it for a map (width, height) in the light of a scene: SH (9, 3) of its radiance."""


def _wall(scene_sh: Array, azimuth_deg: Array | float) -> Array:
    """Radiance (…, 3) of a white, upright surface whose outward normal has this azimuth."""
    azimuth = np.radians(azimuth_deg)
    normals = np.stack([np.sin(azimuth), np.zeros_like(azimuth), -np.cos(azimuth)], axis=-1)
    return np.maximum(sh.irradiance(scene_sh, normals), 0) / np.pi


@dataclass(frozen=True)
class Walker:
    """A person, an upright cylinder with a head, lit by the scene as a Lambertian surface."""

    azimuth_deg: float
    distance_m: float
    height_m: float
    albedo: float

    def patch(self, size_px: tuple[int, int], scene_sh: Array) -> Patch:
        """See :class:`Mover`."""
        half = float(np.arcsin(min(_BODY_M / self.distance_m, 0.99)))
        high = np.arctan2(self.height_m - _EYE_M, self.distance_m)
        feet, shoulder, belt, eyes = (
            float(np.arctan2(up_m - _EYE_M, self.distance_m))
            for up_m in (
                0.0, self.height_m - _NECK_M, _BELT * self.height_m, self.height_m - _HEAD_M
            )
        )  # fmt: skip
        top_deg = np.degrees(max(high, shoulder)) + 1
        window = Window.of(size_px, self.azimuth_deg, np.degrees(half), np.degrees(feet), top_deg)
        body = window.rectangle(*np.degrees([half, feet, shoulder]))
        cosine = np.sin(window.elevation) * np.sin(eyes)
        cosine = cosine + np.cos(window.elevation) * np.cos(eyes) * np.cos(window.beside)
        size = np.arctan2(_HEAD_M, np.hypot(self.distance_m, self.height_m - _HEAD_M - _EYE_M))
        head = window.inside(size - np.arccos(np.clip(cosine, -1, 1))) * (1 - body)
        # The normal of the cylinder's surface: towards the probe in the middle, aside at the rim.
        turned = np.degrees(np.arcsin(np.clip(np.sin(window.beside) / np.sin(half), -1, 1)))
        white = _wall(scene_sh, self.azimuth_deg + 180 - turned - np.degrees(window.beside))
        clothes = self.albedo * np.where(window.elevation < belt, _TROUSERS, 1.0)
        light = (clothes * body)[..., None] * white + head[..., None] * _SKIN * white
        return Patch(window, *_single(1 - body - head, light))


@dataclass(frozen=True)
class Door:
    """A doorway that is open to a share, to a place that is brighter or darker."""

    open: float
    gain: float

    def patch(self, size_px: tuple[int, int], scene_sh: Array) -> Patch:
        """See :class:`Mover`."""
        half_deg = _DOOR_WIDTH_DEG / 2
        window = Window.of(size_px, _DOOR_DEG, half_deg, *_DOOR_ENDS_DEG)
        whole = window.rectangle(half_deg, *_DOOR_ENDS_DEG)
        edge = np.radians(half_deg * (2 * self.open - 1))
        seen = whole * window.inside(edge - window.beside)
        return Patch(window, *_single(1 + (self.gain - 1) * seen, np.zeros((*seen.shape, 3))))


@dataclass(frozen=True)
class Leaves:
    """Twigs before the light behind them, as the wind has them at a moment."""

    size_deg: float
    turns: float  # of the wind, since the start

    def patch(self, size_px: tuple[int, int], scene_sh: Array) -> Patch:
        """See :class:`Mover`."""
        half_deg = self.size_deg / 2
        ends_deg = (_LEAVES_UP_DEG - half_deg, _LEAVES_UP_DEG + half_deg)
        window = Window.of(size_px, _LEAVES_DEG, half_deg, *ends_deg)
        wind, leaf = 2 * np.pi * self.turns, np.radians(_LEAF_DEG) / (2 * np.pi)
        up, beside = window.elevation / leaf, window.beside / leaf
        pattern = np.sin(beside + 1.5 * np.sin(wind + 0.8 * up))
        pattern = pattern + np.sin(1.2 * up + 1.5 * np.sin(0.7 * wind + 0.6 * beside))
        hidden = window.rectangle(half_deg, *ends_deg) * np.clip(0.5 + 2 * pattern, 0, 1)
        light = hidden[..., None] * _LEAF * _wall(scene_sh, _LEAVES_DEG + 180)
        return Patch(window, *_single(1 - hidden, light))


@dataclass(frozen=True)
class Screen:
    """A screen that shows one picture of a film."""

    width_deg: float
    picture: int

    def patch(self, size_px: tuple[int, int], scene_sh: Array) -> Patch:
        """See :class:`Mover`."""
        half_deg = self.width_deg / 2
        ends_deg = (_SCREEN_UP_DEG + half_deg * _SCREEN_SHAPE * np.array([-1, 1])).tolist()
        window = Window.of(size_px, _SCREEN_DEG, half_deg, *ends_deg)
        seen = window.rectangle(half_deg, *ends_deg)
        take = np.random.default_rng([0x5C8, int(self.picture / (_SCREEN_HZ * _CUT_S))])
        flicker = np.random.default_rng([0xF17, self.picture]).uniform(0.9, 1.1)
        colour = take.uniform(0.05, 1.0) * take.uniform(0.6, 1.0, 3) * flicker
        white = _SCREEN_WHITE * max(float(sh.irradiance(scene_sh, [[0, 1.0, 0]]).mean()), 0)
        return Patch(window, *_single(1 - seen, seen[..., None] * colour * white / np.pi))


@dataclass(frozen=True)
class Card:
    """A round card held before the lens: a shade, a coloured thing, or, at 180°, a lens cap."""

    azimuth_deg: float
    elevation_deg: float
    radius_deg: float
    colour: tuple[float, float, float] = (0.0, 0.0, 0.0)  # albedo of its side to the lens

    def patch(self, size_px: tuple[int, int], scene_sh: Array) -> Patch:
        """See :class:`Mover`."""
        window = Window.of(size_px, 0, 180, -90, 90)
        azimuth, elevation = np.radians([self.azimuth_deg, self.elevation_deg])
        cosine = np.sin(window.elevation) * np.sin(elevation)
        beside = window.beside - azimuth
        cosine = cosine + np.cos(window.elevation) * np.cos(elevation) * np.cos(beside)
        off = np.arccos(np.clip(cosine, -1, 1))
        whole = self.radius_deg >= 180
        seen = np.ones_like(off) if whole else window.inside(np.radians(self.radius_deg) - off)
        level = np.cos(elevation)
        normal = [-np.sin(azimuth) * level, -np.sin(elevation), np.cos(azimuth) * level]
        white = np.maximum(sh.irradiance(scene_sh, [normal])[0], 0) / np.pi
        return Patch(window, *_single(1 - seen, seen[..., None] * np.array(self.colour) * white))


def _single(keep: Array, light: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    return keep[..., None].astype(np.float32), light.astype(np.float32)


@dataclass(frozen=True)
class Movers:
    """Who walks by, and what moves; nothing unless told."""

    walkers: int = 0  # so many people walk to and fro
    walker_m: float = 2.0  # past the probe, so near
    walker_m_s: float = 1.2
    walker_deg: float = 0.0  # the first is nearest at this azimuth; others are spread evenly
    walker_height_m: float = 1.75
    walker_albedo: tuple[float, ...] = (0.05, 0.7)  # of jackets; first walker, second, …
    walker_stand_s: float = 0.0  # they stand so long where they are nearest
    door_s: float = 0.0  # a door opens and closes again every so many seconds; 0: there is none
    door_gain: float = 4.0  # so much brighter it is behind it
    leaves_deg: float = 0.0  # leaves flutter in a square of this size; 0: there are none
    leaves_hz: float = 1.0  # to and fro so often
    screen_deg: float = 0.0  # a screen of this width plays; 0: there is none

    def at(self, t_s: float) -> tuple[Mover, ...]:
        """All of them, the farthest first."""
        found: list[Mover] = []
        if self.screen_deg:
            found.append(Screen(self.screen_deg, int(t_s * _SCREEN_HZ)))
        if self.door_s:
            part = t_s % self.door_s
            ramp = min(part, self.door_s / 2 + _DOOR_OPENS_S - part) / _DOOR_OPENS_S
            found.append(Door(float(np.clip(ramp, 0, 1)), self.door_gain))
        if self.leaves_deg:
            found.append(Leaves(self.leaves_deg, self.leaves_hz * t_s))
        people = [self._walker(k, t_s) for k in range(self.walkers)]
        return (*found, *sorted(people, key=lambda one: -one.distance_m))

    def _walker(self, number: int, t_s: float) -> Walker:
        leg_s = 2 * _REACH_M / self.walker_m_s + self.walker_stand_s
        part_s = t_s % leg_s - _REACH_M / self.walker_m_s  # since the nearest place
        on_s = part_s - float(np.clip(part_s, 0, self.walker_stand_s))
        back = (int(t_s // leg_s) + number) % 2
        beside_m = self.walker_m_s * on_s * (-1 if back else 1)
        way_m = self.walker_m * (1 + 0.1 * number)  # they do not walk through each other
        azimuth_deg = self.walker_deg + 360 * number / self.walkers
        azimuth_deg += float(np.degrees(np.arctan2(beside_m, way_m)))
        albedo = self.walker_albedo[number % len(self.walker_albedo)]
        return Walker(azimuth_deg, float(np.hypot(beside_m, way_m)), self.walker_height_m, albedo)
