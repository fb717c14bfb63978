"""People and things that move around the probe: pictures, truth, ring and caches agree."""

from dataclasses import replace

import numpy as np
import pytest
from lightprobe import geometry, sh
from lightprobe.calibrate import ring
from lightprobe.colour import luminance
from lightprobe.imaging import camera as lenses
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.flicker import Flicker
from lightprobe.sim.illuminance import RingLight
from lightprobe.sim.moved import Canvas, change, patches
from lightprobe.sim.movers import Movers, Walker
from lightprobe.sim.polarized import Sky
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.room import Room
from lightprobe.sim.scene import MapTruth, PanoramaScene
from lightprobe.sim.truth import Exact
from lightprobe.sim.world import Behaviour, World

SIZE, SHOT = (960, 480), Shot(1000)
NORMALS = geometry.sphere_normals(2)
#: Each kind alone, and all of them; walkers pass before the room's standing lamp (34° right).
KINDS = {
    "far": Movers(walkers=2, walker_deg=34),
    "near": Movers(walkers=1, walker_m=0.7, walker_deg=34),
    "door": Movers(door_s=4),
    "leaves": Movers(leaves_deg=30),
    "screen": Movers(screen_deg=25),
    "all": Movers(walkers=3, walker_deg=34, door_s=4, leaves_deg=30, screen_deg=25),
}


def camera(scene, movers, pixel_format="RGBF", size=SIZE, **behaviour):
    world = World([scene], Behaviour(act_s=0, movers=movers, **behaviour))
    return SimulatedCamera(world, lenses.equirect(), size, rate_hz=30, pixel_format=pixel_format)


def floats(simulated, number):
    width, height = simulated.size_px
    return np.frombuffer(simulated.frame(number, SHOT), "<f4").reshape(height, width, 3)


def panorama():
    drawn = Room().render(1024, 512).compose(np.ones(4))
    return PanoramaScene.of("drawn", drawn)


@pytest.mark.parametrize(
    "scene",
    [Room(), panorama(), pytest.param(random_scene(3), marks=pytest.mark.nightly)],
    ids=lambda one: one.name,
)
@pytest.mark.parametrize("kind", KINDS)
def test_pictures_and_truth_agree(kind, scene):
    simulated, differs = camera(scene, KINDS[kind]), []
    for number in (15, 92, 96, 101):
        state = simulated.state(number, SHOT)
        truth = state.truth().irradiance(NORMALS)
        still = state.scene.truth(state.powers).irradiance(NORMALS)
        seen = MapTruth(floats(simulated, number)).irradiance(NORMALS)
        error = np.abs(seen - truth).max() / truth.max()
        assert error < 0.003
        differs.append(np.abs(still - truth).max() / truth.max())
    assert max(differs) > 0.01  # otherwise nothing is tested


def test_a_walker_takes_a_lamp_s_light_away_and_gives_it_back():
    simulated = camera(Room(), KINDS["near"])
    lamps = Room().lamps
    hidden = max(range(4), key=lambda k: -geometry.angle_deg(lamps[k].direction, [0.56, 0, -0.83]))
    seen = {}
    for number in (60, *range(84, 108, 2), 130):
        state = simulated.state(number, SHOT)
        more = change(state.movers, state.scene, state.powers)
        seen[number] = more.shares[hidden]
        total = state.truth().total
        assert total.shape == state.scene.truth(state.powers).total.shape
        there = sum(float(luminance(lamp.irradiance)) for lamp in state.truth().lamps)
        less = sum(
            share * float(luminance(lamp.irradiance))
            for share, lamp in zip(more.shares, lamps, strict=True)
        )
        assert there == pytest.approx(less, rel=2e-3)
    shares = list(seen.values())
    assert shares[0] == shares[-1] == pytest.approx(1)
    assert min(shares) == 0
    assert any(0.1 < share < 0.9 for share in shares)


@pytest.mark.parametrize("turn", [{"turn_deg_s": 50.0}, {"nod_deg": 15.0, "turn_deg_s": 50.0}])
def test_they_stay_where_they_are_while_the_camera_turns(turn):
    simulated = camera(Room(), KINDS["all"], **turn)
    for number in (10, 40):
        state = simulated.state(number, SHOT)
        state = replace(state, rotation=simulated.true_rotation(state))
        seen = MapTruth(floats(simulated, number)).irradiance(NORMALS)
        truth = state.truth().irradiance(NORMALS)
        assert np.abs(seen - truth).max() / truth.max() < 0.01
        still = replace(state, movers=()).truth().irradiance(NORMALS)
        assert np.abs(still - truth).max() / truth.max() > 0.05


def test_without_movers_the_bytes_are_the_same():
    """Whatever else is said of people who are not there."""
    plain = camera(Room(), Movers(), "MJPG", (256, 128), turn_deg_s=20)
    absent = Movers(walker_m=0.5, walker_m_s=3, walker_albedo=(1.0,), door_gain=9, leaves_hz=5)
    other = camera(Room(), absent, "MJPG", (256, 128), turn_deg_s=20)
    assert [plain.frame(k, SHOT) for k in range(4)] == [other.frame(k, SHOT) for k in range(4)]
    world = plain.world
    assert type(world.at(1).truth()) is type(Room().truth(np.ones(4)))


def test_noise_apart_a_picture_changes_only_where_somebody_moves():
    simulated, empty = (camera(Room(), movers) for movers in (KINDS["far"], Movers()))
    clean = floats(empty, 0)
    for number in (0, 40, 90, 41):  # also backwards: what was covered is drawn again
        seen = floats(simulated, number)
        state = simulated.state(number, SHOT)
        touched = np.zeros(SIZE[::-1], bool)
        for patch in patches(state.movers, SIZE, state.scene, state.powers):
            touched[patch.rows, patch.window.columns] = True
        assert np.array_equal(seen[~touched], clean[~touched])
        assert np.any(seen[touched] != clean[touched])
        assert touched.mean() < 0.1


def test_encoded_pictures_move_and_repeat_while_somebody_stands():
    standing = Movers(walkers=1, walker_stand_s=2)
    simulated = camera(Room(), standing, "MJPG", (256, 128))
    walking = [simulated.state(k, SHOT).movers for k in (90, 91)]
    assert walking[0] != walking[1]
    there = [simulated.state(k, SHOT).movers for k in (101, 150)]
    assert there[0] == there[1]
    assert there[0][0].distance_m == pytest.approx(standing.walker_m)
    kept = SimulatedCamera(simulated.world, lenses.equirect(), (256, 128), kept=1)
    assert kept.frame(101, SHOT) == kept.frame(150, SHOT) != kept.frame(91, SHOT)


def test_the_cylinder_of_a_person_covers_what_it_should():
    """At 28 cm a person hides a quarter of the sphere, at 2 m a hundredth."""
    for distance_m, least, most in ((0.28, 0.23, 0.27), (0.7, 0.06, 0.1), (2.0, 0.01, 0.02)):
        keep = np.ones((512, 1024, 1), np.float32)
        (patch,) = patches((Walker(20.0, distance_m, 1.75, 0.5),), (1024, 512), Room(), np.ones(4))
        patch.hide(keep)
        share = (1 - keep[..., 0]) @ np.ones(1024)
        share = float(share @ geometry.equirect_solid_angles(1024, 512)) / (4 * np.pi)
        assert least < share < most


def test_clothes_reflect_the_light_of_the_scene():
    dark, light = (
        patches((Walker(20.0, 2.0, 1.75, albedo),), (512, 256), Room(), np.ones(4))[0].light
        for albedo in (0.05, 0.7)
    )
    jacket = light[len(light) // 3, light.shape[1] // 2]
    assert jacket == pytest.approx(14 * dark[len(light) // 3, light.shape[1] // 2], rel=1e-3)
    truth = Room().truth(np.ones(4))
    towards = -geometry.direction_from_angles(20.0, 0.0)
    (there,) = truth.irradiance([towards])
    assert jacket == pytest.approx(0.7 / np.pi * there, rel=0.2)  # the lamps' light is of order 2
    half = patches((Walker(20.0, 2.0, 1.75, 0.7),), (512, 256), Room(), 0.5 * np.ones(4))[0].light
    assert half[len(light) // 3, light.shape[1] // 2] == pytest.approx(jacket / 2, rel=0.25)


@pytest.mark.parametrize("yaw_deg", [0.0, 50.0])
def test_the_ring_stands_in_their_shadow(yaw_deg):
    world = World([Room()], Behaviour(act_s=0, turn_deg_s=yaw_deg, movers=KINDS["near"]))
    light = RingLight(world, 2.0)
    state = world.at(96 / 30)
    lux = light.lux(state)
    truth = 2.0 * luminance(state.truth().irradiance(ring.directions()))
    assert lux == pytest.approx(truth, rel=0.02)
    assert np.abs(light.lux(replace(state, movers=())) / truth - 1).max() > 0.05


def test_the_published_truth_has_them():
    world = World([Room()], Behaviour(act_s=0, movers=KINDS["near"]))
    state = world.at(96 / 30)
    message = Exact().estimate(state, 1.0)
    exact = state.truth()
    assert len(message.lights) == len(exact.lamps) < 4
    total = np.reshape(message.sh.coefficients, (-1, 3)).copy()
    for lamp in message.lights:
        total += sh.lamp(lamp.direction, 4)[:, None] * np.array(lamp.irradiance)
    assert total == pytest.approx(exact.total[:25], abs=1e-3 * np.abs(exact.total).max())


def test_flickering_lamps_behind_somebody_do_not_shine_through():
    """With a rolling shutter each row has lamps of its own; those that are hidden add nothing."""
    flicker = Flicker(100, (0.9,))
    behaviour = Behaviour(act_s=0, nod_deg=1e-6, flicker=flicker, movers=KINDS["near"])
    still = replace(behaviour, flicker=Flicker())
    pictures = []
    for one in (behaviour, still):
        simulated = SimulatedCamera(
            World([random_scene(3)], one), lenses.equirect(), (256, 128), pixel_format="RGBF",
            row_time_us=100.0,
        )  # fmt: skip
        pictures.append(floats(simulated, 96))
    state = simulated.state(96, SHOT)
    (patch,) = patches(state.movers, (512, 256), state.scene, state.powers)
    keep = np.ones((256, 512, 1), np.float32)
    patch.hide(keep)
    covered = keep[::2, ::2, 0] == 0
    # Of what flickers only the light on the clothes is left there: no lamp is seen.
    assert pictures[0][covered].max() < 0.5 * pictures[0].max()
    assert covered.sum() > 500


def test_movers_hide_polarized_light_too():
    sky = Sky(30.0)
    world = World([sky], Behaviour(act_s=0, movers=Movers(leaves_deg=60)))
    state = world.at(0.5)
    layers = sky.render(256, 128)
    clean, stokes = layers.compose(state.powers), layers.compose_polarized(state.powers)
    seen, behind = Canvas().show(clean, stokes, state)
    changed = (seen != clean).any(axis=-1)
    assert changed.any()
    assert np.abs(behind[:, changed]).sum() < 0.9 * np.abs(stokes[:, changed]).sum()
    assert np.array_equal(behind[:, ~changed], stokes[:, ~changed])
