"""Drawn rooms with panes of glass, varnished floors, LCD screens and windows on a blue sky."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lightprobe import geometry, sh
from lightprobe.colour import luminance
from lightprobe.geometry import Array
from lightprobe.sim.glossy import GlossyRoom, Mirror, Panel, Screen, Window
from lightprobe.sim.polarized import Sky
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.scene import ProceduralScene

_TRIES = 300
#: Between things that stand around, and between them and lamps.
_GAP_DEG = 3.0
_PANES = 2
#: Of images in panes. Seen nearly straight on, glass polarizes nothing.
_INCIDENCE_DEG, _MOST_ELEVATION_DEG = (20.0, 80.0), 40.0


def glossy_room(seed: int) -> GlossyRoom:
    """Draw room number `seed`: the lamps of that random scene, each at a distance.

    Two upright panes of glass stand where they show a lamp, if there is such a place; one LCD
    screen faces the probe. Every second room has a varnished floor, every other pair a window.
    """
    rng = np.random.default_rng([seed, 0x610557])
    scene = random_scene(seed)
    floor_m = rng.uniform(1.0, 1.5)
    places = [_distance_m(lamp.direction, floor_m, rng) * lamp.direction for lamp in scene.lamps]
    wall = float(luminance(sh.radiance(scene.background, geometry.sphere_normals(2))).mean())
    taken = [(lamp.direction, lamp.radius_deg) for lamp in scene.lamps]
    panes = [_free(lambda: _pane(places, rng), taken) for _ in range(_PANES)]
    screen = _free(
        lambda: _facing(rng, (0.6, 1.5), np.exp(rng.uniform(*np.log([0.12, 0.6])))), taken
    )
    window = _free(lambda: _facing(rng, (1.5, 3.5), rng.uniform(0.6, 1.5)), taken)
    mirrors = [Mirror(pane) for pane in panes if pane is not None]
    if seed % 2:
        mirrors.append(Mirror(Panel(np.array([0, -floor_m, 0]), np.array([0.0, 1, 0]), 9.0, 9.0)))
    return GlossyRoom(
        ProceduralScene(f"{seed}", scene.background, scene.lamps),
        tuple(float(np.linalg.norm(place)) for place in places),
        tuple(mirrors),
        () if screen is None else (_lit(screen, wall, rng),),
        () if window is None or seed // 2 % 2 == 0 else (_open(window, wall, rng),),
    )


def _distance_m(direction: Array, floor_m: float, rng: np.random.Generator) -> float:
    """A lamp's, above the floor."""
    most_m = 6.0 if direction[1] > -0.1 else min(6.0, 0.9 * floor_m / -direction[1])
    return float(rng.uniform(min(1.5, most_m), most_m))


def _pane(places: list[Array], rng: np.random.Generator) -> Panel | None:
    """A pane that shows a lamp, near its middle; None: not where this one was tried."""
    lamp = places[rng.integers(len(places))]
    normal = geometry.direction_from_angles(rng.uniform(-180, 180), 0)
    away_m, (width_m, height_m) = rng.uniform(0.3, 1.5), rng.uniform(0.4, 1.2, 2)
    before_m = float(lamp @ normal) + away_m
    image = geometry.normalize(lamp - 2 * before_m * normal)
    incidence_deg = float(np.degrees(np.arccos(np.clip(-(image @ normal), -1, 1))))
    elevation_deg = float(np.degrees(np.arcsin(image[1])))
    if before_m < 0 or not _INCIDENCE_DEG[0] < incidence_deg < _INCIDENCE_DEG[1]:
        return None
    if abs(elevation_deg) > _MOST_ELEVATION_DEG:
        return None
    centre = image * away_m / -(image @ normal)
    aside, up = np.cross([0.0, 1.0, 0.0], normal), np.array([0.0, 1.0, 0.0])
    shift = rng.uniform(-0.25, 0.25, 2) * [width_m, height_m]
    return Panel(centre + shift[0] * aside + shift[1] * up, normal, width_m, height_m)


def _facing(rng: np.random.Generator, away_m: tuple[float, float], width_m: float) -> Panel:
    """Something upright that nearly faces the probe."""
    azimuth_deg = rng.uniform(-180, 180)
    direction = geometry.direction_from_angles(azimuth_deg, rng.uniform(-25, 10))
    turned = geometry.direction_from_angles(azimuth_deg + rng.uniform(-25, 25), 0)
    return Panel(rng.uniform(*away_m) * direction, -turned, float(width_m), float(width_m) * 0.6)


def _free(draw: Callable[[], Panel | None], taken: list[tuple[Array, float]]) -> Panel | None:
    """A panel before or behind which nothing is; it is added to what is `taken`. None: no place."""
    for _ in range(_TRIES):
        panel = draw()
        if panel is None:
            continue
        away_m = float(np.linalg.norm(panel.centre_m))
        reach_m = float(np.hypot(panel.width_m, panel.height_m)) / 2
        radius_deg = float(np.degrees(np.arctan(reach_m / away_m)))
        direction = panel.centre_m / away_m
        gaps = [
            float(geometry.angle_deg(direction, other)) - radius_deg - reach_deg - _GAP_DEG
            for other, reach_deg in taken
        ]
        if min(gaps, default=1.0) > 0:
            taken.append((direction, radius_deg))
            return panel
    return None


def _lit(panel: Panel, wall: float, rng: np.random.Generator) -> Screen:
    """As screens are made: the light of some swings aslant, of others upright or level."""
    field_deg = float(rng.choice([0.0, 45.0, 90.0, 135.0]))
    tint = np.array([0.95, 1.0, 1.1])
    return Screen(panel, rng.uniform(2.0, 8.0) * wall * tint, field_deg)


def _open(panel: Panel, wall: float, rng: np.random.Generator) -> Window:
    """A window; the sun is elsewhere."""
    azimuth_deg, _ = geometry.angles_from_direction(panel.centre_m)
    sun_deg = float(azimuth_deg) + rng.uniform(60, 300)
    return Window(panel, Sky(rng.uniform(15, 60), sun_deg, brightness=wall * rng.uniform(3, 15)))
