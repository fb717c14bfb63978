"""Which lamps of two probes are the same, when their yaws are known roughly.

Two directions to one lamp lie in one plane with the line between the probes, and meet in front of
both; its strength goes with the inverse square of its distance from each; its colour is the same.
Yaws that bring many lamps together are likely those that the probes have.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, Light, LightFlag
from lightprobe.fallback import mean_irradiance
from lightprobe.geometry import Array, cross

#: A lamp may send more light one way than another: 1 sigma of the logarithm of that ratio.
#: A bare bulb sends the same everywhere, a shade of fabric half as much sideways.
_UNEVEN_LN = math.log(2) / 2
#: Its colour is the same all around: 1 sigma of the logarithm of a channel against the others.
_COLOUR_LN = 0.15
#: A pair is one lamp when it disagrees by less than 3 sigma (four degrees of freedom: direction,
#: strength, colour), and every other pair with one of the two is a hundred times less likely.
_MOST_CHI2 = 16.3
_CLEARLY_CHI2 = 2 * math.log(100)
#: Fewer than this share of the lamps that could be the same are: the probes are not where, or not
#: turned as, they are said to be, and what fits does so by chance.
_LEAST_SHARE = 0.5
#: Two yaws make two pairs fit that are none. Fewer pairs than this count only where each of the
#: probes sees no other lamps.
_FEW_PAIRS = 3
#: Lamps of one row are mounted as exactly as this.
_SAME_PLANE_DEG = 0.5
#: What a direction's sigma is taken for where a packet states none; and what calibration leaves of
#: a lens, whatever a packet states.
_UNKNOWN_SIGMA_DEG = 1.0
_LEAST_SIGMA_DEG = 0.02
#: Yaws are tried as far as this, in steps of the sigma of the level, but no more of them.
_YAW_SIGMAS = 3.0
_MOST_YAWS = 41  # of each probe
_LEAST_SINE = 1e-3  # of the angle between a lamp and the line between the probes


@dataclass(frozen=True, eq=False)
class View:
    """A probe as it stands, and what it sees."""

    estimate: Estimate
    place_m: Array  # (3,) in the room
    place_sigma_m: float
    turn_wxyz: Array  # its frame to the room's
    yaw_sigma_deg: float
    level_sigma_deg: float

    def directions(self) -> Array:
        """Directions of its lamps (n, 3) in the room."""
        found = [geometry.rotate(self.turn_wxyz, one.direction) for one in self.estimate.lights]
        return np.array(found).reshape(-1, 3)

    def sigma_rad(self) -> Array:
        """Of each direction (n,), but for the yaw."""
        own = [own_sigma_deg(light) for light in self.estimate.lights]
        return np.radians(np.hypot(own, self.level_sigma_deg))

    def yaws_rad(self) -> Array:
        """Yaws to try, as far as they may be off."""
        most_deg = _YAW_SIGMAS * self.yaw_sigma_deg
        number = math.ceil(most_deg / max(self.level_sigma_deg, 0.1))
        number = min(number, _MOST_YAWS // 2)
        return np.radians(np.linspace(-most_deg, most_deg, 2 * number + 1))


def own_sigma_deg(light: Light) -> float:
    """1 sigma of a lamp's direction, as a probe states it."""
    own = light.direction_sigma_deg
    return _UNKNOWN_SIGMA_DEG if own is None else max(own, _LEAST_SIGMA_DEG)


@dataclass(frozen=True, eq=False)
class Matched:
    """Lamps that two probes share."""

    pairs: list[tuple[int, int]]  # index in the lights of the first, of the second
    yaws_rad: tuple[float, float]  # to be added to those of the views


NOTHING = Matched([], (0.0, 0.0))


def match(first: View, second: View) -> Matched:
    """Find the lamps that clearly are the same; none where two answers are about as likely.

    Probes in one place have no line between them, by which lamps could be told apart.
    """
    sizes = [sum(map(_is_lamp, view.estimate.lights)) for view in (first, second)]
    if not all(sizes) or np.array_equal(first.place_m, second.place_m):
        return NOTHING
    yaws = np.stack(np.meshgrid(first.yaws_rad(), second.yaws_rad()), axis=-1).reshape(-1, 2)
    chi2 = _disagreements(first, second, yaws)
    mutual = (chi2 == chi2.min(axis=2, keepdims=True)) & (chi2 == chi2.min(axis=1, keepdims=True))
    chosen = mutual & (chi2 <= _MOST_CHI2)
    offs = np.sum((yaws / _yaw_sigmas(first, second)) ** 2, axis=1)
    score = np.where(chosen, _MOST_CHI2 - chi2, 0.0).sum(axis=(1, 2)) - offs
    best = int(np.argmax(score))
    if _is_unclear(chosen, score, best):
        return NOTHING
    pairs = _clear_pairs(chi2[best])
    if len(pairs) < _LEAST_SHARE * min(sizes):
        return NOTHING
    across_m = second.place_m - first.place_m
    alone = (_without_partner(first, across_m, {i for i, _ in pairs}),
             _without_partner(second, across_m, {j for _, j in pairs}))  # fmt: skip
    kept = [(i, j) for i, j in pairs if i not in alone[0] and j not in alone[1]]
    if len(kept) < _FEW_PAIRS and len(kept) < max(sizes):
        return NOTHING
    return Matched(kept, (float(yaws[best, 0]), float(yaws[best, 1])))


def _yaw_sigmas(first: View, second: View) -> Array:
    return np.radians([max(view.yaw_sigma_deg, 0.1) for view in (first, second)])


def _is_lamp(light: Light) -> bool:
    return not light.flags & (LightFlag.EXTENDED | LightFlag.REFLECTION)


def _is_unclear(chosen: Array, score: Array, best: int) -> bool:
    """Whether other yaws, about as likely, match a lamp with another one."""
    rivals = chosen[score > score[best] - _CLEARLY_CHI2]
    mine = chosen[best]
    has_other = (rivals & ~mine) & (mine.any(axis=1)[:, None] | mine.any(axis=0)[None, :])
    return bool(has_other.any())


def _clear_pairs(chi2: Array) -> list[tuple[int, int]]:
    pairs = []
    for i, j in zip(*np.where(chi2 <= _MOST_CHI2), strict=True):
        rivals = np.concatenate([np.delete(chi2[i], j), np.delete(chi2[:, j], i)])
        if not len(rivals) or rivals.min() >= chi2[i, j] + _CLEARLY_CHI2:
            pairs.append((int(i), int(j)))
    return pairs


def _disagreements(first: View, second: View, yaws_rad: Array) -> Array:
    """Squared sigmas (yaws, n, m) by which lamps are not one: direction, strength and colour."""
    across_m = second.place_m - first.place_m
    baseline_m = float(np.linalg.norm(across_m))
    line = across_m / baseline_m
    a = _about_up(first.directions(), yaws_rad[:, 0])[:, :, None]  # (yaws, n, 1, 3)
    b = _about_up(second.directions(), yaws_rad[:, 1])[:, None]
    sigma_a = first.sigma_rad()[:, None]
    sigma_b = second.sigma_rad()[None, :]
    beside_a, beside_b = cross(line, a), cross(line, b)
    sine_a = np.maximum(np.linalg.norm(beside_a, axis=-1), _LEAST_SINE)
    sine_b = np.maximum(np.linalg.norm(beside_b, axis=-1), _LEAST_SINE)
    cosine_a, cosine_b = a @ line, b @ line
    # Angle between the planes that both have with the line, seen from the second probe.
    turn = np.arctan2(cross(beside_a, beside_b) @ line, np.sum(beside_a * beside_b, axis=-1))
    apart = sine_b * cosine_a - cosine_b * sine_a  # sine of the angle at which they meet
    inverse_b_per_m = np.abs(apart) / (baseline_m * sine_a)
    place_sigma_m = math.hypot(first.place_sigma_m, second.place_sigma_m)
    out = (turn * sine_b) ** 2 / (
        sigma_b**2 + (sigma_a * sine_b / sine_a) ** 2 + (place_sigma_m * inverse_b_per_m) ** 2
    )
    behind = np.minimum(apart, 0) ** 2 / (sigma_a**2 + sigma_b**2)
    scale_ln, scale_variance = scale_of(first.estimate, second.estimate)
    ratio_ln, hue, variance = _strengths(first.estimate.lights, second.estimate.lights)
    expected_ln = scale_ln + 2 * np.log(sine_b / sine_a)
    variance = variance + scale_variance
    variance = variance + (2 * sigma_a * cosine_a / sine_a) ** 2
    variance = variance + (2 * sigma_b * cosine_b / sine_b) ** 2
    chi2 = out + behind + (ratio_ln - expected_ln) ** 2 / variance + hue
    lamps = [np.array([_is_lamp(one) for one in view.estimate.lights]) for view in (first, second)]
    return np.where(lamps[0][:, None] & lamps[1][None, :], chi2, np.inf)


def _about_up(directions: Array, yaws_rad: Array) -> Array:
    """Directions (yaws, n, 3), turned to the left about +Y."""
    x, y, z = directions.T
    cosine, sine = np.cos(yaws_rad)[:, None], np.sin(yaws_rad)[:, None]
    return np.stack(
        [cosine * x + sine * z, np.broadcast_to(y, (len(yaws_rad), len(y))), cosine * z - sine * x],
        axis=-1,
    )


def _without_partner(view: View, across_m: Array, paired: set[int]) -> set[int]:
    """Which paired lamps one that is alike, and has no partner, may be taken for.

    Alike are lamps of one plane with both probes, as those of a row that is parallel to the line
    between them, which look the same: the other probe may see the one, or the other.
    """
    lights, directions, sigma = view.estimate.lights, view.directions(), view.sigma_rad()
    _, hue, _ = _strengths(lights, lights)
    found = set()
    for i in paired:
        for k in set(range(len(lights))) - paired:
            planes = [cross(across_m, directions[n]) for n in (i, k)]
            apart_deg = float(geometry.angle_deg(*planes))
            sigma_deg = math.degrees(math.hypot(sigma[i], sigma[k]))
            in_plane = apart_deg < 3 * max(sigma_deg, _SAME_PLANE_DEG)
            if _is_lamp(lights[k]) and hue[i, k] < _MOST_CHI2 and in_plane:
                found.add(i)
    return found


def scale_of(base: Estimate, other: Estimate) -> tuple[float, float]:
    """Logarithm of the other's unit of light over the first's, and its variance.

    Where one is not calibrated, both are taken to be in equally bright places, within a factor.
    """
    if base.cd_m2_per_unit and other.cd_m2_per_unit:
        sigmas = (base.cd_m2_per_unit_sigma or 0.0, other.cd_m2_per_unit_sigma or 0.0)
        return math.log(base.cd_m2_per_unit / other.cd_m2_per_unit), math.hypot(*sigmas) ** 2
    means = [max(mean_irradiance(one), 1e-30) for one in (base, other)]
    return math.log(means[1] / means[0]), math.log(2) ** 2


def _strengths(lights: Sequence[Light], others: Sequence[Light]) -> tuple[Array, Array, Array]:
    """Logarithms of ratios (n, m); how unlike colours are; variances of the ratios."""
    a_ln, b_ln = (_logarithms(both) for both in (lights, others))
    ratio_ln = b_ln[None] - a_ln[:, None]
    mean_ln = ratio_ln.mean(axis=-1)
    hue = np.sum((ratio_ln - mean_ln[..., None]) ** 2, axis=-1) / _COLOUR_LN**2
    variances = [np.array([_relative_variance(one) for one in both]) for both in (lights, others)]
    return mean_ln, hue, _UNEVEN_LN**2 + variances[0][:, None] + variances[1][None, :]


def _logarithms(lights: Sequence[Light]) -> Array:
    """Logarithms of irradiances (n, 3); what is dim beside the brightest of the same probe is so.

    Each probe may have a unit of its own.
    """
    irradiances = np.array([one.irradiance for one in lights])
    return np.asarray(np.log(np.maximum(irradiances, 1e-30 + 1e-3 * irradiances.max())))


def _relative_variance(light: Light) -> float:
    if light.irradiance_sigma is None or not light.irradiance.any():
        return 0.25
    return float(luminance(light.irradiance_sigma) / luminance(light.irradiance)) ** 2
