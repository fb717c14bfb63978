"""Furnished rooms by Mitsuba 3: panoramas along the way of a head, and the light at places beside.

Metres, +X right, +Y up, -Z ahead; the middle of the head's way is the origin, 1.2 m above the
floor. Panoramas are equirectangular as everywhere (`lightprobe.geometry`), radiance in float.
Renders are kept in build/furnished; `python tests/accuracy/furnished_rooms.py KIND SEED` makes one.
Fast only with LLVM (Debian's libllvm19); with Mitsuba's scalar variant a room takes hours.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from lightprobe.geometry import Array
from numpy.typing import NDArray

KINDS = ("box", "L", "window", "table")
#: Whoever changes what is rendered counts on: what is kept is of no use then.
VERSION = 1
KEPT = Path(__file__).resolve().parents[2] / "build/furnished"
#: Where Debian has LLVM, which Mitsuba's own search does not find.
_LLVM = Path("/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1")
SIZE_PX, NODES, SAMPLES = (480, 240), 60, 32
TRUTH_PX, TRUTH_SAMPLES = (128, 64), 256
#: Distances from the middle of the way, and how many places are at each.
TRUTH_M = {0.0: 1, 0.5: 4, 1.0: 4}
_FLOOR_M = -1.2
#: Furniture keeps away from the head's way, so that no place is in it.
_FREE_M = 1.35
_DEPTH = 5  # of paths of light


def way_m(share: Array) -> Array:
    """Places (..., 3) of the head by the share 0...1 of its way; the origin in the middle."""
    s = 2 * np.pi * (np.asarray(share) - 0.5)
    return np.stack([0.25 * np.sin(0.9 * s), 0.1 * np.sin(1.7 * s), 0.25 * np.sin(1.3 * s)], -1)


def node_shares() -> Array:
    """Shares (NODES,) of the way at which panoramas are rendered: as far from one to the next."""
    fine = np.linspace(0, 1, 4001)
    gone_m = np.concatenate([[0], np.linalg.norm(np.diff(way_m(fine), axis=0), axis=-1).cumsum()])
    return np.interp(np.linspace(0, gone_m[-1], NODES), gone_m, fine)


@dataclass(frozen=True, eq=False)
class Renders:
    """What is rendered of one room, of a radiance that is the room's own."""

    nodes: NDArray[np.float16]  # (NODES, H, W, 3), at the places of `node_shares`
    places_m: Array  # (P, 3), one after the other as TRUTH_M has them
    unlit: Array  # (P, H, W, 3) from there: emitters light the room, and are not seen
    lit: Array  # (P, H, W, 3): the same, they are seen
    emitters_m: Array  # (E, 3) their centres


# ---------------------------------------------------------------- what stands in a room


class _Made:
    """A Mitsuba scene as it is put together."""

    def __init__(self, mi: Any, seed: int) -> None:
        self.mi, self.rng = mi, np.random.default_rng(seed)
        self.scene: dict[str, Any] = {"type": "scene"}
        self.emitters_m: list[Array] = []

    def turn(self, *steps: Sequence[float]) -> Any:
        """Give a transform: moved by the first three, then (axis, degrees), scaled by the last."""
        first, *turns, scale = steps
        place = self.mi.ScalarTransform4f().translate([float(x) for x in first])
        for x, y, z, angle_deg in turns:
            place = place.rotate([x, y, z], float(angle_deg))
        return place.scale([float(x) for x in scale])

    def add(self, name: str, shape: str, to_world: Any, bsdf: dict[str, Any], **more: Any) -> None:
        """Put something in."""
        self.scene[name] = {"type": shape, "to_world": to_world, "bsdf": bsdf, **more}

    def matte(self, *colour: float) -> dict[str, Any]:
        """Give a plain colour."""
        value = [float(x) for x in colour]
        flat = {"type": "diffuse", "reflectance": {"type": "rgb", "value": value}}
        return {"type": "twosided", "bsdf": flat}

    def pictures(self, size: int = 64) -> dict[str, Any]:
        """Give a plain colour with rectangles of other colours on it, as walls with pictures."""
        rng = self.rng
        texture = np.zeros((size, size, 3), np.float32)
        texture[:] = rng.uniform(0.35, 0.75) * rng.uniform(0.85, 1, 3)
        for _ in range(rng.integers(3, 9)):
            left, top = rng.integers(0, size - 8, 2)
            width, height = rng.integers(5, 24, 2)
            colour = rng.uniform(0.03, 0.85) * rng.uniform(0.5, 1, 3)
            texture[top : top + height, left : left + width] = colour
        bitmap = {
            "type": "bitmap", "bitmap": self.mi.Bitmap(texture), "raw": True,
            "filter_type": "bilinear",
        }  # fmt: skip
        return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": bitmap}}

    def wall(self, name: str, a: Array, b: Array, low: float, high: float) -> None:
        """Put up a wall from (x, z) `a` to `b`."""
        middle, half = (a + b) / 2, np.linalg.norm(b - a) / 2
        to_world = self.turn(
            (middle[0], (low + high) / 2, middle[1]), (0, 1, 0, _yaw_deg(a, b)),
            (half, (high - low) / 2, 1),
        )  # fmt: skip
        self.add(name, "rectangle", to_world, self.pictures())

    def windowed(self, name: str, a: Array, b: Array, low: float, high: float) -> None:
        """Put up a wall with a window in the middle of it, which shines."""
        left, right = a + 0.3 * (b - a), a + 0.7 * (b - a)
        sill, top = low + 0.9, high - 0.4
        self.wall(f"{name}a", a, left, low, high)
        self.wall(f"{name}b", right, b, low, high)
        self.wall(f"{name}c", left, right, low, sill)
        self.wall(f"{name}d", left, right, top, high)
        middle, half = (a + b) / 2, np.linalg.norm(right - left) / 2
        centre = np.array([middle[0], (sill + top) / 2, middle[1]])
        to_world = self.turn(
            centre, (0, 1, 0, _yaw_deg(a, b)), (half, (top - sill) / 2, 0.01)
        )  # fmt: skip
        self.shine("window", "cube", centre, to_world, [5.0, 6.0, 7.5])

    def shine(self, name: str, shape: str, centre: Array, to_world: Any, radiance: Any) -> None:
        """Put in something black that shines."""
        black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0}}
        value = {"type": "rgb", "value": [float(x) for x in radiance]}
        self.add(f"em_{name}", shape, to_world, black, emitter={"type": "area", "radiance": value})
        self.emitters_m.append(centre)


def _yaw_deg(a: Array, b: Array) -> float:
    return float(np.degrees(np.arctan2(-(b - a)[1], (b - a)[0])))


def made(mi: Any, kind: str, seed: int) -> tuple[dict[str, Any], Array]:
    """Give a room without a sensor, and the centres (E, 3) of what shines in it."""
    m = _Made(mi, seed)
    rng = m.rng
    ceiling = rng.uniform(1.2, 1.6)
    low, high = -rng.uniform(1.5, (3, 3.2)), rng.uniform(1.5, (3, 3.2))  # x, z
    corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    if kind == "L":
        notch, wide, deep = 0.45 * high[1], high[0] + 2.5, high[1] + 1.5
        corners[2:] = [(high[0], notch), (wide, notch), (wide, deep), (low[0], deep)]
    yaw = np.radians(rng.uniform(0, 30))
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    floor_plan = [turn @ np.array(corner) for corner in corners]
    for k, a in enumerate(floor_plan):
        b = floor_plan[(k + 1) % len(floor_plan)]
        put = m.windowed if kind == "window" and k == 1 else m.wall
        put(f"wall{k}", a, b, _FLOOR_M, ceiling)
    level = m.turn((0, _FLOOR_M, 0), (1, 0, 0, -90), (9, 9, 9))
    m.add("floor", "rectangle", level, m.pictures())
    level = m.turn((0, ceiling, 0), (1, 0, 0, 90), (9, 9, 9))
    m.add("ceiling", "rectangle", level, m.matte(0.75, 0.75, 0.73))
    for k in range(1 if kind == "window" else 2):
        x, z = turn @ rng.uniform(0.6 * low, 0.6 * high)
        radius_m = rng.uniform(0.08, 0.2)
        radiance = rng.uniform(20, 60) * (0.15 / radius_m) ** 2 * np.array([1, 0.85, 0.65])
        centre = np.array([x, ceiling - 0.03, z])
        to_world = m.turn(centre, (1, 0, 0, 90), (radius_m, radius_m, 1))
        m.shine(f"lamp{k}", "rectangle", centre, to_world, radiance)
    _furnish(m, lambda: turn @ rng.uniform(low + 0.3, high - 0.3))
    if kind == "table":
        x, z = rng.uniform(-0.35, 0.35, 2)
        to_world = m.turn((x, -0.35, z), (0, 1, 0, rng.uniform(0, 90)), (0.8, 0.02, 0.45))
        m.add("desk", "cube", to_world, m.pictures())
    return m.scene, np.array(m.emitters_m)


def _furnish(m: _Made, anywhere: Callable[[], Array]) -> None:
    """Put three to six boxes on the floor; `anywhere`: a place (x, z) within the walls."""
    rng = m.rng
    for k in range(rng.integers(3, 7)):
        tried = [anywhere() for _ in range(50)]
        x, z = next((at for at in tried if np.hypot(*at) > _FREE_M), tried[-1])
        half_high, (half_wide, half_deep) = rng.uniform(0.15, 0.45), rng.uniform(0.15, 0.45, 2)
        to_world = m.turn(
            (x, _FLOOR_M + half_high, z), (0, 1, 0, rng.uniform(0, 90)),
            (half_wide, half_high, half_deep),
        )  # fmt: skip
        colour = rng.uniform(0.1, 0.7) * rng.uniform(0.5, 1, 3)
        m.add(f"box{k}", "cube", to_world, m.matte(*colour))


# ---------------------------------------------------------------- renders


@lru_cache(maxsize=1)
def mitsuba() -> Any:
    """Give Mitsuba, with an equirectangular sensor, which it has not of its own."""
    if _LLVM.is_file():
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(_LLVM))
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb" if "DRJIT_LIBLLVM_PATH" in os.environ else "scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)

    class Equirect(mi.Sensor):  # type: ignore[misc,name-defined]
        """All directions. Its own axes: +z ahead, +y up, +x to the left, as Mitsuba's cameras."""

        def sample_ray(
            self, time: Any, wavelength: Any, at: Any, aperture: Any, active: Any = True
        ) -> Any:
            """Give a ray of a place in the picture, and its weight: pixels are radiance."""
            waves, weight = self.sample_wavelengths(
                dr.zeros(mi.SurfaceInteraction3f), wavelength, active
            )
            sin_down, cos_down = dr.sincos(at.y * dr.pi)
            sin_right, cos_right = dr.sincos((at.x - 0.5) * dr.two_pi)
            towards = mi.Vector3f(-sin_down * sin_right, cos_down, sin_down * cos_right)
            to_world = self.world_transform()
            ray = mi.Ray3f(to_world @ mi.Point3f(0, 0, 0), to_world @ towards, time, waves)
            return ray, weight

        def sample_ray_differential(
            self, time: Any, wavelength: Any, at: Any, aperture: Any, active: Any = True
        ) -> Any:
            """Give the same, for textures, without how it differs from its neighbours'."""
            ray, weight = self.sample_ray(time, wavelength, at, aperture, active)
            differential = mi.RayDifferential3f(ray)
            differential.has_differentials = False
            return differential, weight

        def bbox(self) -> Any:
            """Give no extent."""
            return mi.BoundingBox3f()

    mi.register_sensor("equirect", Equirect)
    return mi


def panorama(
    mi: Any, scene: dict[str, Any], place_m: Array, size_px: tuple[int, int], samples: int,
    seed: int, *, hidden: bool,
) -> Array:  # fmt: skip
    """Render radiance (H, W, 3) from a place; `hidden`: emitters are not seen themselves."""
    at = [float(x) for x in place_m]
    sensor = {
        "type": "equirect",
        "to_world": mi.ScalarTransform4f().look_at(
            origin=at, target=[at[0], at[1], at[2] - 1], up=[0, 1, 0]
        ),
        "film": {
            "type": "hdrfilm", "width": size_px[0], "height": size_px[1],
            "rfilter": {"type": "box"}, "pixel_format": "rgb", "component_format": "float32",
        },
        "sampler": {"type": "independent", "sample_count": samples},
    }  # fmt: skip
    integrator = {"type": "path", "max_depth": _DEPTH, "hide_emitters": hidden}
    whole = mi.load_dict(scene | {"integrator": integrator, "sensor": sensor})
    return np.array(mi.render(whole, spp=samples, seed=seed), np.float32)


def truth_places_m(seed: int) -> Array:
    """Places (P, 3) around the origin, as many at each distance as TRUTH_M says."""
    rng = np.random.default_rng([seed, 7])
    found = []
    for distance_m, number in TRUTH_M.items():
        azimuths = rng.uniform(0, 2 * np.pi) + np.arange(number) * 2 * np.pi / number
        for azimuth in azimuths:
            up = rng.uniform(-0.2, 0.3)
            level = np.sqrt(1 - up**2)
            towards = np.array([level * np.cos(azimuth), up, level * np.sin(azimuth)])
            found.append(distance_m * towards)
    return np.array(found)


@dataclass(frozen=True)
class Quality:
    """Samples per pixel."""

    name: str
    nodes: int
    truth: int


FINE = Quality("", SAMPLES, TRUTH_SAMPLES)
#: A third of the time.
COARSE = Quality("-coarse", 8, 128)


def folder(kind: str, seed: int, quality: Quality = FINE) -> Path:
    """Say where a room is kept."""
    return KEPT / f"{VERSION}-{kind}-{seed}{quality.name}"


def renders(kind: str, seed: int, quality: Quality = FINE) -> Renders:
    """Render a room, or read what is kept of it."""
    kept = folder(kind, seed, quality)
    if not kept.is_dir():
        _render(kind, seed, kept, quality)
    names = ("nodes", "places_m", "unlit", "lit", "emitters_m")
    return Renders(*(np.load(kept / f"{name}.npy") for name in names))


def _render(kind: str, seed: int, kept: Path, quality: Quality) -> None:
    mi = mitsuba()
    scene, emitters_m = made(mi, kind, seed)
    places_m = truth_places_m(seed)

    def seen(hidden: bool) -> Array:
        return np.array([
            panorama(mi, scene, at, TRUTH_PX, quality.truth, 1000 + k, hidden=hidden)
            for k, at in enumerate(places_m)
        ])  # fmt: skip

    nodes = [
        panorama(mi, scene, at, SIZE_PX, quality.nodes, k, hidden=False)
        for k, at in enumerate(way_m(node_shares()))
    ]
    partly = kept.with_name(f"{kept.name}.{os.getpid()}")
    partly.mkdir(parents=True)
    for name, values in {
        "nodes": np.array(nodes, np.float16), "places_m": places_m, "unlit": seen(True),
        "lit": seen(False), "emitters_m": emitters_m, "nodes_m": way_m(node_shares()),
    }.items():  # fmt: skip
        np.save(partly / f"{name}.npy", values)
    partly.rename(kept)


if __name__ == "__main__":
    renders(sys.argv[1], int(sys.argv[2]))
    print(folder(sys.argv[1], int(sys.argv[2])))
