"""Several probes with known places: which lamps they share, and how far away these are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lightprobe import geometry
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, Light, LightFlag
from lightprobe.fallback import mean_irradiance
from lightprobe.geometry import Array
from lightprobe.triangulate import LampPlace, Sighting, triangulate

#: A lamp may send more light one way than another: 1 sigma of the logarithm of that ratio.
#: A bare bulb sends the same everywhere, a shade of fabric half as much sideways.
_UNEVEN_LN = math.log(2) / 2
#: Its colour is the same all around: 1 sigma of the logarithm of a channel against the others.
_COLOUR_LN = 0.15
#: Fewer than this share of the lamps that could be the same are: the probes are not where, or not
#: turned as, they are said to be, and what fits does so by chance.
_LEAST_SHARE = 0.5
#: Lamps of one row are mounted as exactly as this.
_SAME_PLANE_DEG = 0.5
#: A pair is one lamp when it disagrees by less than 3 sigma (four degrees of freedom: direction,
#: strength, colour), and every other pair with one of the two is a hundred times less likely.
_MOST_CHI2 = 16.3
_CLEARLY_CHI2 = 2 * math.log(100)
#: What a direction's sigma is taken for where a packet states none.
_UNKNOWN_SIGMA_DEG = 1.0


@dataclass(frozen=True, eq=False)
class Station:
    """A probe that stays where it is."""

    uri: str
    place_m: Array  # (3,), in the frame of the room: +Y up
    yaw_deg: float = 0.0  # how far its −Z is turned from the room's to the left
    place_sigma_m: float = 0.01
    turn_sigma_deg: float = 0.3
    turn_wxyz: Array = field(init=False)  # its frame to the room's

    def __post_init__(self) -> None:
        """Make its turn."""
        object.__setattr__(self, "turn_wxyz", geometry.quaternion([0, 1, 0], self.yaw_deg))

    def sighting(self, light: Light) -> Sighting:
        """Give a lamp of its packet, in the frame of the room."""
        own = light.direction_sigma_deg
        return Sighting(
            self.place_m,
            geometry.rotate(self.turn_wxyz, light.direction),
            math.hypot(_UNKNOWN_SIGMA_DEG if own is None else own, self.turn_sigma_deg),
            self.place_sigma_m,
        )


def with_distances(
    stations: Sequence[Station], base: Estimate, others: Sequence[Estimate | None]
) -> Estimate:
    """Give the first station's estimate, with the distances of lamps that others see, too.

    `base` is its newest estimate, `others` those of the other stations, all in the probe's frame;
    None: there is none. A lamp that no other station sees, or of which it is not clear who sees it,
    has no distance. Lamps that a probe lists as mirror images or as areas are left as they are.
    """
    seen: list[list[Sighting]] = [[stations[0].sighting(light)] for light in base.lights]
    for station, other in zip(stations[1:], others, strict=True):
        if other is not None:
            for i, j in _same(stations[0], base, station, other):
                seen[i].append(station.sighting(other.lights[j]))
    lights = tuple(
        _placed(light, triangulate(sightings)) if len(sightings) > 1 else light
        for light, sightings in zip(base.lights, seen, strict=True)
    )
    return replace(base, lights=lights)


def _placed(light: Light, place: LampPlace) -> Light:
    """Give a lamp its distance, if the sightings agree on one."""
    if place.chi2 > _MOST_CHI2 + 2 * (place.degrees_of_freedom - 1):
        return light
    return replace(
        light,
        distance_m=place.distance_m,
        distance_sigma=place.distance_sigma,
        nearest_m=None if place.distance_m else place.nearest_m,
    )


def _same(
    first: Station, base: Estimate, second: Station, other: Estimate
) -> list[tuple[int, int]]:
    """Pairs (index in lights of `base`, of `other`) that are clearly one lamp."""
    lights, others = base.lights, other.lights
    scale_ln, scale_variance = _scale(base, other)
    chi2 = np.full((len(lights), len(others)), np.inf)
    for i, light in enumerate(lights):
        for j, one in enumerate(others):
            if _is_lamp(light) and _is_lamp(one):
                chi2[i, j] = _disagreement(first, light, second, one, scale_ln, scale_variance)
    pairs = []
    for i, j in zip(*np.where(chi2 <= _MOST_CHI2), strict=True):
        rivals = np.concatenate([np.delete(chi2[i], j), np.delete(chi2[:, j], i)])
        if not len(rivals) or rivals.min() >= chi2[i, j] + _CLEARLY_CHI2:
            pairs.append((int(i), int(j)))
    could = min(sum(map(_is_lamp, lights)), sum(map(_is_lamp, others)))
    if len(pairs) < _LEAST_SHARE * could:
        return []
    across = second.place_m - first.place_m
    alone = (_without_partner(first, lights, across, {i for i, _ in pairs}),
             _without_partner(second, others, across, {j for _, j in pairs}))  # fmt: skip
    return [(i, j) for i, j in pairs if i not in alone[0] and j not in alone[1]]


def _is_lamp(light: Light) -> bool:
    return not light.flags & (LightFlag.EXTENDED | LightFlag.REFLECTION)


def _without_partner(
    station: Station, lights: Sequence[Light], across_m: Array, paired: set[int]
) -> set[int]:
    """Which paired lamps one that is alike, and has no partner, may be taken for.

    Alike are lamps of one plane with both probes, as those of a row that is parallel to the line
    between them, which look the same: the other probe may see the one, or the other.
    """
    sightings = [station.sighting(light) for light in lights]
    found = set()
    for i in paired:
        for k in set(range(len(lights))) - paired:
            if not _is_lamp(lights[k]):
                continue
            _, hue, _ = _strengths(lights[i], lights[k])
            planes = [geometry.cross(across_m, sightings[n].direction) for n in (i, k)]
            apart_deg = float(geometry.angle_deg(*planes)) if all(map(np.any, planes)) else 0.0
            sigma_deg = math.hypot(*(sightings[n].direction_sigma_deg for n in (i, k)))
            if hue < _MOST_CHI2 and apart_deg < 3 * max(sigma_deg, _SAME_PLANE_DEG):
                found.add(i)
    return found


def _scale(base: Estimate, other: Estimate) -> tuple[float, float]:
    """Logarithm of the other's unit of light over the first's, and its variance.

    Where one is not calibrated, both are taken to be in equally bright places, within a factor.
    """
    if base.cd_m2_per_unit and other.cd_m2_per_unit:
        sigmas = (base.cd_m2_per_unit_sigma or 0.0, other.cd_m2_per_unit_sigma or 0.0)
        return math.log(base.cd_m2_per_unit / other.cd_m2_per_unit), math.hypot(*sigmas) ** 2
    means = [max(mean_irradiance(one), 1e-30) for one in (base, other)]
    return math.log(means[1] / means[0]), math.log(2) ** 2


def _disagreement(
    first: Station, light: Light, second: Station, other: Light, scale_ln: float,
    scale_variance: float,
) -> float:  # fmt: skip
    """Squared sigmas by which two lamps are not one: in direction, strength and colour."""
    place = triangulate([first.sighting(light), second.sighting(other)])
    inverse = max(place.inverse_distance_per_m, 0.0)
    there = place.direction - inverse * (second.place_m - first.place_m)
    # Its irradiance goes with the inverse square of the distance.
    expected = scale_ln - 2 * math.log(max(float(np.linalg.norm(there)), 1e-6))
    ratio_ln, hue, variance = _strengths(light, other)
    # The distance is uncertain, and the expected strength with it.
    slope = 2 * float(np.linalg.norm(second.place_m - first.place_m))
    variance += scale_variance + (slope * place.inverse_distance_sigma_per_m) ** 2
    return place.chi2 + (ratio_ln - expected) ** 2 / variance + hue


def _strengths(light: Light, other: Light) -> tuple[float, float, float]:
    """Logarithm of the ratio of two lamps; how unlike their colours are; variance of the ratio."""
    dimmest = 1e-30 + 1e-3 * float(luminance(light.irradiance) + luminance(other.irradiance))
    ratio_ln = np.log(np.maximum(other.irradiance, dimmest) / np.maximum(light.irradiance, dimmest))
    hue = float(np.sum((ratio_ln - ratio_ln.mean()) ** 2)) / _COLOUR_LN**2
    variance = _UNEVEN_LN**2 + sum(_relative_variance(one) for one in (light, other))
    return float(ratio_ln.mean()), hue, variance


def _relative_variance(light: Light) -> float:
    if light.irradiance_sigma is None or not light.irradiance.any():
        return 0.25
    return float(luminance(light.irradiance_sigma) / luminance(light.irradiance)) ** 2
