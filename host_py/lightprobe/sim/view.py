"""What a lens sees of a world: radiance at the sensor, before it is one.

In steps: the scene's light in its own frame (:meth:`View._compose`), turned and through the lens
(:meth:`View._through_lens`, or rolled), through the film.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightprobe.errors import UsageError
from lightprobe.imaging.camera import Camera
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.polarizer import Polarizer
from lightprobe.sim.rays import Rays, rolled, smeared
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
    ) -> None:
        """`size_px` (width, height); `sheet`, `stack_deg`: as of :class:`SimulatedCamera`."""
        self._world, self._size_px, self._sheet = world, size_px, sheet
        # Equirectangular pictures turn by whole pixels, unless they nod. What is not simply turned
        # is looked up in a map finer than the picture.
        simple = lens.is_whole and not world.behaviour.nod_deg
        self._map_px = size_px if simple else (2 * size_px[0], size_px[0])
        self._rays = None if simple else Rays(lens, size_px, self._map_px)
        # All of it now: a camera does not pause when the scene changes.
        self._layers = [scene.render(*self._map_px) for scene in world.scenes]
        polarized = not all(layers.unpolarized for layers in self._layers)
        if sheet and polarized and world.behaviour.nod_deg:
            raise UsageError("camera: polarized light cannot be simulated while the camera nods")
        seen = polarized or len(stack_deg) > 0 or (sheet is not None and sheet.index > 1)
        self._polarizer = Polarizer(sheet, lens, size_px) if sheet and seen else None
        self._stack_deg = tuple(stack_deg)
        self._composed: tuple[Hashable, Composed] | None = None
        self._walked: tuple[Hashable, Layers] | None = None

    @property
    def gain(self) -> float:
        """Share of unpolarized light that reaches the lens, on its axis."""
        if self._polarizer is not None and self._stack_deg:
            grey = np.ones((self._size_px[1], self._size_px[0], 1), np.float32)
            behind = self._polarizer.through_stack(grey, None, self._stack_deg)
            return float(behind[self._size_px[1] // 2, self._size_px[0] // 2, 0])
        return self._sheet.unpolarized_gain if self._sheet else 1.0

    @property
    def rolls(self) -> bool:
        """Tell whether pictures are maps turned by whole columns, and not looked up by rays."""
        return self._rays is None

    def lit(self, act: int) -> NDArray[np.float32]:
        """Radiance of a scene in its own frame, all lamps at full power, as the world starts."""
        layers = self._layers[act]
        return layers.compose(np.ones(len(layers.lamps)))

    def true_yaw_deg(self, state: State) -> float:
        """Yaw of the picture: equirectangular ones turn by whole pixels."""
        if self._rays is not None:
            return state.yaw_deg
        return round(state.yaw_deg / 360 * self._size_px[0]) * 360 / self._size_px[0]

    def turn_px(self, state: State) -> int:
        """Columns by which the picture is rolled to the right."""
        return 0 if self._rays else round(state.yaw_deg / 360 * self._size_px[0])

    def shift_px(self, state: State, rows: Rows) -> NDArray[np.int64]:
        """Columns (H,) by which each row is turned more than the middle one."""
        turn_px = np.rint((state.yaw_deg + rows.offset_deg) / 360 * self._size_px[0])
        return np.asarray(turn_px.astype(np.int64) - self.turn_px(state))

    def layers_of(self, state: State) -> Layers:
        """Maps of the scene from where the probe is; while it walks only the last are kept."""
        if not self._world.behaviour.walk_m:
            return self._layers[state.act]
        key = (state.act, state.place_m)
        if self._walked is None or self._walked[0] != key:
            self._walked = (key, state.scene.render(*self._map_px))
        return self._walked[1]

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

    def turns_first(self, state: State) -> bool:
        """Tell whether :meth:`radiance` is turned already: what the polarizer sees must be."""
        return self._rays is not None or self.through_film(state)

    def _compose(self, state: State, rows: Rows | None) -> Composed:
        """Light of the whole sphere, unturned; the last one of equal rows is kept.

        Rows of equirectangular pictures are those of the map; for others see :class:`Rays`.
        """
        by_row = rows is not None and self._rays is None
        powers = rows.powers if rows is not None and by_row else state.powers
        key = (state.act, state.place_m, powers.tobytes())
        if self._composed is None or self._composed[0] != key:
            layers, polarized = self.layers_of(state), None
            if self.through_film(state) and not layers.unpolarized:
                polarized = layers.compose_polarized(powers)
            self._composed = (key, (layers.compose(powers), polarized))
        return self._composed[1]

    def smear_px(self, state: State) -> int:
        """Columns of an equirectangular picture over which a point wanders; 1: it does not."""
        return 2 * round(state.smear_deg / 720 * self._size_px[0]) + 1

    def radiance(
        self, state: State, wheel_deg: tuple[float, ...], rows: Rows | None
    ) -> NDArray[np.float32]:
        """Radiance (H, W, 3) at the sensor, mean over the exposure; see :meth:`turns_first`."""
        smear_px = self.smear_px(state)
        if self._rays is None:  # the mean of turned columns is that of columns, turned
            return self._still(state, wheel_deg, rows, smear_px)
        nod_px = abs(state.nod_smear_deg) / 360 * self._size_px[0]
        steps = min(math.ceil(max(smear_px, nod_px) / _SMEAR_STEP_PX), _MOST_SMEAR_STEPS)
        total = np.zeros((self._size_px[1], self._size_px[0], 3), np.float32)
        for k in range(steps):
            part = (k + 0.5) / steps - 0.5
            yaw_deg = state.yaw_deg + part * state.smear_deg
            nod_deg = state.nod_deg + part * state.nod_smear_deg
            moment = replace(state, yaw_deg=yaw_deg, nod_deg=nod_deg)
            total += self._still(moment, wheel_deg, rows)
        return total / np.float32(steps)

    def _still(
        self, state: State, wheel_deg: tuple[float, ...], rows: Rows | None, smear_px: int = 1
    ) -> NDArray[np.float32]:
        """Radiance (H, W, 3) at one moment; turned when :meth:`turns_first`.

        `smear_px`: of equirectangular pictures the mean over so many columns, an odd number.
        """
        radiance, polarized = self._compose(state, rows)
        if self._rays is not None:
            radiance, polarized = self._through_lens(radiance, polarized, state, rows)
        else:
            radiance = smeared(radiance, smear_px)
        if self._rays is None and self.through_film(state):
            turn_px = self.turn_px(state)
            shift_px = np.zeros(1, np.int64) if rows is None else self.shift_px(state, rows)
            radiance = rolled(radiance, turn_px + shift_px)
            parts = () if polarized is None else polarized
            turned = [rolled(smeared(part, smear_px), turn_px + shift_px) for part in parts]
            polarized = np.stack(turned) if turned else None
        if self._polarizer is not None and self._stack_deg:
            return self._polarizer.through_stack(radiance, polarized, self._stack_deg)
        if self._polarizer is not None:
            return self._polarizer.through(radiance, polarized, wheel_deg)
        return radiance if self._sheet is None else np.float32(self.gain) * radiance

    def _through_lens(
        self,
        radiance: NDArray[np.float32],
        polarized: NDArray[np.float32] | None,
        state: State,
        rows: Rows | None,
    ) -> Composed:
        """What the lenses see of a map, each row at its own yaw and with its own lamps."""
        assert self._rays is not None
        rays, still = self._rays, np.zeros(1)
        yaw_deg = state.yaw_deg + (still if rows is None else rows.offset_deg)
        places = rays.turned(state.nod_deg + (still if rows is None else rows.nod_offset_deg))
        seen = places.sample(radiance, yaw_deg)
        parts = None
        if polarized is not None:
            parts = np.stack([places.sample(part, yaw_deg) for part in polarized])
        if rows is None or np.all(rows.powers == state.powers):
            return seen, parts
        layers = self.layers_of(state)
        for k, more in enumerate((rows.powers - state.powers).T):
            alone = (np.arange(len(state.powers)) == k).astype(np.float32)
            by_row = more.astype(np.float32)[:, None, None]
            seen += by_row * places.sample(layers.compose_lamps(alone), yaw_deg)
            if parts is not None and layers.lamps[k].polarized is not None:
                lamp = layers.compose_polarized(alone) - layers.compose_polarized(0 * alone)
                parts += by_row * np.stack([places.sample(part, yaw_deg) for part in lamp])
        return seen, parts

    def turned(
        self, radiance: NDArray[np.float32], state: State, rows: Rows | None
    ) -> NDArray[np.float32]:
        """Turn what :meth:`radiance` gave, unless it is."""
        if self.turns_first(state):
            return radiance.astype("<f4")
        shift_px = np.zeros(1, np.int64) if rows is None else self.shift_px(state, rows)
        return rolled(radiance, self.turn_px(state) + shift_px).astype("<f4")
