"""What movers do to a scene's picture, and to the light that is true."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe import geometry, sh
from lightprobe.colour import luminance
from lightprobe.geometry import Array
from lightprobe.lamp import Lamp
from lightprobe.sim.movers import Mover, Patch
from lightprobe.sim.scene import ORDER, Layers, Scene, Truth, disc_layer

if TYPE_CHECKING:
    from lightprobe.sim.world import State

#: Map that the light of a scene on its movers is summed over, and that their own is summed over.
_LIGHT_PX, _TRUTH_PX = (256, 128), (1024, 512)
#: Pixels whose light is summed together, in squares: all of a square changes by one sign, mostly.
_BLOCK_PX = 4
#: A lamp of which so little is seen is hidden.
_HIDDEN = 1e-3


def patches(
    movers: tuple[Mover, ...], size_px: tuple[int, int], scene: Scene, powers: ArrayLike
) -> list[Patch]:
    """Draw movers, the farthest first, as the scene lights them with its lamps at `powers`."""
    if not movers:
        return []
    parts = _light(scene)
    scene_sh = np.tensordot(np.concatenate([[1.0], np.asarray(powers, float)]), parts, 1)
    return [mover.patch(size_px, scene_sh) for mover in movers]


@lru_cache(maxsize=8)
def _light(scene: Scene) -> Array:
    """SH (1 + lamps, 9, 3) of the radiance of a scene's base and of each lamp."""
    layers = scene.render(*_LIGHT_PX)
    dark = np.zeros(len(layers.lamps))
    alone = [layers.compose_lamps(dark + (np.arange(len(dark)) == k)) for k in range(len(dark))]
    return np.stack([sh.project(part, 2) for part in (layers.base, *alone)])


def hidden(radiance: NDArray[np.float32], laid: list[Patch]) -> NDArray[np.float32]:
    """Give what is left of a map (H, W, C) behind patches, in place."""
    for patch in laid:
        patch.hide(radiance)
    return radiance


class Canvas:
    """A map with movers before it; only what they cover or leave is drawn again."""

    def __init__(self) -> None:
        """Show nothing."""
        self._clean: NDArray[np.float32] | None = None
        self._drawn = np.zeros((0, 0, 0), np.float32)
        self._movers: tuple[Mover, ...] = ()
        self._laid: list[Patch] = []

    def show(
        self, clean: NDArray[np.float32], stokes: NDArray[np.float32] | None, state: State
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Give a map (H, W, 3) and its S1 and S2 (2, H, W, 3) behind the movers of a state.

        The map stays as it is until the next call.
        """
        if not state.movers:
            return clean, stokes
        if clean is not self._clean or state.movers != self._movers:
            self._draw(clean, state)
        if stokes is not None:
            stokes = np.stack([hidden(part.copy(), self._laid) for part in stokes])
        return self._drawn, stokes

    def hide(self, radiance: NDArray[np.float32]) -> NDArray[np.float32]:
        """Give what is left of another map behind the movers that were shown last, in place."""
        return hidden(radiance, self._laid)

    def _draw(self, clean: NDArray[np.float32], state: State) -> None:
        height, width, _ = clean.shape
        if clean is not self._clean:
            self._clean, self._drawn = clean, clean.copy()
        else:
            for old in self._laid:
                self._drawn[old.rows, old.window.columns] = clean[old.rows, old.window.columns]
        self._movers = state.movers
        self._laid = patches(state.movers, (width, height), state.scene, state.powers)
        for new in self._laid:
            new.lay(self._drawn)


@dataclass(frozen=True, eq=False)
class Change:
    """How movers change a scene's light, in the scene's frame."""

    directions: Array  # (N, 3)
    light: Array  # (N, 3): radiance times solid angle that comes from there, more than without
    shares: Array  # (lamps,) of each lamp that is seen beside them

    def irradiance(self, normals: ArrayLike) -> Array:
        """Irradiance (M, 3) on surfaces, more than without movers."""
        n = np.asarray(normals, dtype=np.float64)
        return np.asarray(np.maximum(n @ self.directions.T, 0) @ self.light)

    @cached_property
    def total(self) -> Array:
        """SH ((ORDER+1)², 3), more than without movers."""
        return np.asarray(sh.evaluate(ORDER, self.directions).T @ self.light)

    def dimmed(self, lamps: tuple[Lamp, ...], powers: Array) -> tuple[Lamp, ...]:
        """Give what is seen of those of the scene's lamps that are on: whose `powers` are not 0."""
        shares = self.shares[np.asarray(powers) > 0]
        return tuple(
            lamp.scaled(share) for lamp, share in zip(lamps, shares, strict=True) if share > _HIDDEN
        )


def change(movers: tuple[Mover, ...], scene: Scene, powers: ArrayLike) -> Change:
    """Sum up what movers hide and shine themselves, with the scene's lamps at `powers`."""
    width_px, height_px = _TRUTH_PX
    laid = patches(movers, _TRUTH_PX, scene, powers)
    before = _layers(scene).compose(powers)
    after, keep = before.copy(), np.ones((height_px, width_px, 1), np.float32)
    for patch in laid:
        patch.lay(after)
    hidden(keep, laid)
    solid_angle = np.repeat(geometry.equirect_solid_angles(width_px, height_px), width_px)
    differs = np.flatnonzero((after != before).any(axis=-1))
    more = (after.reshape(-1, 3)[differs] - before.reshape(-1, 3)[differs]).astype(np.float64)
    light = more * solid_angle[differs, None]
    seen = []
    for lamp in scene.lamps:
        disc = disc_layer(lamp, width_px, height_px)
        weight = disc.values[:, 1] * solid_angle[disc.index]
        seen.append(float(weight @ keep.reshape(-1)[disc.index] / weight.sum()))
    return Change(*_blocks(differs, light), np.minimum(np.array(seen), 1.0))


@lru_cache(maxsize=2)
def _layers(scene: Scene) -> Layers:
    return scene.render(*_TRUTH_PX)


def _blocks(index: NDArray[np.intp], light: Array) -> tuple[Array, Array]:
    """Take light (N, 3) of pixels together, each block from the middle of its change."""
    width_px, _ = _TRUTH_PX
    rows, columns = np.divmod(index, width_px)
    where = rows // _BLOCK_PX * (width_px // _BLOCK_PX) + columns // _BLOCK_PX
    _, block = np.unique(where, return_inverse=True)
    weight = np.maximum(np.abs(luminance(light)), 1e-12)
    directions = geometry.equirect_direction(columns, rows, *_TRUTH_PX)
    middle = np.stack([np.bincount(block, weight * axis) for axis in directions.T], axis=-1)
    summed = np.stack([np.bincount(block, channel) for channel in light.T], axis=-1)
    return geometry.normalize(middle), np.asarray(summed, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class MovedTruth:
    """A scene's truth with movers before it, turned as the scene is."""

    still: Truth  # without them
    change: Change
    turn: Array  # of the scene, a quaternion w, x, y, z
    powers: Array  # of the scene's lamps

    @property
    def lamps(self) -> tuple[Lamp, ...]:
        """See :class:`lightprobe.sim.scene.Truth`: less bright by what is hidden."""
        return self.change.dimmed(self.still.lamps, self.powers)

    @property
    def total(self) -> Array:
        """See :class:`lightprobe.sim.scene.Truth`."""
        return self.still.total + sh.rotate(self.change.total, self.turn)

    def irradiance(self, normals: ArrayLike) -> Array:
        """See :class:`lightprobe.sim.scene.Truth`."""
        n = np.asarray(normals, dtype=np.float64)
        in_scene = n @ geometry.rotation_matrix(self.turn)
        return self.still.irradiance(n) + self.change.irradiance(in_scene)
