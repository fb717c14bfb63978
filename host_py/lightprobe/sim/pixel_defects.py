"""Pixels of a sensor that are stuck, warm or dead, wherever the camera looks.

They lie in the camera's own pixels: they turn with it. A stuck pixel is at full scale in every
exposure. A warm one has a dark current, so that it grows with the exposure; sensors of today have
some electrons per second at 25 °C, twice as many every 6 K or so. A dead one is black.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lightprobe.geometry import Array
from lightprobe.sim.faults import Spell, fault
from lightprobe.sim.sensor import Codes

#: Warm pixels' dark current is told at this temperature, and doubles every so many degrees.
REFERENCE_C, DOUBLING_C = 25.0, 6.0
#: What demosaicing makes of one pixel's colour: bilinear, red and blue; of green, the plus alone.
_SPREAD = np.array([[0.25, 0.5, 0.25], [0.5, 1, 0.5], [0.25, 0.5, 0.25]])
_SPREAD_GREEN = np.array([[0, 0.25, 0], [0.25, 1, 0.25], [0, 0.25, 0]])


@dataclass(frozen=True)
class PixelDefects(Spell):
    """How many there are; places and colours follow from the seed."""

    _what: ClassVar[str] = "pixel defects"

    stuck: int = fault(0, "pixels at full scale in every exposure", 0, 10**6)
    warm: int = fault(0, "pixels with a dark current", 0, 10**6)
    dead: int = fault(0, "pixels that are black", 0, 10**6)
    row: int = fault(-1, "all pixels of this row are stuck; -1: of none", -1, 10**6)
    warm_e_per_s: float = fault(100000.0, "their dark current at 25 °C, electrons per second")
    celsius: float = fault(REFERENCE_C, "temperature of the sensor", -100, 200)
    bayer: int = fault(
        0, "1: each has one colour of the Bayer pattern, which demosaicing spreads", 0, 1
    )
    from_s: float = fault(0.0, "seconds until they come")
    to_s: float = fault(0.0, "seconds until they are gone; 0: never")
    seed: int = fault(0, "draws their places and colours")

    def __bool__(self) -> bool:
        """Tell whether there are any, ever."""
        return bool(self.stuck or self.warm or self.dead or self.row >= 0)

    @property
    def warm_now_e_per_s(self) -> float:
        """Dark current of a warm pixel at the sensor's temperature."""
        return float(self.warm_e_per_s * 2 ** ((self.celsius - REFERENCE_C) / DOUBLING_C))

    def at(self, size_px: tuple[int, int], full_well_e: float, response: Array) -> PlacedDefects:
        """Place them in pictures (width, height) of a sensor.

        `response`: linear light (256, 3) of each code.
        """
        return PlacedDefects(self, size_px, full_well_e, response)


@dataclass(frozen=True, eq=False)
class PlacedDefects:
    """Defects of a sensor of a size."""

    model: PixelDefects
    size_px: tuple[int, int]
    full_well_e: float
    response: Array = field(repr=False)

    @cached_property
    def places(self) -> NDArray[np.intp]:
        """(n, 2): column and row of each that was drawn: the stuck, the warm, then the dead."""
        model, (width, height) = self.model, self.size_px
        count = min(model.stuck + model.warm + model.dead, width * height)
        drawn = np.random.default_rng([model.seed, 7]).choice(width * height, count, replace=False)
        return np.stack([drawn % width, drawn // width], axis=-1)

    @cached_property
    def _weights(self) -> tuple[_Weights, _Weights, _Weights]:
        """Of stuck, warm and dead ones."""
        model, width = self.model, self.size_px[0]
        kinds = np.split(self.places, np.cumsum([model.stuck, model.warm]))
        if 0 <= model.row < self.size_px[1]:
            row = np.stack([np.arange(width), np.full(width, model.row)], axis=-1)
            kinds[0] = np.concatenate([kinds[0], row])
        stuck, warm, dead = (self._spread(some) for some in kinds)
        return stuck, warm, dead

    def _spread(self, places: NDArray[np.intp]) -> _Weights:
        """How much of each pixel's colours is theirs."""
        width, height = self.size_px
        weights: dict[tuple[int, int], Array] = {}
        for x, y in places.tolist():
            # RGGB: red where both are even, blue where both are odd
            colour = (x % 2 + y % 2) if self.model.bayer else -1
            kernel = _SPREAD_GREEN if colour == 1 else _SPREAD
            for down in (-1, 0, 1):
                for across in (-1, 0, 1):
                    at = ((x + across) % width, y + down)
                    share = kernel[down + 1, across + 1] if colour >= 0 else float(at == (x, y))
                    if share and 0 <= at[1] < height:
                        of = weights.setdefault(at, np.zeros(3))
                        some = slice(None) if colour < 0 else colour
                        of[some] = np.maximum(of[some], share)
        keys = np.array(list(weights), np.intp).reshape(-1, 2)
        return _Weights(keys[:, 0], keys[:, 1], np.array(list(weights.values())).reshape(-1, 3))

    def spoil(self, codes: Codes, exposure_us: float, t_s: float) -> Codes:
        """Put the defects into a frame (H, W, 3), 8 bit, of `t_s` seconds after the start.

        `exposure_us`: times gain.
        """
        if not self.model.is_on(t_s):
            return codes
        spoilt = codes.copy()
        for kind, kept, light in self._kinds(exposure_us):
            own = self._linear(spoilt[kind.y, kind.x])
            spoilt[kind.y, kind.x] = self._codes(kind.mixed(own, kept, light))
        return spoilt

    def spoil_linear(
        self, linear: NDArray[np.float32], exposure_us: float, t_s: float
    ) -> NDArray[np.float32]:
        """Do as :meth:`spoil` to linear light (H, W, 3), full scale = 1, before it is processed."""
        if not self.model.is_on(t_s):
            return linear
        spoilt = linear.copy()
        for kind, kept, light in self._kinds(exposure_us):
            own = spoilt[kind.y, kind.x].astype(np.float64)
            spoilt[kind.y, kind.x] = np.minimum(kind.mixed(own, kept, light), 1)
        return spoilt

    def _kinds(self, exposure_us: float) -> tuple[tuple[_Weights, float, float], ...]:
        """Defects, the share of a pixel's own light that they leave, and light that they add."""
        stuck, warm, dead = self._weights
        current = 1e-6 * exposure_us * self.model.warm_now_e_per_s / self.full_well_e
        return (warm, 1.0, current), (dead, 0.0, 0.0), (stuck, 0.0, 1.0)

    def _linear(self, codes: Codes) -> Array:
        """Linear light (n, 3) of codes (n, 3)."""
        return np.stack([self.response[codes[:, c], c] for c in range(3)], axis=-1)

    def _codes(self, linear: Array) -> Codes:
        some = [np.interp(linear[:, c], self.response[:, c], np.arange(256)) for c in range(3)]
        return np.rint(np.stack(some, axis=-1)).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class _Weights:
    """Pixels, and how much of each of their colours (n, 3) is a defect's."""

    x: NDArray[np.intp]
    y: NDArray[np.intp]
    weights: Array

    def mixed(self, own: Array, kept: float, light: float) -> Array:
        """Light (n, 3) of the pixels, of what they see, `own`."""
        return np.asarray(own * (1 - self.weights * (1 - kept)) + self.weights * light)
