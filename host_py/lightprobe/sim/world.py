"""The world over time: which scene, how it is turned, and how bright each lamp is.

Everything is a function of the time since the start, so that a run repeats exactly and anyone who
knows the world's description knows the truth of every frame, until somebody keeps a scene or holds
a card before the lens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lightprobe import geometry
from lightprobe.errors import UsageError
from lightprobe.geometry import Array
from lightprobe.sim.exposure import median_luminance
from lightprobe.sim.flicker import Flicker
from lightprobe.sim.motion import Track, angles_deg, turned, way_deg
from lightprobe.sim.moved import MovedTruth, change
from lightprobe.sim.movers import Card, Mover, Movers
from lightprobe.sim.scene import Scene, Truth, Walkable

#: Size at which a scene's median is taken; it decides brightness, not truth.
_PREVIEW_PX = (256, 128)
#: Direction of a walk.
_WALK = (0.6, 0.0, -0.8)
_HERE = (0.0, 0.0, 0.0)
#: An exposure in which the probe turns to and fro is followed in so many parts.
_WAY_PARTS = 8


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
    roll_deg: float = 0.0  # the probe rolls about where it looks, by so much to each side
    roll_hz: float = 0.23  # so often
    path: Track | None = None  # how the probe is turned and, in a room, goes; instead of all that
    movers: Movers = Movers()  # noqa: RUF009 - frozen

    @property
    def is_level(self) -> bool:
        """Tell whether the probe turns about the vertical alone."""
        return self.path.is_level if self.path else not (self.nod_deg or self.roll_deg)

    @property
    def is_going(self) -> bool:
        """Tell whether the probe leaves its place, where the scene lets it."""
        return bool(self.walk_m) or (self.path is not None and self.path.moves)


@dataclass(frozen=True, eq=False)
class State:
    """The world during one exposure, of the middle row."""

    t_s: float  # start of the exposure
    act: int  # index of the scene
    scene: Scene
    rotation: Array  # (4,) camera to scene, in the middle of the exposure
    powers: Array  # one per lamp of the scene
    exposure_s: float = 0.0
    smear_deg: float = 0.0  # through which the probe turns during the exposure, to and fro added
    place_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # where the probe is in the scene
    is_covered: bool = False
    movers: tuple[Mover, ...] = ()  # in the middle of the exposure, the farthest first

    def truth(self) -> Truth:
        """Light that the probe should report."""
        still = self.scene.truth(self.powers, self.rotation)
        if not self.movers:
            return still
        more = change(self.movers, self.scene, self.powers)
        return MovedTruth(still, more, geometry.inverse(self.rotation), self.powers)

    @property
    def angles_deg(self) -> tuple[float, float, float]:
        """Yaw, nod and roll of :attr:`rotation`."""
        return angles_deg(self.rotation)


@dataclass(frozen=True, eq=False)
class Rows:
    """What rows of one picture saw that were exposed one after the other."""

    turned: Array  # (H, 4) rotation of each row, in the scene, after that of the middle row
    powers: Array  # (H, lamps)

    @property
    def turns(self) -> bool:
        """Tell whether any row saw the scene from another side."""
        return bool(self.turned[:, 1:].any())


class World:
    """Scenes one after the other, lamps that switch and flicker, all of it turning."""

    #: True: any act may bring a scene that is not among :attr:`scenes`.
    has_new_scenes = False

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
        self.card: Card | None = None  # that somebody holds before the lens now
        self._check_path(scenes)
        flat = [scene.name for scene in scenes if not isinstance(scene, Walkable)]
        if self.behaviour.walk_m and flat:
            raise UsageError(f"world: {flat[0]}: nobody can walk in it: take the scene room")
        self.scenes = [
            scene if median_radiance is None else _brought_to(scene, median_radiance)
            for scene in scenes
        ]

    def _check_path(self, scenes: Sequence[Scene]) -> None:
        """UsageError for a path that is not the only motion, or leaves a room."""
        b = self.behaviour
        if b.path is None:
            return
        if any((b.turn_deg_s, b.swing_deg, b.nod_deg, b.roll_deg, b.walk_m)):
            raise UsageError(
                f"world: {b.path.name}: the path is all of the motion: leave out what turns, "
                "swings, nods, rolls or walks"
            )
        for room in (scene for scene in scenes if isinstance(scene, Walkable)):
            outside = np.flatnonzero(~room.contains(b.path.places_m))
            if len(outside):
                t_s, place_m = b.path.t_s[outside[0]], b.path.places_m[outside[0]].tolist()
                raise UsageError(
                    f"world: {b.path.name}: {t_s:.6g} s after its start the probe would be outside "
                    f"the walls of {room.name}, at {', '.join(f'{x:.3g}' for x in place_m)} m: "
                    "scale the path, or take a panorama, in which nobody leaves their place"
                )

    def at(self, t_s: float, exposure_s: float = 0.0) -> State:
        """State during the exposure that starts `t_s` seconds after the start.

        Flicker is averaged over the exposure; scenes and lamps are as at its start.
        """
        b = self.behaviour
        act, scene = self._act(t_s)
        place_m = self._place_m(t_s + exposure_s / 2) if isinstance(scene, Walkable) else _HERE
        if isinstance(scene, Walkable) and b.is_going:
            scene = scene.seen_from(place_m)
        movers = b.movers.at(t_s + exposure_s / 2)
        if self.card is not None:
            movers = (*movers, self.card)
        smear_deg = 0.0
        if exposure_s:
            smear_deg = way_deg(self.rotation(t_s + exposure_s * np.linspace(0, 1, _WAY_PARTS + 1)))
        return State(
            t_s, act, scene, self.rotation(t_s + exposure_s / 2),
            self._powers(scene, t_s, exposure_s), exposure_s, smear_deg,
            place_m, b.cover_from_s <= t_s < b.cover_to_s, movers,
        )  # fmt: skip

    def _act(self, t_s: float) -> tuple[int, Scene]:
        """Number of the scene at a time, and the scene."""
        act_s = self.behaviour.act_s
        act = int(t_s // act_s) % len(self.scenes) if act_s > 0 else 0
        act = act if self.kept is None else self.kept
        return act, self.scenes[act]

    def rotation(self, t_s: ArrayLike) -> Array:
        """How the probe is turned (…, 4) at times (…), camera to scene; see :mod:`motion`."""
        b, t = self.behaviour, np.asarray(t_s, dtype=np.float64)
        if b.path:
            return b.path.rotation(t)
        return turned(
            b.turn_deg_s * t + b.swing_deg * np.sin(2 * np.pi * b.swing_hz * t),
            b.nod_deg * np.sin(2 * np.pi * b.nod_hz * t),
            b.roll_deg * np.sin(2 * np.pi * b.roll_hz * t),
        )

    def _place_m(self, t_s: float) -> tuple[float, float, float]:
        b = self.behaviour
        if b.path:
            x, y, z = b.path.place_m(t_s).tolist()
            return (x, y, z)
        if not b.walk_m:
            return _HERE
        way_m = b.walk_m * float(np.sin(b.walk_m_s / b.walk_m * t_s))
        return (_WALK[0] * way_m, _WALK[1] * way_m, _WALK[2] * way_m)

    def rows(self, state: State, starts_s: Array, exposure_s: float) -> Rows:
        """What each row of a picture saw whose middle row saw `state`.

        `starts_s` (H,): seconds from the start of the middle row's exposure to that of each row's.
        """
        t_s = state.t_s + starts_s
        of_rows = self.rotation(t_s + exposure_s / 2)
        middle = self.rotation(state.t_s + exposure_s / 2)
        return Rows(
            geometry.turn_after(of_rows, geometry.inverse(middle)),
            self._powers(state.scene, t_s, exposure_s),
        )

    def _powers(self, scene: Scene, t_s: ArrayLike, exposure_s: float) -> Array:
        """Powers (…, lamps) during exposures that start at `t_s` (…)."""
        b, count = self.behaviour, len(scene.lamps)
        powers = b.flicker.powers(count, t_s, exposure_s)
        # Slot 0 leaves every lamp on, then each has its turn to be off; one lamp is never off.
        if b.switch_s > 0 and count > 1:
            slot = (np.asarray(t_s) // b.switch_s).astype(int) % (count + 1)
            powers = np.where(slot[..., None] == np.arange(1, count + 1), 0.0, powers)
        return powers


class ChangingWorld(World):
    """One scene that a test exchanges while time goes on; each exchange begins a new act."""

    has_new_scenes = True

    def __init__(self, scene: Scene, behaviour: Behaviour | None = None) -> None:
        """`behaviour`: its acts do not count."""
        super().__init__([scene], behaviour)
        self._now = (0, scene)

    @property
    def scene(self) -> Scene:
        """What is shown now."""
        return self._now[1]

    @scene.setter
    def scene(self, scene: Scene) -> None:
        """Show another scene from the next exposure on; from any thread."""
        self._now = (self._now[0] + 1, scene)

    def _act(self, t_s: float) -> tuple[int, Scene]:
        return self._now


def _brought_to(scene: Scene, median_radiance: float) -> Scene:
    radiance = scene.render(*_PREVIEW_PX).compose(np.ones(len(scene.lamps)))
    median = median_luminance(radiance)
    return scene.scaled(median_radiance / median) if median > 0 else scene
