"""Mirrors, screens and windows of the simulator: against closed forms and the varnished floor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe import geometry
from lightprobe.geometry import Array
from lightprobe.imaging.polarizer import pixel_frame
from lightprobe.lamp import Lamp
from lightprobe.sim import scenes
from lightprobe.sim.glossy import GlossyRoom, Mirror, Panel, Screen, Window
from lightprobe.sim.glossy_rooms import glossy_room
from lightprobe.sim.polarized import PolishedFloor, Sky, fresnel
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.scene import ProceduralScene

AHEAD = np.array([0.0, 0.0, -1.0])
DARK = np.zeros((9, 3))
angles = st.floats(-180, 180)


def wall(normal_deg: float, away_m: float = 1.0, size_m: float = 50.0) -> Panel:
    """A wall whose normal points so far to the right."""
    normal = geometry.direction_from_angles(normal_deg, 0.0)
    return Panel(-away_m * normal, normal, size_m, size_m)


def plain(count: int = 1) -> Array:
    """Unpolarized light of radiance 1."""
    stokes = np.zeros((count, 3, 3))
    stokes[:, 0] = 1
    return stokes


@given(normal_deg=angles, aside_deg=st.floats(-85, 85), up_deg=st.floats(-60, 60))
def test_what_glass_mirrors_is_polarized_by_fresnel(
    normal_deg: float, aside_deg: float, up_deg: float
) -> None:
    """Across the plane of incidence: along normal × direction."""
    mirror = Mirror(wall(normal_deg))
    looking = -geometry.direction_from_angles(normal_deg + aside_deg, up_deg)[None]
    s0, s1, s2 = mirror.light(plain(), mirror.towards(looking), looking)[0, :, 0]
    cosine = -(looking @ mirror.panel.normal)[0]
    across, along = fresnel(np.degrees(np.arccos(np.clip(cosine, -1, 1))), 1.5)
    assert s0 == pytest.approx((across + along) / 2, rel=1e-6)
    assert np.hypot(s1, s2) == pytest.approx((across - along) / 2, abs=1e-7)
    field = np.cross(mirror.panel.normal, looking[0])
    right, up = pixel_frame(looking[0])
    if np.linalg.norm(field) > 0.05:
        turn = 2 * np.arctan2(field @ up, field @ right)
        assert [s1, s2] == pytest.approx(np.hypot(s1, s2) * np.array([np.cos(turn), np.sin(turn)]),
                                         abs=1e-7)  # fmt: skip


@given(seed=st.integers(0, 2**32 - 1))
def test_mirrors_make_no_light(seed: int) -> None:
    """No more leaves than arrives, and none of it is more than wholly polarized."""
    rng = np.random.default_rng(seed)
    mirror = Mirror(wall(rng.uniform(-180, 180)))
    looking = geometry.normalize(rng.normal(size=(20, 3)) - 2 * mirror.panel.normal)
    looking = looking[looking @ mirror.panel.normal < 0]
    stokes = plain(len(looking))
    turn = rng.uniform(0, 2 * np.pi, len(looking))[:, None]
    stokes[:, 1], stokes[:, 2] = np.cos(turn), np.sin(turn)
    s0, s1, s2 = np.moveaxis(mirror.light(stokes, mirror.towards(looking), looking), 1, 0)
    assert np.all(s0 <= 1 + 1e-9)
    assert np.hypot(s1, s2) == pytest.approx(s0, rel=1e-6)  # one field in, one field out


def test_a_level_mirror_is_a_varnished_floor() -> None:
    """Far below and wide, over light that is polarized itself: as PolishedFloor has it."""
    sky = Sky()
    floor = Mirror(Panel(np.array([0.0, -1.0, 0.0]), np.array([0.0, 1.0, 0.0]), 1e3, 1e3))
    directions = geometry.equirect_directions(64, 32)
    looking = directions[20:].reshape(-1, 3)
    towards = floor.towards(looking)
    found = floor.light(sky.stokes(towards), towards, looking)
    bare, varnished = sky.render(64, 32), PolishedFloor(sky).render(64, 32)
    assert bare.polarized is not None
    assert varnished.polarized is not None
    s0 = (varnished.base - bare.base)[20:].reshape(-1, 3)
    s12 = (varnished.polarized - bare.polarized)[:, 20:].reshape(2, -1, 3)
    scale = float(s0.max())
    assert found[:, 0] == pytest.approx(s0, rel=1e-3, abs=1e-5 * scale)
    assert found[:, 1] == pytest.approx(s12[0], rel=1e-3, abs=1e-5 * scale)
    assert found[:, 2] == pytest.approx(s12[1], rel=1e-3, abs=1e-5 * scale)


def test_an_image_is_as_far_behind_the_pane_as_the_lamp_is_before_it() -> None:
    """A lamp 2 m to the right, a wall 1 m ahead: its image is at (2, 0, -2)."""
    lamp = Lamp(np.array([1.0, 0.0, 0.0]), 2.0, np.ones(3))
    room = GlossyRoom(ProceduralScene("one", DARK, (lamp,)), (2.0,), (Mirror(wall(180.0)),))
    (image,) = room.images
    assert image.lamp.direction == pytest.approx(np.array([1, 0, -1]) / np.sqrt(2))
    across, along = fresnel(45.0, 1.5)
    assert image.lamp.irradiance == pytest.approx((across + along) / 2 * np.ones(3) / 2, rel=2e-3)
    assert image.dolp == pytest.approx((across - along) / (across + along))
    layers = room.render(1024, 512)
    (layer,) = layers.lamps
    directions = geometry.equirect_directions(1024, 512).reshape(-1, 3)[layer.index]
    solid_angle = np.repeat(geometry.equirect_solid_angles(1024, 512), 1024)[layer.index]
    there = directions @ image.lamp.direction > np.cos(np.radians(5))
    flux = (layer.values[there] * solid_angle[there, None]).sum(axis=0)
    assert flux == pytest.approx(image.lamp.irradiance, rel=0.01)
    assert layer.polarized is not None
    s1, s2 = layer.polarized[:, there].sum(axis=(1, 2)) / layer.values[there].sum()
    assert [s1, s2] == pytest.approx([-image.dolp, 0.0], abs=0.01)  # an upright pane: upright


def test_panes_have_edges_and_backs() -> None:
    lamp = Lamp(np.array([1.0, 0.0, 0.0]), 2.0, np.ones(3))
    scene = ProceduralScene("one", DARK, (lamp,))
    small = Panel(np.array([0.0, 0.0, -1.0]), -AHEAD, 0.5, 0.5)
    assert not GlossyRoom(scene, (2.0,), (Mirror(small),)).images
    turned = Panel(np.array([0.0, 0.0, -1.0]), AHEAD, 50.0, 50.0)
    assert not GlossyRoom(scene, (2.0,), (Mirror(turned),)).images
    assert small.hit(np.zeros((1, 3)), AHEAD[None]) == pytest.approx([1.0])
    assert np.isinf(turned.hit(np.zeros((1, 3)), AHEAD[None]))
    assert np.isinf(small.hit(np.zeros((1, 3)), np.array([[0.5, 0.0, -np.sqrt(0.75)]])))


@given(field_deg=st.floats(0, 179), azimuth_deg=angles)
def test_a_screen_swings_as_it_is_made(field_deg: float, azimuth_deg: float) -> None:
    """Seen straight on, its field is that of its plane, and no mirror is needed for it."""
    direction = geometry.direction_from_angles(azimuth_deg, 0)
    panel = Panel(direction, -direction, 0.4, 0.3)
    screen = Screen(panel, np.array([1.0, 2.0, 3.0]), field_deg)
    s0, s1, s2 = screen.stokes(direction[None])[0]
    assert s0 == pytest.approx([1, 2, 3])
    turn = np.radians(2 * field_deg)
    assert s1 == pytest.approx(0.98 * np.cos(turn) * s0, abs=1e-6)
    assert s2 == pytest.approx(0.98 * np.sin(turn) * s0, abs=1e-6)


def test_screens_and_the_sky_are_seen_where_they_are_and_in_mirrors() -> None:
    screen = Screen(Panel(np.array([1.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]), 1.0, 1.0),
                    np.ones(3), 90.0)  # fmt: skip
    window = Window(Panel(np.array([-1.0, 0, 0]), np.array([1.0, 0, 0]), 1.0, 1.0), Sky())
    room = GlossyRoom(
        ProceduralScene("two", DARK, ()),
        (),
        (Mirror(wall(180.0)),),
        (screen,),
        (window,),
    )
    layers = room.render(64, 32)
    assert layers.polarized is not None

    def at(azimuth_deg: float) -> Array:
        column, row = geometry.equirect_pixel(
            geometry.direction_from_angles(azimuth_deg, -2.0), 64, 32
        )
        index = (round(float(row)), round(float(column)))
        return np.array([layers.base[index][0], *(part[index][0] for part in layers.polarized)])

    assert at(88.0) == pytest.approx([1, -0.98, 0], abs=0.02)
    assert at(-88.0)[0] == pytest.approx(Sky().stokes(AHEAD[None])[0, 0, 0], rel=1.0)
    for azimuth_deg in (26.0, -26.0):  # ahead there is nothing but the pane
        assert 0 < at(azimuth_deg)[0] < 0.5 * at(3.4 * azimuth_deg)[0]
    assert at(170.0)[0] == 0


@pytest.mark.parametrize("seed", range(6))
def test_drawn_rooms_are_physical_and_as_they_say(seed: int) -> None:
    """Nothing stands before a lamp; no light is more than wholly polarized."""
    room = glossy_room(seed)
    assert room.name == scenes.load([f"glossy:{seed + 1}"])[seed].name
    layers, powers = room.render(256, 128), np.ones(len(room.lamps))
    s0, (s1, s2) = layers.compose(powers), layers.compose_polarized(powers)
    assert np.all(np.hypot(s1, s2) <= s0 * (1 + 1e-4))
    assert s0.min() >= 0
    assert room.scaled(3.0).render(256, 128).compose(powers) == pytest.approx(3 * s0, rel=1e-4)
    for lamp, distance_m in zip(room.lamps, room.distances_m, strict=True):
        for panel in [one.panel for one in (*room.mirrors, *room.screens, *room.windows)]:
            assert float(panel.hit(np.zeros((1, 3)), lamp.direction[None])[0]) > distance_m
    assert len(room.lamps) == len(random_scene(seed).lamps)


def test_drawn_rooms_have_what_they_are_for() -> None:
    rooms = [glossy_room(seed) for seed in range(24)]
    assert sum(bool(room.images) for room in rooms) >= 20
    assert sum(len(room.screens) for room in rooms) >= 20
    assert sum(len(room.windows) for room in rooms) >= 8
