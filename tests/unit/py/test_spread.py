"""What lenses see of a small lamp: as much, wherever it lies between their pixels."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.geometry import Array
from lightprobe.imaging.camera import Camera, Lens
from lightprobe.imaging.metadata import crop_of
from lightprobe.lamp import Lamp
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.motion import Track
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.scene import ProceduralScene
from lightprobe.sim.spread import SIGMA_PX, map_px, pitch_rad, spread
from lightprobe.sim.world import Behaviour, World

FOCAL_PX, SIDE_PX = 60.0, 400
PITCH_RAD = 1 / FOCAL_PX
#: Equidistant, and sees all of the sphere: r = f·θ up to 180°.
ALL_ROUND = Camera(
    "all round", SIDE_PX, SIDE_PX,
    (Lens((SIDE_PX / 2, SIDE_PX / 2), (FOCAL_PX, FOCAL_PX), (0, 0, 0, 0), 180),),
)  # fmt: skip


def solid_angles() -> Array:
    """Of the lens' pixels (H, W), sr: the derivative of the projection, 0 behind its rim."""
    offset = (np.arange(SIDE_PX) + 0.5 - SIDE_PX / 2) / FOCAL_PX
    theta = np.hypot(offset[:, None], offset[None, :])
    return np.where(theta < np.pi, np.sinc(theta / np.pi), 0) / FOCAL_PX**2


def rotations(count: int) -> Array:
    drawn = np.random.default_rng(7).normal(size=(count, 4))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


@cache
def sunny() -> ProceduralScene:
    """One lamp much smaller than a pixel, which casts more light than all of the rest."""
    background = random_scene(5).background
    flux = 1.5 * np.pi * background[0] * 0.282
    return ProceduralScene("sunny", background, (Lamp(np.array([0.6, 0.64, 0.48]), 0.2, flux),))


def test_all_light_is_seen_however_the_lens_is_turned() -> None:
    directions = np.nan_to_num(ALL_ROUND.look(SIDE_PX, SIDE_PX)[0]).reshape(-1, 3)
    weight, found = solid_angles().reshape(-1, 1), []
    for rotation in rotations(24):
        track = Track(np.zeros(1), rotation[None], np.zeros((1, 3)))
        world = World([sunny()], Behaviour(act_s=0, path=track))
        camera = SimulatedCamera(world, ALL_ROUND, (SIDE_PX, SIDE_PX), pixel_format="RGBF")
        seen = np.frombuffer(camera.frame(0, Shot(10.0)), "<f4").reshape(-1, 3) * weight
        truth = world.at(0.0).truth()
        normals = np.stack([truth.lamps[0].direction, -truth.lamps[0].direction])
        cast = np.maximum(normals @ directions.T, 0) @ seen
        found.append(cast / truth.irradiance(normals))
    assert np.mean(found) == pytest.approx(1, abs=0.003)
    assert np.ptp(found, axis=0).max() < 0.01  # ± 0.5 %
    assert np.std(found, axis=0).max() < 0.003


@pytest.mark.parametrize("row", [0, 1, 4, 30, 120])
def test_spreading_keeps_light_and_place(row: int) -> None:
    width, height = map_px(ALL_ROUND, (SIDE_PX, SIDE_PX))
    solid_angle = geometry.equirect_solid_angles(width, height)[:, None]
    point = np.zeros((height, width, 3), np.float32)
    point[row, 3] = 1 / solid_angle[row, 0]
    found = spread(point, PITCH_RAD)[..., 0].astype(np.float64) * solid_angle
    assert found.min() >= 0
    assert found.sum() == pytest.approx(1, abs=1e-3)
    directions = geometry.equirect_directions(width, height)
    centre = geometry.normalize(np.tensordot(found, directions))
    off_deg = geometry.angle_deg(centre, directions[row, 3])
    assert off_deg < 0.5 * 180 / height  # half of one of the map's pixels, at a pole
    angles = np.radians(geometry.angle_deg(directions, centre))
    sigma_px = np.sqrt((found * angles**2).sum() / 2) / PITCH_RAD
    assert sigma_px == pytest.approx(SIGMA_PX, rel=0.15)  # the lookup blurs the rest


def test_an_even_map_stays_even() -> None:
    assert spread(np.ones((101, 202, 3), np.float32), PITCH_RAD) == pytest.approx(1, abs=1e-5)


def test_the_pitch_is_that_of_the_coarsest_pixels() -> None:
    (lens,) = ALL_ROUND.lenses
    assert pitch_rad(ALL_ROUND, (SIDE_PX, SIDE_PX)) == pytest.approx(PITCH_RAD)
    assert pitch_rad(ALL_ROUND, (SIDE_PX // 2, SIDE_PX)) == pytest.approx(2 * PITCH_RAD)
    two = Camera("two", SIDE_PX, SIDE_PX, (lens, lens.scaled(0.5, 0.5)))
    assert pitch_rad(two, (SIDE_PX, SIDE_PX)) == pytest.approx(2 * PITCH_RAD)
    part = Camera("part", 960, 480, crop=crop_of(480, 240, 960, 480, 1920, 960))
    assert pitch_rad(part, (960, 480)) == pytest.approx(2 * np.pi / 1920)
