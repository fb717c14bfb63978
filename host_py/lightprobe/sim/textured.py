"""A plain room whose walls are not quite plain: what a camera needs to see that it stands still."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightprobe import geometry
from lightprobe.geometry import Array
from lightprobe.lamp import Lamp
from lightprobe.sim.scene import Layers, MapTruth, disc_layer, lit_lamps

#: Size of the map that truth is summed over.
_TRUTH_PX = (256, 128)
#: The pattern: so many waves, of so many radians per radian at most, in patches of even radiance.
_WAVES, _FINEST, _LEVELS, _SEED = 24, 14.0, 5, 0x7E57
#: Radiance of the darkest patch, relative to the mean; the brightest is as much above it.
_DARKEST = 0.6


@dataclass(frozen=True, eq=False)
class TexturedScene:
    """Disc lamps before patches of slightly different radiance."""

    name: str
    ambient: Array  # (3,) mean radiance of the patches
    lamps: tuple[Lamp, ...]

    def render(self, width_px: int, height_px: int) -> Layers:
        """See :class:`lightprobe.sim.scene.Scene`."""
        directions = geometry.equirect_directions(width_px, height_px)
        base = (pattern(directions)[..., None] * self.ambient).astype(np.float32)
        return Layers(base, tuple(disc_layer(one, width_px, height_px) for one in self.lamps))

    def scaled(self, factor: float) -> TexturedScene:
        """See :class:`lightprobe.sim.scene.Scene`."""
        lamps = tuple(one.scaled(factor) for one in self.lamps)
        return replace(self, ambient=factor * self.ambient, lamps=lamps)

    def truth(self, powers: ArrayLike, rotation: ArrayLike = geometry.UNTURNED) -> MapTruth:
        """Sum over a map."""
        radiance = self.render(*_TRUTH_PX).compose(powers)
        return MapTruth(radiance, rotation, lit_lamps(self.lamps, powers, rotation))


def pattern(directions: Array) -> NDArray[np.float64]:
    """Radiance (…) of the walls in directions (…, 3), relative to their mean; always the same."""
    rng = np.random.default_rng(_SEED)
    vectors = geometry.normalize(rng.normal(size=(_WAVES, 3)))
    vectors *= rng.uniform(3.0, _FINEST, (_WAVES, 1))
    phases = rng.uniform(0, 2 * np.pi, _WAVES)
    total = np.zeros(directions.shape[:-1])
    for vector, phase in zip(vectors, phases, strict=True):
        total += np.cos(directions @ vector + phase)
    spread = np.clip(total / np.sqrt(_WAVES / 2), -1.5, 1.5) / 1.5  # −1…1
    steps = np.round((spread + 1) / 2 * (_LEVELS - 1)) / (_LEVELS - 1)
    return np.asarray(_DARKEST + 2 * (1 - _DARKEST) * steps)
