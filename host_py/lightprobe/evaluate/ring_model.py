"""The ring beside a simulated camera: what it reads of a scene, and how well it is known."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lightprobe.calibrate import ring, ring_fit
from lightprobe.colour import luminance
from lightprobe.evaluate import offline
from lightprobe.geometry import Array
from lightprobe.sim import illuminance, ldr
from lightprobe.sim.colour_sensor import ColourSensors
from lightprobe.sim.scene import Scene

#: Luminance of radiance 1 in front of a simulated ring; any number would do.
CD_M2_PER_UNIT = 150.0
#: What the sensors are.
IDEAL, CALIBRATED, UNCALIBRATED, COLOUR = PARTS = (
    "ideal", "calibrated", "uncalibrated", "colour",
)  # fmt: skip
#: As hw/guide.md has a ring calibrated, and how well its owner sets the light.
GUIDE_LUX = (10.0, 100.0, 1000.0, 20_000.0)
GUIDE_SIGMA = 0.03
#: What a colour sensor's luminance is off, relative, by seat, gain and overlap of its colours.
COLOUR_SIGMA = 0.04
#: The last hour was so many decades darker or brighter than now, at most.
_RESTED_DECADES = 1.0


@dataclass(frozen=True)
class RingModel:
    """The ring of a simulated box, beside its camera.

    `parts`: `ideal` sensors have noise of `sigma` and no other error. The others are LDRs as they
    come (:mod:`lightprobe.sim.ldr`), either calibrated as the guide says, on another day, or not.
    `colour`: sensors of colour with noise of `sigma` (:mod:`lightprobe.sim.colour_sensor`).
    """

    sigma: float = 0.03  # ideal: relative, of each reading
    scale_sigma: float = 0.02  # relative, of the camera's cd/m² per unit, from calibration
    scale_known: bool = True  # whether that was calibrated at all
    parts: str = IDEAL
    scale_off: float = 0.0  # relative; besides, as nobody knows
    shadowed: int | None = None  # sensor that a hand leaves a fifth of its light
    places_turned: int = 0  # to the right, by 45° each, as nobody knows

    def read(self, scene: Scene, seed: int) -> offline.Settings:
        """Give the daemon's settings for one reading."""
        name = zlib.crc32(scene.name.encode())
        rng = np.random.default_rng([seed, name])
        common, rgb = 0.0, None
        if self.parts == COLOUR:
            sensors = ColourSensors.draw(rng)
            rgb = CD_M2_PER_UNIT * np.maximum(sensors.read(scene, self.sigma, rng), 0)
            # they were calibrated under white light, by a lux meter
            lux = luminance(rgb / np.exp(np.log(sensors.gain).mean(axis=0)))
            sigma = np.full(9, np.hypot(self.sigma, COLOUR_SIGMA))
        elif self.parts == IDEAL:
            true = CD_M2_PER_UNIT * illuminance.on_ring(scene)
            lux, sigma = np.maximum(true * rng.normal(1, self.sigma, 9), 0), np.full(9, self.sigma)
        else:
            lux, sigma, common = self._of_ldrs(scene, rng)
        scale = CD_M2_PER_UNIT * rng.normal(1, self.scale_sigma) * (1 + self.scale_off)
        if self.shadowed is not None:
            lux[self.shadowed] *= 0.2
        lux[:8] = np.roll(lux[:8], -self.places_turned)
        known = np.isfinite(lux) & np.isfinite(sigma)
        return offline.Settings(
            ring_lux=_words(np.where(known, lux, np.nan)),
            ring_sigma=_words(np.clip(np.where(known, sigma, 10), 0.001, 10)),
            ring_rgb=None if rgb is None else _words(rgb.ravel()),
            ring_colour_sigma=None if rgb is None else float(np.hypot(self.sigma, COLOUR_SIGMA)),
            cd_m2_per_unit=scale if self.scale_known else None,
            # all nine being off together looks like another scale
            cd_m2_per_unit_sigma=float(np.hypot(self.scale_sigma, common))
            if self.scale_known
            else None,
        )

    def _of_ldrs(self, scene: Scene, rng: np.random.Generator) -> tuple[Array, Array, float]:
        """Illuminances, their sigmas, and that which they have in common."""
        parts = ldr.Ldrs.draw(rng)
        known = calibrated_by_levels(parts, rng) if self.parts == CALIBRATED else ring.Ring()
        lux = CD_M2_PER_UNIT * illuminance.on_ldrs(scene, parts)
        rested = lux.mean() * 10 ** rng.uniform(-_RESTED_DECADES, _RESTED_DECADES)
        level = parts.level(lux, ldr.indoors_c(rng), rested)
        return known.lux(level), known.sigma_of(level), known.drift_common_sigma


def calibrated_by_levels(parts: ldr.Ldrs, rng: np.random.Generator) -> ring.Ring:
    """Do what `lightprobe calibrate ring --levels` does with these parts, as the guide says."""
    told = np.repeat(np.array(GUIDE_LUX)[:, None], ring.SENSORS, axis=1)
    true = told * np.exp(GUIDE_SIGMA * rng.standard_normal(told.shape))
    return ring_fit.fit(told, parts.level(true, ldr.indoors_c(rng)), GUIDE_SIGMA)


def _words(values: ArrayLike) -> str:
    return ",".join(f"{value:.7g}" for value in np.asarray(values))
