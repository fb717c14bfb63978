"""Automatic exposure, as cameras have it that take no commands.

A control loop: the mean code of a picture is metered, half of the weight in front, and the exposure
of a later frame moves part of the way to where that code would be the one aimed at. So it lags
behind a change of light, and turning the camera changes it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry
from lightprobe.colour import linear_to_srgb, luminance
from lightprobe.geometry import Array
from lightprobe.imaging.camera import equirect
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.motion import is_level, level_yaw_deg
from lightprobe.sim.moved import patches
from lightprobe.sim.rays import Rays, padded
from lightprobe.sim.scene import Layers
from lightprobe.sim.world import State

#: Size of the map that is metered.
_METERED_PX = (64, 32)
#: Mean code that is aimed at, 0…1, and the exponent from codes to light.
_AIM, _GAMMA = 0.45, 2.2
#: Share of the meter that looks ahead, within so many degrees (1 sigma).
_AHEAD, _AHEAD_DEG = 0.5, 30.0
#: A frame's exposure moves by _SHARE of the stops that are missing, at most by _MOST_STOPS; it
#: stays when no more than _LEAST_STOPS are missing.
_SHARE, _MOST_STOPS, _LEAST_STOPS = 0.2, 0.5, 0.08
#: Where the longest exposure does not suffice, the sensor's gain rises up to this.
_MOST_GAIN = 8.0


@dataclass
class AutoExposure:
    """The loop; frames are asked for in their order."""

    camera: SimulatedCamera
    delay_frames: int = 2  # from a metered picture to the first that heeds it
    _shots: list[tuple[int, Shot]] = field(default_factory=list)  # the newest, with their numbers
    _layers: dict[int, Layers] = field(default_factory=dict)
    _weight: Array = field(init=False)
    _rays: Rays = field(init=False)

    def __post_init__(self) -> None:
        """Weigh the meter's pixels by solid angle, and those ahead more."""
        width, height = _METERED_PX
        directions = geometry.equirect_directions(width, height)
        by_row = geometry.equirect_solid_angles(width, height)
        sphere = np.repeat(by_row[:, None], width, axis=1)
        off_deg = np.degrees(np.arccos(np.clip(-directions[..., 2], -1, 1)))
        ahead = sphere * np.exp(-0.5 * (off_deg / _AHEAD_DEG) ** 2)
        self._rays = Rays(equirect(), _METERED_PX, _METERED_PX)
        self._weight = (1 - _AHEAD) * sphere / sphere.sum() + _AHEAD * ahead / ahead.sum()

    def shot(self, frame: int) -> Shot:
        """Exposure of a frame, a later one than the last that was asked for."""
        heeded = [(number, shot) for number, shot in self._shots if number <= frame - 1]
        if not heeded:
            (shot,) = self.camera.automatic(frame)
        else:
            seen, metered = next(
                (one for one in reversed(heeded) if one[0] <= frame - self.delay_frames),
                heeded[0],
            )
            newest = heeded[-1][1]
            missing = self._missing_stops(seen, metered)
            # what has been commanded since then is under way
            missing -= math.log2(_product_us(newest) / _product_us(metered))
            step = float(np.clip(_SHARE * missing, -_MOST_STOPS, _MOST_STOPS))
            shot = newest
            if abs(missing) > _LEAST_STOPS:
                shot = self._possible(_product_us(newest) * 2**step)
        self._shots = [*self._shots[-8:], (frame, shot)]
        return shot

    def _possible(self, product_us: float) -> Shot:
        """Give exposure time first, then gain."""
        limits = self.camera.limits
        exposure_us = limits.nearest(product_us)
        gain = 1.0
        if exposure_us >= limits.most_us:
            gain = min(max(product_us / exposure_us, 1.0), _MOST_GAIN)
        return Shot(exposure_us, gain)

    def _missing_stops(self, frame: int, shot: Shot) -> float:
        """Stops by which a picture is too dark."""
        state = self.camera.state(frame, shot)
        linear = self._radiance(state) * _product_us(shot) * 1e-6 * self.camera.gain
        level = float((linear_to_srgb(luminance(linear)) * self._weight).sum())
        return _GAMMA * math.log2(_AIM / max(level, 1e-3))

    def _radiance(self, state: State) -> NDArray[np.float32]:
        """Map (H, W, 3) as the camera is turned; what a hand covers is black."""
        width, height = _METERED_PX
        if self.camera.world.behaviour.is_going:
            layers = state.scene.render(width, height)
        else:
            if state.act not in self._layers:
                self._layers[state.act] = state.scene.render(width, height)
            layers = self._layers[state.act]
        radiance = layers.compose(state.powers)
        for patch in patches(state.movers, _METERED_PX, state.scene, state.powers):
            patch.lay(radiance)
        if is_level(state.rotation):
            turn_px = round(float(level_yaw_deg(state.rotation)) % 360 / 360 * width)
            radiance = np.roll(radiance, turn_px, axis=1)
        else:
            radiance = self._rays.turned(state.rotation[None]).sample(padded(radiance))
        if state.is_covered:
            radiance[:, width // 2 :] = 0
        return radiance


def _product_us(shot: Shot) -> float:
    return shot.exposure_us * shot.gain
