"""How an estimate is judged; one definition for tests, `evaluate`, `demo` and documentation.

* Direction error: degrees between a true lamp and its estimate, matched one to one by the least
  total angle (no pair beyond 10°); what stays alone is missed, or false.
* Relighting error: irradiance of a unit Lambertian sphere at 642 normals against the truth in
  float64; mean absolute and root mean square, divided by the truth's maximum, per channel, then
  averaged over the channels.
* Relighting, as packets state it: root mean square over those normals of the luminance of the
  irradiance, relative to the true mean. The statement: `predicted_error`, with
  `relighting_sigma` where there is one.
* SH error: relative L2 of the TOTAL coefficients against a float64 projection.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, LightFlag
from lightprobe.geometry import Array
from lightprobe.lamp import Lamp


@dataclass(frozen=True)
class LampMatch:
    """A true lamp and the estimate of it."""

    angle_deg: float
    irradiance_error: float  # relative, of the luminance; signed
    radius_error_deg: float
    direction_sigma_deg: float | None  # as stated
    irradiance_sigma: float | None  # relative, as stated
    by_ring: bool = False  # the ring of light sensors found its strength
    # Of the colour: root mean square over R, G and B, each lamp's luminance being 1.
    colour_error: float = 0.0
    colour_sigma: float | None = None  # as stated


@dataclass(frozen=True)
class Score:
    """One estimate against the truth."""

    relighting_mae: float
    relighting_rmse: float
    sh_error: float
    matches: tuple[LampMatch, ...] = ()
    missed: int = 0
    false: int = 0
    predicted_error: float | None = None
    relighting_relative: float = 0.0  # comparable with relighting_stated
    relighting_stated: float | None = None
    flags: tuple[str, ...] = field(default=())


def relighting(true: ArrayLike, estimated: ArrayLike) -> tuple[float, float]:
    """(MAE, RMSE) of irradiances (N, 3), each channel divided by the truth's maximum."""
    t, e = np.asarray(true, dtype=np.float64), np.asarray(estimated, dtype=np.float64)
    peak = t.max(axis=0)
    error = (e - t) / np.where(peak > 0, peak, 1)
    return float(np.abs(error).mean()), float(np.sqrt((error**2).mean(axis=0)).mean())


def relighting_relative(true: ArrayLike, estimated: ArrayLike) -> float:
    """Root mean square of the error of irradiances (N, 3) in luminance, of the true mean."""
    t, e = luminance(np.asarray(true)), luminance(np.asarray(estimated))
    mean = float(t.mean())
    return float(np.sqrt(np.mean((e - t) ** 2))) / (mean if mean > 0 else 1.0)


def stated_error(estimate: Estimate) -> float | None:
    """1 sigma of relighting_relative() as the packet states it; None: it states none.

    What its model leaves out, and what the measurement does not know where that is stated too.
    """
    parts = [estimate.predicted_error, estimate.relighting_sigma]
    known = [part for part in parts if part is not None]
    return float(np.hypot.reduce(known)) if known else None


def sh_error(true: ArrayLike, estimated: ArrayLike) -> float:
    """Relative L2 error of coefficients; `true` may be of a higher order, which is left out."""
    e = np.asarray(estimated, dtype=np.float64)
    t = np.asarray(true, dtype=np.float64)[: len(e)]
    size = float(np.linalg.norm(t))
    return float(np.linalg.norm(e - t)) / size if size else float(np.linalg.norm(e))


def _colour_error(true: ArrayLike, estimated: ArrayLike) -> float:
    """Root mean square over R, G and B of two irradiances (3,), each of luminance 1."""
    t, e = np.asarray(true, dtype=np.float64), np.asarray(estimated, dtype=np.float64)
    lit = float(luminance(t)) > 0 and float(luminance(e)) > 0
    off = e / float(luminance(e)) - t / float(luminance(t)) if lit else np.zeros(3)
    return float(np.sqrt(np.mean(off**2)))


def match_lamps(true: Iterable[Lamp], estimate: Estimate) -> tuple[list[LampMatch], int, int]:
    """(matches, missed, false) of an estimate's lights."""
    lamps = list(true)
    pairs = geometry.match_directions(
        [lamp.direction for lamp in lamps], [light.direction for light in estimate.lights]
    )
    matches = []
    for i, j, angle in pairs:
        lamp, light = lamps[i], estimate.lights[j]
        brightness = float(luminance(light.irradiance))
        sigma = light.irradiance_sigma
        matches.append(
            LampMatch(
                angle_deg=angle,
                irradiance_error=brightness / float(luminance(lamp.irradiance)) - 1,
                radius_error_deg=light.angular_radius_deg - lamp.radius_deg,
                direction_sigma_deg=light.direction_sigma_deg,
                irradiance_sigma=(
                    None
                    if sigma is None or not brightness
                    else float(luminance(sigma)) / brightness
                ),
                by_ring=bool(light.flags & LightFlag.RING),
                colour_error=_colour_error(lamp.irradiance, light.irradiance),
                colour_sigma=light.colour_sigma,
            )
        )
    return matches, len(lamps) - len(pairs), len(estimate.lights) - len(pairs)


@dataclass(frozen=True, eq=False)
class Reference:
    """Truth of one scene, computed once for all estimates of it."""

    irradiance: Array  # (642, 3)
    total: Array  # SH, TOTAL
    lamps: tuple[Lamp, ...] | None  # None: not known (panoramas), so lights are not judged

    def score(self, estimate: Estimate) -> Score:
        """Judge an estimate."""
        found = estimate.irradiance(geometry.sphere_normals())
        mae, rmse = relighting(self.irradiance, found)
        matches, missed, false = (
            ([], 0, 0) if self.lamps is None else match_lamps(self.lamps, estimate)
        )
        return Score(
            relighting_mae=mae,
            relighting_rmse=rmse,
            sh_error=sh_error(self.total, estimate.total().coefficients),
            matches=tuple(matches),
            missed=missed,
            false=false,
            predicted_error=estimate.predicted_error,
            relighting_relative=relighting_relative(self.irradiance, found),
            relighting_stated=stated_error(estimate),
            flags=tuple(estimate.to_json()["flags"]),
        )


@dataclass(frozen=True)
class Summary:
    """Scores of many scenes in the figures that are quoted."""

    scenes: int
    relighting_mae_median: float
    relighting_mae_worst: float
    relighting_rmse_median: float
    sh_error_median: float
    sh_error_worst: float
    direction_rmse_deg: float | None  # None: no lamp was matched
    direction_worst_deg: float | None
    missed: int
    false: int
    # Shares of matched lamps within 1 and 2 stated sigma; None where no sigma is stated.
    direction_within_1_sigma: float | None
    direction_within_2_sigma: float | None
    irradiance_within_1_sigma: float | None
    irradiance_within_2_sigma: float | None
    # Shares of scenes within 1 and 3 stated sigma.
    relighting_within_1_sigma: float | None
    relighting_within_3_sigma: float | None

    def to_json(self) -> dict[str, float | int | None]:
        """Plain values."""
        return asdict(self)


def summarize(scores: Iterable[Score]) -> Summary:
    """Figures over scenes; raises ValueError when there is none."""
    all_scores = list(scores)
    if not all_scores:
        raise ValueError("metrics: no score to sum up")
    mae = [score.relighting_mae for score in all_scores]
    sh_errors = [score.sh_error for score in all_scores]
    matches = [match for score in all_scores for match in score.matches]
    angles = np.array([match.angle_deg for match in matches])
    direction = [
        match.angle_deg / match.direction_sigma_deg
        for match in matches
        if match.direction_sigma_deg
    ]
    irradiance = [
        abs(match.irradiance_error) / match.irradiance_sigma
        for match in matches
        if match.irradiance_sigma
    ]
    light = [s.relighting_relative / s.relighting_stated for s in all_scores if s.relighting_stated]
    return Summary(
        scenes=len(all_scores),
        relighting_mae_median=float(np.median(mae)),
        relighting_mae_worst=max(mae),
        relighting_rmse_median=float(np.median([s.relighting_rmse for s in all_scores])),
        sh_error_median=float(np.median(sh_errors)),
        sh_error_worst=max(sh_errors),
        direction_rmse_deg=float(np.sqrt((angles**2).mean())) if matches else None,
        direction_worst_deg=float(angles.max()) if matches else None,
        missed=sum(score.missed for score in all_scores),
        false=sum(score.false for score in all_scores),
        direction_within_1_sigma=_within(direction, 1),
        direction_within_2_sigma=_within(direction, 2),
        irradiance_within_1_sigma=_within(irradiance, 1),
        irradiance_within_2_sigma=_within(irradiance, 2),
        relighting_within_1_sigma=_within(light, 1),
        relighting_within_3_sigma=_within(light, 3),
    )


def _within(ratios: list[float], limit: float) -> float | None:
    return float(np.mean(np.array(ratios) <= limit)) if ratios else None
