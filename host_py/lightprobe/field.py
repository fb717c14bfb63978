"""Several probes with known places: which lamps they share, and how far away these are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lightprobe import bundle, geometry
from lightprobe import sh as harmonics
from lightprobe.box_fit import BoxFit, Seen
from lightprobe.estimate import Estimate, Light
from lightprobe.geometry import Array
from lightprobe.matching import View, match, own_sigma_deg, scale_of

_SIGMAS = 3.0  # a distance is known when its inverse is so many sigmas from 0


@dataclass(frozen=True, eq=False)
class Station:
    """A probe that stays where it is, upright, as well as it was measured."""

    uri: str
    place_m: Array  # (3,), in the frame of the room: +Y up
    yaw_deg: float = 0.0  # how far its −Z is turned from the room's to the left
    place_sigma_m: float = 0.01  # along each axis
    yaw_sigma_deg: float = 3.0
    level_sigma_deg: float = 0.5  # about the room's x and z
    turn_wxyz: Array = field(init=False)  # its frame to the room's

    def __post_init__(self) -> None:
        """Make its turn."""
        object.__setattr__(self, "turn_wxyz", geometry.quaternion([0, 1, 0], self.yaw_deg))

    @property
    def turn_sigma_rad(self) -> Array:
        """Of its turn about each axis of the room (3,)."""
        return np.radians([self.level_sigma_deg, self.yaw_sigma_deg, self.level_sigma_deg])


@dataclass(frozen=True, eq=False)
class Joined:
    """The first station's estimate with distances, and how the stations are turned."""

    estimate: Estimate
    turns_wxyz: tuple[Array, ...]  # of each station, its frame to the room's
    yaw_sigma_deg: tuple[float, ...]
    contradicts: bool  # lamps that seem the same do not fit any places and turns
    shared: tuple[frozenset[int], ...]  # of each station: ids of its lamps that have places


#: Of a lamp that several stations see: index of the station, and of the lamp in its estimate.
_Seen = list[tuple[int, int]]


def join(stations: Sequence[Station], base: Estimate, others: Sequence[Estimate | None]) -> Joined:
    """Give the first station's estimate, with the distances of lamps that others see, too.

    `base` is its newest estimate, `others` those of the other stations, all in the probe's frame;
    None: there is none. A lamp that no other station sees, or of which it is not clear who sees it,
    has no distance. Lamps that a probe lists as mirror images or as areas are left as they are.
    Lamps are matched, all is fitted (:mod:`lightprobe.bundle`), and both again with the turns
    that came out.
    """
    estimates = [base, *others]
    views = [
        None if one is None else View(
            one, station.place_m, station.place_sigma_m, station.turn_wxyz,
            station.yaw_sigma_deg, station.level_sigma_deg,
        )
        for station, one in zip(stations, estimates, strict=True)
    ]  # fmt: skip
    seen, yaws_rad = _matched(views)
    if seen:
        roughly = _fit(stations, estimates, seen, yaws_rad)
        sigmas_deg = np.degrees(roughly.turn_sigma_rad.max(axis=1)).tolist()
        views = [
            view and replace(view, turn_wxyz=turn, yaw_sigma_deg=0.0, level_sigma_deg=sigma_deg)
            for view, turn, sigma_deg in zip(
                views, _turns(stations, roughly), sigmas_deg, strict=True
            )
        ]
        seen, _ = _matched(views)
    if not seen:
        return Joined(base, tuple(one.turn_wxyz for one in stations),
                      tuple(one.yaw_sigma_deg for one in stations), False,
                      tuple(frozenset[int]() for _ in stations))  # fmt: skip
    found = _fit(stations, estimates, seen, roughly.turns_rad[:, 1])
    lights = list(base.lights)
    for k, one in enumerate(seen if found.agrees else []):
        lights[one[0][1]] = _placed(
            lights[one[0][1]], float(found.inverse_per_m[k]), float(found.inverse_sigma_per_m[k])
        )
    yaw_sigma_deg = tuple(np.degrees(found.turn_sigma_rad[:, 1]).tolist())
    pairs = [pair for one in seen for pair in one] if found.agrees else []
    shared = tuple(
        frozenset(estimates[k].lights[i].id for k, i in pairs if k == station)  # type: ignore[union-attr]
        for station in range(len(stations))
    )
    return Joined(
        replace(base, lights=tuple(lights)), _turns(stations, found), yaw_sigma_deg,
        not found.agrees, shared,
    )  # fmt: skip


def with_room(
    stations: Sequence[Station], joined: Joined, others: Sequence[Estimate | None], search: BoxFit
) -> Joined:
    """Give the same with the room around the first station, as far as their ambient light tells.

    Lamps that have no places count as ambient light: they are in the SH of all stations then. A
    station that shares no lamp with the first one, or whose SH are not AMBIENT of order 4, does not
    count; if the first one's are not, or lamps contradict, nothing is known of the room.
    """
    base = joined.estimate
    if joined.contradicts or base.room is not None or not _is_fine(base):
        return joined
    views = [
        _ambient(base, estimate, turn, ids, station)
        for estimate, turn, ids, station in zip(
            (base, *others), joined.turns_wxyz, joined.shared, stations, strict=True
        )
        if ids and estimate is not None and _is_fine(estimate)
    ]
    room = search.look(views)
    if room is None:
        return joined
    x, y, z, w = room.orientation
    w, x, y, z = geometry.turn_after(geometry.inverse(joined.turns_wxyz[0]), (w, x, y, z))
    turned = replace(room, orientation=np.array([x, y, z, w]))
    return replace(joined, estimate=replace(base, room=turned))


def _is_fine(estimate: Estimate) -> bool:
    """Tell whether its SH are such as a room can be fitted to."""
    return estimate.sh.kind == "AMBIENT" and estimate.sh.order == 4


def _ambient(
    base: Estimate, estimate: Estimate, turn_wxyz: Array, shared: frozenset[int], station: Station
) -> Seen:
    """Give what a station sees beside lamps that have places: frame of the room, unit of base."""
    coefficients = estimate.sh.coefficients.copy()
    for light in estimate.beside_sh:
        if light.id not in shared:
            coefficients += harmonics.lamp(light.direction, 4)[:, None] * light.irradiance
    turned = harmonics.rotate(coefficients, turn_wxyz)
    ratio_ln, variance = scale_of(base, estimate)
    return Seen(math.exp(-ratio_ln) * turned, station.place_m, math.sqrt(variance))


def _turns(stations: Sequence[Station], fit: bundle.Fit) -> tuple[Array, ...]:
    """How the stations are turned, by a fit."""
    found = []
    for station, turn_rad in zip(stations, fit.turns_rad, strict=True):
        angle_rad = float(np.linalg.norm(turn_rad))
        turn = geometry.quaternion(turn_rad if angle_rad else [0, 1, 0], math.degrees(angle_rad))
        found.append(geometry.turn_after(turn, station.turn_wxyz))
    return tuple(found)


def _matched(views: Sequence[View | None]) -> tuple[list[_Seen], Array]:
    """Lamps of the first probe that others see, too; and how far each yaw seems to be off."""
    first = views[0]
    assert first is not None
    seen: dict[int, _Seen] = {}
    yaws_rad = np.zeros(len(views))
    for k, view in enumerate(views):
        if not k or view is None:
            continue
        matched = match(first, view)
        for i, j in matched.pairs:
            seen.setdefault(i, [(0, i)]).append((k, j))
        if matched.pairs:
            yaws_rad[0], yaws_rad[k] = matched.yaws_rad
    return list(seen.values()), yaws_rad


def _fit(
    stations: Sequence[Station], estimates: Sequence[Estimate | None], seen: Sequence[_Seen],
    yaws_rad: Array,
) -> bundle.Fit:  # fmt: skip
    """Fit places and turns of the stations, and the lamps that they see."""
    probe, lamp, directions, sigma_deg = [], [], [], []
    for number, sightings in enumerate(seen):
        for k, i in sightings:
            light = estimates[k].lights[i]  # type: ignore[union-attr]
            probe.append(k)
            lamp.append(number)
            directions.append(geometry.rotate(stations[k].turn_wxyz, light.direction))
            sigma_deg.append(own_sigma_deg(light))
    return bundle.fit(
        np.array([station.place_m for station in stations]),
        np.array([station.place_sigma_m for station in stations]),
        np.array([station.turn_sigma_rad for station in stations]),
        bundle.Sightings(
            np.array(probe), np.array(lamp), np.array(directions), np.radians(sigma_deg)
        ),
        yaws_rad,
    )


def _placed(light: Light, inverse_per_m: float, sigma_per_m: float) -> Light:
    """Give a lamp its distance, or the least that it can have."""
    if inverse_per_m > _SIGMAS * sigma_per_m:
        return replace(
            light, distance_m=1 / inverse_per_m, distance_sigma=sigma_per_m / inverse_per_m
        )
    return replace(light, nearest_m=1 / (max(inverse_per_m, 0.0) + _SIGMAS * sigma_per_m))
