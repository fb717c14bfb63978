"""The world over time: which scene, how it is turned, and how bright each lamp is.

Everything is a function of the time since the start, so that a run repeats exactly and anyone who
knows the world's description knows the truth of every frame, until somebody keeps a scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lightprobe.errors import UsageError
from lightprobe.geometry import Array
from lightprobe.sim.exposure import median_luminance
from lightprobe.sim.flicker import Flicker
from lightprobe.sim.moved import MovedTruth, change
from lightprobe.sim.movers import Mover, Movers
from lightprobe.sim.room import Room
from lightprobe.sim.scene import Scene, Truth, turn

#: Size at which a scene's median is taken; it decides brightness, not truth.
_PREVIEW_PX = (256, 128)
#: Direction of a walk.
_WALK = (0.6, 0.0, -0.8)


@dataclass(frozen=True)
class Behaviour:
    """How a world changes."""

    act_s: float = 8.0  # each scene lasts this long; then the next, and around again
    turn_deg_s: float = 0.0  # scenes turn to the right at this rate
    swing_deg: float = 0.0  # and to and fro besides, by so much to each side, as before a head
    swing_hz: float = 0.5  # so often
    switch_s: float = 0.0  # one lamp after the other is off for this long; 0: all stay on
    flicker: Flicker = Flicker()  # noqa: RUF009 - frozen
    walk_m: float = 0.0  # the probe walks across the room, so far to each side; 0: it stands
    walk_m_s: float = 1.0  # at this speed in the middle
    cover_from_s: float = 0.0  # somebody covers the right half of the camera's view
    cover_to_s: float = 0.0  # until then
    nod_deg: float = 0.0  # the probe nods, by so much up and down, about its own X
    nod_hz: float = 0.17  # so often
    movers: Movers = Movers()  # noqa: RUF009 - frozen


@dataclass(frozen=True, eq=False)
class State:
    """The world during one exposure, of the middle row."""

    t_s: float  # start of the exposure
    act: int  # index of the scene
    scene: Scene
    yaw_deg: float  # in the middle of the exposure
    powers: Array  # one per lamp of the scene
    smear_deg: float = 0.0  # by which the scene turns during the exposure, 0 or more
    nod_deg: float = 0.0  # by which the probe looks up in the middle of the exposure
    nod_smear_deg: float = 0.0  # by which it nods during it, while the scene turns by smear_deg
    place_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # where the probe is in the scene
    is_covered: bool = False
    movers: tuple[Mover, ...] = ()  # in the middle of the exposure, the farthest first

    def truth(self) -> Truth:
        """Light that the probe should report."""
        still = self.scene.truth(self.powers, self.yaw_deg, self.nod_deg)
        if not self.movers:
            return still
        more = change(self.movers, self.scene, self.powers)
        return MovedTruth(still, more, turn(self.yaw_deg, self.nod_deg), self.powers)


@dataclass(frozen=True, eq=False)
class Rows:
    """What rows of one picture saw that were exposed one after the other."""

    offset_deg: Array  # (H,) yaw in the middle of each row's exposure, less that of the middle row
    powers: Array  # (H, lamps)
    nod_offset_deg: Array  # (H,) as offset_deg, of the nod


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
        self.kept: int | None = None  # the scene that stays, by index; None: as behaviour has it
        flat = [scene.name for scene in scenes if not isinstance(scene, Room)]
        if self.behaviour.walk_m and flat:
            raise UsageError(f"world: {flat[0]}: nobody can walk in it: take the scene room")
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
        act = act if self.kept is None else self.kept
        scene = self.scenes[act]
        yaw_deg = float(self._yaw_deg(t_s + exposure_s / 2)) % 360
        turned_deg = float(self._yaw_deg(t_s + exposure_s) - self._yaw_deg(t_s))
        nodded_deg = float(self._nod_deg(t_s + exposure_s) - self._nod_deg(t_s))
        place_m = self._place_m(t_s + exposure_s / 2)
        if isinstance(scene, Room) and b.walk_m:
            scene = scene.seen_from(place_m)
        return State(
            t_s, act, scene, yaw_deg, self._powers(scene, t_s, exposure_s), abs(turned_deg),
            float(self._nod_deg(t_s + exposure_s / 2)),
            -nodded_deg if turned_deg < 0 else nodded_deg,
            place_m, b.cover_from_s <= t_s < b.cover_to_s, b.movers.at(t_s + exposure_s / 2),
        )  # fmt: skip

    def _place_m(self, t_s: float) -> tuple[float, float, float]:
        b = self.behaviour
        if not b.walk_m:
            return (0.0, 0.0, 0.0)
        way_m = b.walk_m * float(np.sin(b.walk_m_s / b.walk_m * t_s))
        return (_WALK[0] * way_m, _WALK[1] * way_m, _WALK[2] * way_m)

    def rows(self, state: State, starts_s: Array, exposure_s: float) -> Rows:
        """What each row of a picture saw whose middle row saw `state`.

        `starts_s` (H,): seconds from the start of the middle row's exposure to that of each row's.
        """
        t_s = state.t_s + starts_s
        offset_deg = self._yaw_deg(t_s + exposure_s / 2) - self._yaw_deg(state.t_s + exposure_s / 2)
        nod_deg = self._nod_deg(t_s + exposure_s / 2) - self._nod_deg(state.t_s + exposure_s / 2)
        return Rows(offset_deg, self._powers(state.scene, t_s, exposure_s), nod_deg)

    def _yaw_deg(self, t_s: ArrayLike) -> Array:
        b, t = self.behaviour, np.asarray(t_s, dtype=np.float64)
        return np.asarray(b.turn_deg_s * t + b.swing_deg * np.sin(2 * np.pi * b.swing_hz * t))

    def _nod_deg(self, t_s: ArrayLike) -> Array:
        b, t = self.behaviour, np.asarray(t_s, dtype=np.float64)
        return np.asarray(b.nod_deg * np.sin(2 * np.pi * b.nod_hz * t))

    def _powers(self, scene: Scene, t_s: ArrayLike, exposure_s: float) -> Array:
        """Powers (…, lamps) during exposures that start at `t_s` (…)."""
        b, count = self.behaviour, len(scene.lamps)
        powers = b.flicker.powers(count, t_s, exposure_s)
        # Slot 0 leaves every lamp on, then each has its turn to be off; one lamp is never off.
        if b.switch_s > 0 and count > 1:
            slot = (np.asarray(t_s) // b.switch_s).astype(int) % (count + 1)
            powers = np.where(slot[..., None] == np.arange(1, count + 1), 0.0, powers)
        return powers


def _brought_to(scene: Scene, median_radiance: float) -> Scene:
    radiance = scene.render(*_PREVIEW_PX).compose(np.ones(len(scene.lamps)))
    median = median_luminance(radiance)
    return scene.scaled(median_radiance / median) if median > 0 else scene
