"""The world over time: which scene, how it is turned, and how bright each lamp is.

Everything is a function of the time since the start, so that a run repeats exactly and anyone who
knows the world's description knows the truth of every frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lightprobe.geometry import Array
from lightprobe.sim.exposure import median_luminance
from lightprobe.sim.scene import Scene, Truth

#: Size at which a scene's median is taken; it decides brightness, not truth.
_PREVIEW_PX = (256, 128)


@dataclass(frozen=True)
class Behaviour:
    """How a world changes."""

    act_s: float = 8.0  # each scene lasts this long; then the next, and around again
    turn_deg_s: float = 0.0  # scenes turn to the right at this rate
    swing_deg: float = 0.0  # and to and fro besides, by so much to each side, as before a head
    swing_hz: float = 0.5  # so often
    switch_s: float = 0.0  # one lamp after the other is off for this long; 0: all stay on
    flicker_hz: float = 0.0  # lamps flicker (mains: 100 or 120)
    flicker_depth: float = 0.0  # by this share of their power


@dataclass(frozen=True, eq=False)
class State:
    """The world during one exposure."""

    t_s: float  # start of the exposure
    act: int  # index of the scene
    scene: Scene
    yaw_deg: float  # in the middle of the exposure
    powers: Array  # one per lamp of the scene
    smear_deg: float = 0.0  # by which the scene turns during the exposure, 0 or more

    def truth(self) -> Truth:
        """Light that the probe should report."""
        return self.scene.truth(self.powers, self.yaw_deg)


class World:
    """Scenes one after the other, lamps that switch and flicker, all of it turning."""

    def __init__(
        self,
        scenes: Sequence[Scene],
        behaviour: Behaviour | None = None,
        median_radiance: float | None = None,
    ) -> None:
        """`median_radiance`: bring every scene to this median luminance; None: as they are."""
        if not scenes:
            raise ValueError("world: no scene")
        self.behaviour = behaviour or Behaviour()
        self.scenes = [
            scene if median_radiance is None else _brought_to(scene, median_radiance)
            for scene in scenes
        ]

    def at(self, t_s: float, exposure_s: float = 0.0) -> State:
        """State during the exposure that starts `t_s` seconds after the start.

        Flicker is averaged over the exposure; scenes and lamps are as at its start.
        """
        b = self.behaviour
        act = int(t_s // b.act_s) % len(self.scenes) if b.act_s > 0 else 0
        scene = self.scenes[act]
        powers = np.full(len(scene.lamps), 1 + self._flicker(t_s, exposure_s))
        # Slot 0 leaves every lamp on, then each has its turn to be off; one lamp is never off.
        if b.switch_s > 0 and len(powers) > 1:
            slot = int(t_s // b.switch_s) % (len(powers) + 1)
            if slot:
                powers[slot - 1] = 0
        yaw_deg = self._yaw_deg(t_s + exposure_s / 2) % 360
        smear_deg = abs(self._yaw_deg(t_s + exposure_s) - self._yaw_deg(t_s))
        return State(t_s, act, scene, yaw_deg, powers, smear_deg)

    def _yaw_deg(self, t_s: float) -> float:
        b = self.behaviour
        swing_deg = b.swing_deg * np.sin(2 * np.pi * b.swing_hz * t_s) if b.swing_deg else 0.0
        return float(b.turn_deg_s * t_s + swing_deg)

    def _flicker(self, t_s: float, exposure_s: float) -> float:
        """Mean of depth · sin(2πft) over the exposure."""
        b = self.behaviour
        turns = b.flicker_hz * exposure_s
        middle = t_s + exposure_s / 2
        wave = np.sin(2 * np.pi * b.flicker_hz * middle) * np.sinc(turns)
        return float(b.flicker_depth * wave)


def _brought_to(scene: Scene, median_radiance: float) -> Scene:
    radiance = scene.render(*_PREVIEW_PX).compose(np.ones(len(scene.lamps)))
    median = median_luminance(radiance)
    return scene.scaled(median_radiance / median) if median > 0 else scene
