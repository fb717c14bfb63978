"""How wrong ambient light is that a packet gives at a place beside the probe, and unchanged.

Ambient is all light but that of the lamps that the packet lists, each as a point, as it takes them
out of its SH. A lamp that it does not list is in them, and in the truth; what it lists besides
lamps (a bright spot of a wall) counts as ambient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from judge import Packet
from lightprobe import geometry, sh
from lightprobe.estimate import Estimate, Light
from lightprobe.evaluate.metrics import relighting, relighting_relative, stated_error
from lightprobe.geometry import Array
from lightprobe.room import moved, room_at

NORMALS = geometry.sphere_normals(2)
#: A light whose direction is so near to the rim of a lamp is that lamp.
_NEAR_DEG = 5.0


@lru_cache(maxsize=2)
def _cosines(width_px: int, height_px: int) -> Array:
    """Weights (N, H·W) of a map's pixels in the irradiance on NORMALS."""
    directions = geometry.equirect_directions(width_px, height_px).reshape(-1, 3)
    solid_angle = np.repeat(geometry.equirect_solid_angles(width_px, height_px), width_px)
    return np.asarray(np.maximum(NORMALS @ directions.T, 0) * solid_angle)


def irradiance(radiance: Array) -> Array:
    """Irradiance (N, 3) on NORMALS, of a map (H, W, 3)."""
    height, width, _ = radiance.shape
    return np.asarray(_cosines(width, height) @ radiance.reshape(-1, 3).astype(np.float64))


def as_point(radiance: Array) -> Array:
    """Irradiance (N, 3) on NORMALS of a lamp's map (H, W, 3), if all came from its middle.

    As strong as its radiance times its solid angle, which is what packets take out of their SH.
    """
    height, width, _ = radiance.shape
    directions = geometry.equirect_directions(width, height)
    weight = radiance * geometry.equirect_solid_angles(width, height)[:, None, None]
    along = np.einsum("hwc,hwd->cd", weight, directions)
    if not along.any():
        return np.zeros((len(NORMALS), 3))
    middle = geometry.normalize(along.sum(axis=0))
    return np.asarray(np.maximum(NORMALS @ middle, 0)[:, None] * weight.sum(axis=(0, 1)))


@dataclass(frozen=True, eq=False)
class Lit:
    """The light at one place of a room; irradiance on NORMALS, in the room's frame."""

    place_m: Array  # (3,)
    ambient: Array  # (N, 3): lamps light the room, and are not seen
    lamps: Array  # (L, N, 3): what each adds that is seen
    points: Array  # (L, N, 3): the same, if it came from one direction, as what is listed does
    centres_m: Array  # (L, 3)
    radii_m: Array  # (L,)


@dataclass(frozen=True)
class Ambient:
    """Errors of one packet at one place: MAE of the largest true irradiance."""

    distance_m: float  # as it is called, in tables
    unchanged: float
    moved: float
    ratio: float | None  # of the whole light's error there, to the stated sigma; None: none stated
    has_room: bool  # the packet brings a box
    by_box: float | None = None  # error of exact SH, moved by the packet's box


@dataclass(frozen=True)
class Ambients:
    """Figures of many."""

    count: int
    unchanged: float
    unchanged_worst: float
    moved: float
    moved_worst: float
    by_box: float
    by_box_worst: float
    stated: float  # share with a sigma
    within_1: float  # of these
    within_3: float
    has_room: float
    spread: list[float] = field(default_factory=list)  # of `moved`: quantiles 50, 90 %

    @classmethod
    def of(cls, some: Sequence[Ambient]) -> Ambients:
        """Sum up; NaN where there is nothing."""
        ratios = np.array([one.ratio for one in some if one.ratio is not None])
        unchanged, moved = (
            np.array([getattr(one, name) for one in some] or [np.nan])
            for name in ("unchanged", "moved")
        )
        by_box = np.array([one.by_box for one in some if one.by_box is not None] or [np.nan])
        return cls(
            len(some), float(np.median(unchanged)), float(unchanged.max()),
            float(np.median(moved)), float(moved.max()),
            float(np.median(by_box)), float(by_box.max()), len(ratios) / max(len(some), 1),
            *(float(np.mean(ratios <= k)) if len(ratios) else float("nan") for k in (1, 3)),
            float(np.mean([one.has_room for one in some])) if some else float("nan"),
            [float(q) for q in np.quantile(moved, [0.5, 0.9])],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Exact:
    """The ambient light of a place as exact SH, in the room's frame; lamps are not in it."""

    place_m: Array  # (3,)
    coefficients: Array  # (25, 3)

    @classmethod
    def of(cls, place_m: Array, radiance: Array) -> Exact:
        """Take them of a map (H, W, 3)."""
        return cls(place_m, sh.project(radiance.astype(np.float64), sh.MAX_ORDER))

    def error(self, packet: Packet, here_m: Array, lit: Lit) -> float | None:
        """Error at a place, moved by the packet's box; None: it has none, or not in this frame."""
        room = packet.estimate.room
        if room is None or packet.estimate.frame != "WORLD":
            return None
        around = room_at(room, self.place_m - here_m)
        there = moved(self.coefficients, around, lit.place_m - self.place_m)
        return relighting(lit.ambient, sh.irradiance(there, NORMALS))[0]


def judge(
    packet: Packet, here_m: Array, lit: Lit, distance_m: float, exact: Exact | None = None
) -> Ambient:
    """Compare what a packet of a probe at `here_m` gives at a place with the truth there."""
    estimate = packet.estimate
    others, listed = _lamps(packet, here_m, lit)
    there = estimate.at(packet.turn @ (lit.place_m - here_m))
    normals = NORMALS @ packet.turn.T
    true = lit.ambient + lit.lamps.sum(axis=0) - lit.points[listed].sum(axis=0)
    errors = [
        relighting(true, _ambient(one, others, normals))[0] for one in (estimate, there)
    ]  # fmt: skip
    whole = relighting_relative(lit.ambient + lit.lamps.sum(axis=0), there.irradiance(normals))
    sigma = None if there.relighting_sigma is None else stated_error(there)
    ratio = None if sigma is None else whole / max(sigma, 1e-6)
    return Ambient(
        distance_m,
        *errors,
        ratio,
        estimate.room is not None,
        exact and exact.error(packet, here_m, lit),
    )


def _lamps(packet: Packet, here_m: Array, lit: Lit) -> tuple[set[int], Array]:
    """Ids of the lights that are no lamps; and which lamps are listed (L,)."""
    listed = np.zeros(len(lit.centres_m), bool)
    others: set[int] = set()
    for light in packet.estimate.lights:
        towards_m = lit.centres_m - here_m
        off_deg = geometry.angle_deg(towards_m @ packet.turn.T, light.direction)
        radius_deg = np.degrees(np.arctan2(lit.radii_m, np.linalg.norm(towards_m, axis=-1)))
        beyond_deg = np.asarray(off_deg) - radius_deg
        nearest = int(beyond_deg.argmin())
        if beyond_deg[nearest] < _NEAR_DEG:
            listed[nearest] = True
        else:
            others.add(light.id)
    return others, listed


def _ambient(estimate: Estimate, others: set[int], normals: Array) -> Array:
    """Irradiance (N, 3) of the SH, and of lights that are no lamps."""
    total = sh.irradiance(estimate.sh.coefficients, normals)
    for light in estimate.lights:
        if light.id in others:
            total += _of(light, normals)
    return np.asarray(total)


def _of(light: Light, normals: Array) -> Array:
    return np.asarray(np.maximum(normals @ light.direction, 0)[:, None] * light.irradiance)
