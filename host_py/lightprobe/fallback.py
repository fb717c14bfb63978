"""The light to show while there is none of a probe; the same in every client."""

from __future__ import annotations

import math

import numpy as np

from lightprobe import sh
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, EstimateFlag, SphericalHarmonics

#: Mean radiance before the first estimate: a white surface shows about half of full brightness.
RADIANCE = 0.5
#: How much brighter the upper side is than the middle, as a share.
FROM_ABOVE = 0.4


def mean_irradiance(estimate: Estimate) -> float:
    """Mean of the luminance of E(n) over all normals n: π L for uniform radiance L."""
    flat = sh.evaluate(0, (0, 1, 0))[0]
    ambient = math.pi * flat * luminance(estimate.sh.coefficients[0])
    return float(ambient + sum(luminance(light.irradiance) for light in estimate.beside_sh) / 4)


def fallback_estimate(last: Estimate | None = None) -> Estimate:
    """Give a neutral, soft light from above, for before the first and after the last estimate.

    It is as bright in the mean as `last`, and has no lamps, because nobody knows where they are.
    Its boot_id and sequence are 0, its flag is STALE.
    """
    mean = max(0.0, mean_irradiance(last) / math.pi) if last else RADIANCE
    flat, up = sh.evaluate(1, (0, 1, 0))[:2]
    grey = np.array([mean / flat, FROM_ABOVE * mean / up, 0, 0])
    return Estimate(
        sequence=0,
        boot_id=0,
        capture_time_unix_ns=0,
        send_delay_us=0,
        ttl_ms=0,
        flags=EstimateFlag.STALE,
        lights=(),
        sh=SphericalHarmonics("AMBIENT", 1, np.repeat(grey[:, None], 3, axis=1)),
        predicted_error=None,
        exposure_us=None,
        exposure_count=0,
        cd_m2_per_unit=last.cd_m2_per_unit if last else None,
    )
