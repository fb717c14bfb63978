"""What a lens sees of a world: radiance at the sensor, before it is one.

In steps: the scene's light in its own frame (:meth:`View._compose`); turned and through the lens
(:meth:`View._through_lens`, or :meth:`View._rolled`), the mean over the exposure; through the film
(:meth:`View._behind_film`). :class:`lightprobe.sim.camera.SimulatedCamera` has the sensor.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from lightprobe import geometry
from lightprobe.geometry import Array
from lightprobe.imaging.camera import Camera
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.polarizer import Polarizer
from lightprobe.sim import spread
from lightprobe.sim.motion import level_yaw_deg, turned
from lightprobe.sim.moved import Canvas
from lightprobe.sim.rays import Rays, evened, padded, rolled, smeared
from lightprobe.sim.scene import Layers
from lightprobe.sim.world import Rows, State, World

#: Radiance (H, W, 3), and S1, S2 (2, H, W, 3) or None for unpolarized light.
Composed = tuple[NDArray[np.float32], NDArray[np.float32] | None]

#: Pictures that are looked up, not rolled, are the mean of moments so many pixels apart.
_SMEAR_STEP_PX, _MOST_SMEAR_STEPS = 2, 16


class View:
    """A world through a lens, turned, smeared, row by row, and through a polarizer."""

    def __init__(
        self,
        world: World,
        lens: Camera,
        size_px: tuple[int, int],
        sheet: Sheet | None = None,
        stack_deg: Sequence[float] = (),
        seen_turned: bool = False,
    ) -> None:
        """`size_px` (width, height); `sheet`, `stack_deg`: as of :class:`SimulatedCamera`.

        `seen_turned`: what comes after it wants pictures turned.
        """
        self._world, self._size_px, self._sheet = world, size_px, sheet
        self._seen_turned = seen_turned
        # Equirectangular pictures that turn about the vertical alone turn by whole pixels. When
        # they tilt, too, they are looked up in a map like them: a point of light is then seen by as
        # many pixels wherever it comes to lie. Lenses look into a map finer than the picture, which
        # is blurred as they and their pixels do.
        simple = lens.is_whole and world.behaviour.is_level
        self._pitch_rad = 0.0 if lens.is_whole else spread.pitch_rad(lens, size_px)
        self._map_px = size_px if lens.is_whole else spread.map_px(lens, size_px)
        lookups_px = (0.0,) if lens.is_whole else spread.LOOKUPS_PX
        self._rays = None if simple else Rays(lens, size_px, self._map_px, lookups_px)
        # All of it now: a camera does not pause when the scene changes.
        self._layers = [scene.render(*self._map_px) for scene in world.scenes]
        polarized = not all(layers.unpolarized for layers in self._layers)
        seen = polarized or len(stack_deg) > 0 or (sheet is not None and sheet.index > 1)
        self._polarizer = Polarizer(sheet, lens, size_px) if sheet and seen else None
        self._stack_deg = tuple(stack_deg)
        self._composed: tuple[Hashable, Composed] | None = None
        self._canvas = Canvas()  # what moves before the map
        self._looked_into: tuple[Composed, Composed] | None = None  # composed, and framed
        self._walked: tuple[Hashable, Layers] | None = None

    @property
    def gain(self) -> float:
        """Share of unpolarized light that reaches the lens, on its axis."""
        if self._polarizer is not None and self._stack_deg:
            grey = np.ones((self._size_px[1], self._size_px[0], 1), np.float32)
            behind = self._polarizer.through_stack(grey, None, self._stack_deg)
            return float(behind[self._size_px[1] // 2, self._size_px[0] // 2, 0])
        return self._sheet.unpolarized_gain if self._sheet else 1.0

    def lit(self, state: State) -> NDArray[np.float32]:
        """Radiance of a scene in its own frame, all lamps at full power, as the world starts."""
        new = self._world.has_new_scenes
        layers = self.layers_of(state) if new else self._layers[state.act]
        return layers.compose(np.ones(len(layers.lamps)))

    def true_rotation(self, state: State) -> Array:
        """Rotation of the picture, camera to scene: rolled ones turn by whole pixels."""
        if not self.rolls:
            return state.rotation
        return turned(self._turn_px(state) * 360 / self._size_px[0])

    def key(self, state: State, wheel_deg: tuple[float, ...], rows: Rows | None) -> Hashable:
        """All that shapes :meth:`radiance`."""
        way: Hashable = self._moments(state).tobytes()
        if self.rolls:
            turn_px = self._turn_px(state) if self.turns_first(state) else None
            way = (self.smear_px(state), turn_px)
        by_row = None if rows is None else rows.turned.tobytes()
        return (
            state.act, state.place_m, state.powers.tobytes(), state.movers, way,
            None if rows is None else rows.powers.tobytes(),
            by_row if self.turns_first(state) else None,
            wheel_deg if self.through_film(state) else None,
        )  # fmt: skip

    # ------------------------------------------------------------ all steps

    def radiance(
        self, state: State, wheel_deg: tuple[float, ...], rows: Rows | None
    ) -> NDArray[np.float32]:
        """Radiance (H, W, 3) at the sensor, mean over the exposure; see :meth:`turns_first`."""
        composed = self._compose(state, rows)
        if self.rolls:
            seen = self._rolled(composed, state, rows)
        else:
            seen = self._through_lens(composed, state, rows)
        return self._behind_film(*seen, wheel_deg)

    # ------------------------------------------------------------ the scene, in its own frame

    def layers_of(self, state: State) -> Layers:
        """Maps of the scene from where the probe is; while it goes only the last are kept."""
        if not (self._world.behaviour.is_going or self._world.has_new_scenes):
            return self._layers[state.act]
        key = (state.act, state.place_m)
        if self._walked is None or self._walked[0] != key:
            self._walked = (key, state.scene.render(*self._map_px))
        return self._walked[1]

    def _compose(self, state: State, rows: Rows | None) -> Composed:
        """Light of the whole sphere, unturned; the last one of equal rows is kept.

        Rows of rolled pictures are those of the map; for others see :meth:`_through_lens`.
        """
        by_row = rows is not None and self.rolls
        powers = rows.powers if rows is not None and by_row else state.powers
        key = (state.act, state.place_m, powers.tobytes())
        if self._composed is None or self._composed[0] != key:
            layers, polarized = self.layers_of(state), None
            if self.through_film(state) and not layers.unpolarized:
                polarized = self._softened(layers.compose_polarized(powers))
            (radiance,) = self._softened(layers.compose(powers)[None])
            self._composed = (key, (radiance, polarized))
        clean = self._composed[1]
        return self._canvas.show(*clean, state) if state.movers else clean

    def _softened(self, maps: NDArray[np.float32]) -> NDArray[np.float32]:
        """Blur maps (N, H, W, 3) that lenses look into as these do; before anything moves there."""
        if not self._pitch_rad:
            return maps
        return np.stack([spread.spread(one, self._pitch_rad) for one in maps])

    # ------------------------------------------------------------ turned, by whole columns

    @property
    def rolls(self) -> bool:
        """Tell whether pictures are maps turned by whole columns, and not looked up by rays."""
        return self._rays is None

    def turns_first(self, state: State) -> bool:
        """Tell whether :meth:`radiance` is turned already.

        What a film or a lens with defects sees must be.
        """
        return not self.rolls or self._seen_turned or self.through_film(state)

    def turn_px(self, state: State) -> int:
        """Columns by which what :meth:`radiance` gave is to be rolled to the right."""
        return 0 if self.turns_first(state) else self._turn_px(state)

    def turned(
        self, radiance: NDArray[np.float32], state: State, rows: Rows | None
    ) -> NDArray[np.float32]:
        """Turn what :meth:`radiance` gave, unless it is."""
        if self.turns_first(state):
            return radiance.astype("<f4")
        return rolled(radiance, self._columns(state, rows)).astype("<f4")

    def shift_px(self, state: State, rows: Rows) -> NDArray[np.int64]:
        """Columns (H,) by which each row is turned more than the middle one."""
        return self._columns(state, rows) - self._turn_px(state)

    def smear_px(self, state: State) -> int:
        """Columns of an equirectangular picture over which a point wanders; 1: it does not."""
        return 2 * round(state.smear_deg / 720 * self._size_px[0]) + 1

    def _turn_px(self, state: State) -> int:
        return round(float(level_yaw_deg(state.rotation)) % 360 / 360 * self._size_px[0])

    def _columns(self, state: State, rows: Rows | None) -> NDArray[np.int64]:
        """Columns (H,), or (1,), by which rows of the picture are turned to the right."""
        if rows is None:
            return np.array([self._turn_px(state)])
        yaw_deg = level_yaw_deg(state.rotation) % 360 + level_yaw_deg(rows.turned)
        return np.rint(yaw_deg / 360 * self._size_px[0]).astype(np.int64)

    def _rolled(self, composed: Composed, state: State, rows: Rows | None) -> Composed:
        """Smeared over columns; and turned, where a film is to see it.

        The mean of turned columns is that of columns, turned.
        """
        smear_px, (whole, polarized) = self.smear_px(state), composed
        radiance = smeared(whole, smear_px)
        if not self.turns_first(state):
            return radiance, None
        columns = self._columns(state, rows)
        parts = None
        if polarized is not None:
            parts = np.stack([rolled(smeared(part, smear_px), columns) for part in polarized])
        return rolled(radiance, columns), parts

    # ------------------------------------------------------------ turned, by rays

    def _moments(self, state: State) -> Array:
        """Rotations (N, 4) at moments, evenly over the exposure, whose mean a picture is."""
        steps = min(math.ceil(self.smear_px(state) / _SMEAR_STEP_PX), _MOST_SMEAR_STEPS)
        parts = (np.arange(steps) + 0.5) / steps
        return self._world.rotation(state.t_s + parts * state.exposure_s)

    def _through_lens(self, composed: Composed, state: State, rows: Rows | None) -> Composed:
        """What the lenses see of a map, each row turned by itself, and with its own lamps."""
        assert self._rays is not None
        if self._looked_into is None or self._looked_into[0] is not composed:
            self._looked_into = (composed, self._framed(*composed))
        whole, polarized = self._looked_into[1]
        lights = [] if rows is None else self._by_row(polarized is not None, state, rows)
        seen = np.zeros((self._size_px[1], self._size_px[0], 3), np.float32)
        parts = None if polarized is None else np.zeros((2, *seen.shape), np.float32)
        moments = self._moments(state)
        for moment in moments:
            rotations = moment[None] if rows is None else geometry.turn_after(rows.turned, moment)
            places = self._rays.turned(rotations)
            cv2.accumulate(places.sample(whole), seen)
            if parts is not None and polarized is not None:
                parts += places.sample_polarized(polarized)
            for share, s0, s12 in lights:
                seen += share * places.sample(s0)
                if parts is not None and s12 is not None:
                    parts += share * places.sample_polarized(s12)
        for total in () if parts is None else parts:
            total /= np.float32(len(moments))
        return np.divide(seen, np.float32(len(moments)), out=seen), parts

    def _framed(
        self, radiance: NDArray[np.float32], polarized: NDArray[np.float32] | None
    ) -> Composed:
        """Make maps ready to be looked up; those that are as coarse as the picture are evened."""
        even = evened if self._map_px == self._size_px else np.asarray
        parts = None
        if polarized is not None:
            parts = np.stack([padded(even(part)) for part in polarized])
        return padded(even(radiance)), parts

    def _by_row(
        self, with_polarized: bool, state: State, rows: Rows
    ) -> list[tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32] | None]]:
        """What lamps add to rows that saw them at another power than the middle one.

        Share of each row (H, 1, 1), and framed maps of what it is a share of.
        """
        if np.all(rows.powers == state.powers):
            return []
        layers, found = self.layers_of(state), []
        for k, more in enumerate((rows.powers - state.powers).T):
            alone = (np.arange(len(state.powers)) == k).astype(np.float32)
            polarized = None
            if with_polarized and layers.lamps[k].polarized is not None:
                polarized = layers.compose_polarized(alone) - layers.compose_polarized(0 * alone)
                polarized = self._softened(polarized)
            share = more.astype(np.float32)[:, None, None]
            (lamp,) = self._softened(layers.compose_lamps(alone)[None])
            if state.movers:
                lamp = self._canvas.hide(lamp)
                if polarized is not None:
                    polarized = np.stack([self._canvas.hide(part) for part in polarized])
            found.append((share, *self._framed(lamp, polarized)))
        return found

    # ------------------------------------------------------------ the film

    def through_film(self, state: State) -> bool:
        """Tell whether a film does more to the picture than to dim it all alike."""
        if self._polarizer is None:
            return False
        ideal = self._polarizer.sheet.index == 1 and not self._stack_deg
        return not (ideal and self.layers_of(state).unpolarized)

    def sees_wheel(self, state: State) -> bool:
        """Tell whether the wheel's angle shapes the picture.

        Where an ideal film sees nothing that is polarized it does not.
        """
        return self.through_film(state) and not self._stack_deg

    def _behind_film(
        self,
        radiance: NDArray[np.float32],
        polarized: NDArray[np.float32] | None,
        wheel_deg: tuple[float, ...],
    ) -> NDArray[np.float32]:
        if self._polarizer is not None and self._stack_deg:
            return self._polarizer.through_stack(radiance, polarized, self._stack_deg)
        if self._polarizer is not None:
            return self._polarizer.through(radiance, polarized, wheel_deg)
        return radiance if self._sheet is None else np.float32(self.gain) * radiance
