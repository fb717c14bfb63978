"""A room with a glossy table and a framed picture, by Mitsuba 3, with a sheet before it or none.

The renderer knows polarization by itself: Fresnel at rough plastic, and a sheet polarizer that
stands as an object before its pinhole. Directions as everywhere: +X right, +Y up, -Z ahead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from lightprobe.colour import luminance
from lightprobe.geometry import Array
from numpy.typing import NDArray

VARIANT = "scalar_spectral_polarized"
FIELD_DEG = 100.0


@dataclass(frozen=True)
class Pinhole:
    """What :mod:`lightprobe.imaging.polarizer` asks of a camera, for a pinhole that looks ahead."""

    lenses: tuple[()] = ()

    def look(self, width_px: int, height_px: int) -> tuple[Array, Array]:
        """Directions (H, W, 3) of the pixels, and their illumination."""
        half = np.tan(np.radians(FIELD_DEG / 2))
        x = half * (2 * (np.arange(width_px) + 0.5) / width_px - 1)
        y = half * (1 - 2 * (np.arange(height_px) + 0.5) / height_px) * height_px / width_px
        directions = np.stack(
            [*np.broadcast_arrays(x[None, :], y[:, None], np.float64(-1.0))], axis=-1
        )
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return directions, np.ones((height_px, width_px))

    def owner(self, width_px: int, height_px: int) -> NDArray[np.intp]:
        """One lens for all pixels."""
        return np.zeros((height_px, width_px), np.intp)


def room(mi: Any) -> dict[str, Any]:
    """Walls, two lamps, a varnished table and a picture behind glass on the left wall."""
    place = mi.ScalarTransform4f

    def matte(share: float) -> dict[str, Any]:
        flat = {"type": "diffuse", "reflectance": {"type": "uniform", "value": share}}
        return {"type": "twosided", "bsdf": flat}

    def glossy(share: float) -> dict[str, Any]:
        return {
            "type": "pplastic", "alpha": 0.05, "int_ior": 1.5,
            "diffuse_reflectance": {"type": "uniform", "value": share},
        }  # fmt: skip

    def lamp(radiance: float) -> dict[str, Any]:
        return {"type": "area", "radiance": {"type": "uniform", "value": radiance}}

    def wall(at: Sequence[float], size: Sequence[float], bsdf: dict[str, Any], *turn: Any) -> Any:
        to_world = place().translate(list(at))
        if turn:
            to_world = to_world.rotate(list(turn[0]), turn[1])
        return {
            "type": "rectangle", "to_world": to_world.scale([*size, 1]), "bsdf": bsdf,
        }  # fmt: skip

    x, y = (1, 0, 0), (0, 1, 0)
    return {
        "floor": wall((0, -1.5, 0), (4, 4), matte(0.3), x, -90),
        "ceiling": wall((0, 1.5, 0), (4, 4), matte(0.7), x, 90),
        "ahead": wall((0, 0, -4), (4, 1.5), matte(0.6)),
        "behind": wall((0, 0, 4), (4, 1.5), matte(0.6), y, 180),
        "right": wall((4, 0, 0), (4, 1.5), matte(0.5), y, -90),
        "left": wall((-4, 0, 0), (4, 1.5), matte(0.5), y, 90),
        "table": wall((0, -0.8, -1.2), (1.4, 0.8), glossy(0.08), x, -90),
        "picture": wall((-1.5, 0.1, -1.3), (1.1, 0.5), glossy(0.05), y, 90),
        "panel": wall((0.3, 1.45, -3.0), (0.9, 0.4), matte(0), x, 90) | {"emitter": lamp(20)},
        "window": wall((1.5, 0.1, -3.9), (0.8, 0.8), matte(0)) | {"emitter": lamp(8)},
    }


def render(size_px: int, samples: int, sheet_deg: float | None = None, seed: int = 0) -> Array:
    """Stokes parameters (H, W, 3) of luminance; behind an ideal sheet only S0 is of use."""
    import mitsuba as mi

    mi.set_variant(VARIANT)
    place = mi.ScalarTransform4f
    scene = {
        "type": "scene",
        "integrator": {"type": "stokes", "nested": {"type": "path", "max_depth": 6}},
        "sensor": {
            "type": "perspective", "fov": FIELD_DEG, "near_clip": 1e-3,
            "to_world": place().look_at(origin=[0, 0, 0], target=[0, 0, -1], up=[0, 1, 0]),
            "film": {
                "type": "hdrfilm", "width": size_px, "height": size_px,
                "rfilter": {"type": "box"}, "pixel_format": "luminance",
                "component_format": "float32",
            },
            "sampler": {"type": "independent", "sample_count": samples, "seed": seed},
        },
        **room(mi),
    }  # fmt: skip
    if sheet_deg is not None:
        # Its angle is clockwise as seen from here.
        scene["sheet"] = {
            "type": "rectangle", "to_world": place().translate([0, 0, -0.01]).scale(0.15),
            "bsdf": {"type": "polarizer", "theta": -sheet_deg},
        }  # fmt: skip
    picture = np.array(mi.render(mi.load_dict(scene), spp=samples, seed=seed), np.float64)
    rgb = picture[..., 1:13].reshape(size_px, size_px, 4, 3)  # after the luminance
    return luminance(rgb)[..., :3]
