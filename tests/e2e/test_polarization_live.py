"""A wheel that sweeps before a varnished room while things go wrong, in simulated time.

Firmware in its box, wheel, film, camera and daemon. Whatever happens, no lamp is called a mirror
image; what is not known says so; and when it is over, mirror images are told again.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from harness import run
from lightprobe import geometry, sh
from lightprobe.colour import luminance
from lightprobe.estimate import (
    Estimate,
    EstimateFlag,
    Health,
    LightFlag,
    PolarizationMap,
    Refusal,
    SweepStarted,
)
from lightprobe.imaging import camera as lenses
from lightprobe.imaging.film import Sheet
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.live import LiveClient, LiveProbe
from lightprobe.sim.live_box import LiveBox
from lightprobe.sim.motion import angles_deg
from lightprobe.sim.polarized import PolishedFloor
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.scene import ProceduralScene
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription, encode_get_polarization_map, encode_start_sweep

pytestmark = pytest.mark.many_frames

SIZE_PX, RATE_HZ = (960, 480), 10.0
#: The wheel has homed and gone round its angles.
SWEPT_S = 14.0
#: Four lamps, three of them above the floor and mirrored where the film shows it.
ROOM = PolishedFloor(random_scene(8))


@contextmanager
def swept(
    behaviour: Behaviour,
    firmware: str = "host",
    sheet: Sheet | None = None,
    *options: str,
    then: float = 1.0,
) -> Iterator[tuple[LiveBox, LiveProbe, LiveClient]]:
    """`then`: in the next act the room is brighter by so much."""
    (room,) = World([ROOM], behaviour, 30.0).scenes
    camera = SimulatedCamera(
        World([room, room.scaled(then)], behaviour),
        lenses.load("equirect"),
        SIZE_PX,
        rate_hz=RATE_HZ,
        sheet=sheet or Sheet(),
    )
    with (
        LiveBox(firmware) as box,
        LiveProbe(camera, (*box.arguments, "--orientation=none", *options), box=box) as probe,
    ):
        client = probe.client(Subscription(max_lights=8, smoothing="RAW", area_lights=True))
        yield box, probe, client


def called(estimate: Estimate) -> tuple[int, int]:
    """How many true lamps, and how many mirror images of some, are called reflections."""
    lamps = [lamp.direction for lamp in ROOM.lamps]
    images = [lamp * [1, -1, 1] for lamp in lamps if lamp[1] > 0.05]
    some = [light.direction for light in estimate.lights if light.flags & LightFlag.REFLECTION]
    return (
        len(geometry.match_directions(lamps, some)),
        len(geometry.match_directions(images, some)),
    )


def check(estimates: list[Estimate]) -> None:
    """No lamp is called a reflection; nor is it said that the camera alters its pictures."""
    assert estimates
    assert not any(one.flags & EstimateFlag.RESPONSE for one in estimates)
    assert not any(called(one)[0] for one in estimates)


@pytest.mark.nightly_rows
@pytest.mark.parametrize("firmware", ["host", "avr"])
def test_a_wheel_that_slips_in_mid_sweep(firmware: str) -> None:
    with swept(Behaviour(act_s=0), firmware) as (box, probe, client):
        probe.run(SWEPT_S)
        before = called(client.estimates[-1])[1]
        assert before >= 2
        box.misbehave("slip_deg=25")
        probe.run(4.0)
        lost = [one for one in client.estimates if one.flags & EstimateFlag.WHEEL_FAULT]
        assert lost
        assert all(one.wheel_deg is None for one in lost)
        box.misbehave("slip_deg=0")
        probe.run(SWEPT_S)
        check(client.estimates)
        assert not client.estimates[-1].flags & EstimateFlag.WHEEL_FAULT
        assert called(client.estimates[-1])[1] >= 2


@pytest.mark.nightly
def test_lamps_that_are_switched_in_mid_sweep() -> None:
    """One lamp after the other is off for a while, at other angles each time."""
    with swept(Behaviour(act_s=0, switch_s=2.3)) as (_, probe, client):
        probe.run(SWEPT_S)
        before = len(client.estimates)
        probe.run(14.0)
        check(client.estimates)
        later = [called(one)[1] for one in client.estimates[before:]]
        assert np.mean(np.array(later) >= 1) > 0.8
        assert max(later) >= 2


@pytest.mark.nightly
def test_exposures_that_change_in_mid_sweep() -> None:
    """All light is eight times as bright in the midst of the second sweep: exposures follow it."""
    change_s = SWEPT_S + 2.0
    with swept(Behaviour(act_s=change_s), then=8.0) as (_, probe, client):
        probe.run(change_s - 0.5)
        before = client.estimates[-1]
        assert called(before)[1] >= 2
        probe.run(SWEPT_S)
        check(client.estimates)
        after = client.estimates[-1]
        assert called(after)[1] >= 2
        # lamps clip in every exposure, by which they are less than eight times as bright
        assert after.sh.coefficients[0] == pytest.approx(8 * before.sh.coefficients[0], rel=0.1)


@pytest.mark.nightly
def test_a_wheel_that_sticks_leaves_light_and_says_so() -> None:
    with swept(Behaviour(act_s=0)) as (box, probe, client):
        probe.run(SWEPT_S)
        box.misbehave("stuck=1")
        probe.run(8.0)
        lost = [one for one in client.estimates if one.flags & EstimateFlag.WHEEL_FAULT]
        assert lost
        assert all(one.wheel_deg is None for one in lost)
        check(client.estimates)
        box.misbehave("stuck=0")
        probe.run(SWEPT_S)
        assert not client.estimates[-1].flags & EstimateFlag.WHEEL_FAULT
        assert called(client.estimates[-1])[1] >= 2


def test_a_wheel_that_rests_remembers_its_sweep() -> None:
    """One sweep, then light goes on at one angle; mirror images stay told, and the wheel rests."""
    with swept(Behaviour(act_s=0), "host", None, "--polarizer-rest=60") as (box, probe, client):
        probe.run(SWEPT_S + 4.0)
        at_rest = box.box.get("wheel_deg")
        before = len(client.estimates)
        probe.run(8.0)
        assert box.box.get("wheel_deg") == pytest.approx(at_rest, abs=0.5)
        check(client.estimates)
        assert all(called(one)[1] >= 2 for one in client.estimates[before:])


def test_reflections_that_a_client_leaves_out_stay_in_the_light() -> None:
    """Not listed, for smoothed and raw alike; TOTAL is the same light, AMBIENT holds theirs."""
    with swept(Behaviour(act_s=0)) as (_, probe, client):
        wishes = [
            Subscription(max_lights=8, smoothing=smoothing, area_lights=True,
                         leave_out_reflections=leave_out)
            for smoothing in ("RAW", "SMOOTHED") for leave_out in (False, True)
        ]  # fmt: skip
        others = [probe.client(wish) for wish in wishes]
        probe.run(SWEPT_S + 2.0)
        assert called(client.estimates[-1])[1] >= 2
        for everything, without in (others[:2], others[2:]):
            one, other = everything.estimates[-1], without.estimates[-1]
            assert one.sequence == other.sequence
            images = [light for light in one.lights if light.flags & LightFlag.REFLECTION]
            assert len(images) >= 2
            assert {light.id for light in other.lights} == (
                {light.id for light in one.lights} - {light.id for light in images}
            )
            total, ambient = other.total().coefficients, other.sh.coefficients
            np.testing.assert_allclose(total, one.total().coefficients, rtol=1e-3, atol=1e-3)
            theirs = sum(np.outer(sh.lamp(light.direction, 2, 0.0), light.irradiance)
                         for light in images)  # fmt: skip
            np.testing.assert_allclose(ambient - one.sh.coefficients, theirs, rtol=0.05, atol=0.02)


def test_a_film_put_in_a_quarter_turn_wrong_is_named() -> None:
    """Nothing is wrongly called a mirror image, or a lamp; the flag says what to do."""
    images = [lamp.direction * [1, -1, 1] for lamp in ROOM.lamps if lamp.direction[1] > 0.05]
    with swept(Behaviour(act_s=0), sheet=Sheet(offset_deg=90.0)) as (_, probe, client):
        probe.run(SWEPT_S + 2.0)
        check(client.estimates)
        assert client.estimates[-1].flags & EstimateFlag.FILM_TURNED
        for one in client.estimates:
            found = geometry.match_directions(images, [light.direction for light in one.lights])
            lights = [one.lights[index] for _, index, _ in found]
            assert not any(light.dolp and (light.reflection or 0) < 0.1 for light in lights)


def test_the_offset_of_the_camera_file_mends_it(tmp_path) -> None:
    file = tmp_path / "my.camera"
    file.write_text(
        "[camera]\nversion = 1\nname = a\nprojection = equirect\nwidth_px = 960\nheight_px = 480\n"
        "[polarizer]\noffset_deg = 90\n"
    )
    world = World([ROOM], Behaviour(act_s=0), 30.0)
    camera = SimulatedCamera(
        world, lenses.load("equirect"), SIZE_PX, rate_hz=RATE_HZ, sheet=Sheet(offset_deg=90.0)
    )
    with LiveBox() as box:
        arguments = (*box.arguments, "--orientation=none", f"--camera={file}")
        with LiveProbe(camera, arguments, box=box) as probe:
            client = probe.client(Subscription(max_lights=8, smoothing="RAW", area_lights=True))
            probe.run(SWEPT_S + 2.0)
    assert not client.estimates[-1].flags & EstimateFlag.FILM_TURNED
    assert called(client.estimates[-1]) == (0, called(client.estimates[-1])[1])
    assert called(client.estimates[-1])[1] >= 2
    assert np.all(np.isfinite(client.estimates[-1].total().coefficients))


def true_polarization(yaw_deg: float, like: PolarizationMap) -> tuple[np.ndarray, np.ndarray]:
    """(S1, S2) / S0 of the room (2, H, W), camera frame, and the range of S0 within each cell."""
    height, width = like.s0.shape
    layers, powers = ROOM.render(8 * width, 8 * height), np.ones(len(ROOM.lamps))
    s012 = np.stack([layers.compose(powers), *layers.compose_polarized(powers)])
    light = np.roll(luminance(s012), round(yaw_deg / 360 * 8 * width), axis=-1)
    cells = light.reshape(3, height, 8, width, 8)
    mean = cells.mean(axis=(2, 4))
    return mean[1:] / mean[0], cells[0].max(axis=(1, 3)) / cells[0].min(axis=(1, 3))


@pytest.mark.nightly_rows
@pytest.mark.parametrize("turn_deg_s", [30.0, 0.0])
def test_a_map_of_polarized_light_is_that_of_the_room(turn_deg_s: float) -> None:
    """Coarse picture on request, as the camera sees it while it turns."""
    behaviour = Behaviour(act_s=0, turn_deg_s=turn_deg_s)
    world = World([ROOM], behaviour, 30.0)
    camera = SimulatedCamera(
        world, lenses.load("equirect"), SIZE_PX, rate_hz=RATE_HZ, sheet=Sheet()
    )
    with (
        LiveBox() as box,
        LiveProbe(camera, (*box.arguments, "--publish-polarization"), box=box) as probe,
    ):
        client = probe.client(Subscription())
        probe.run(SWEPT_S + 4.0)
        assert not [one for one in client.received if isinstance(one.message, PolarizationMap)]
        client.send(encode_get_polarization_map())
        probe.run(1.0)
        maps = [one.message for one in client.received if isinstance(one.message, PolarizationMap)]
        assert len(maps) == 1
        found = maps[0]
        assert isinstance(found, PolarizationMap)
        captured_s = (found.capture_time_unix_ns - client.estimates[-1].capture_time_unix_ns) / 1e9
        captured_s += probe.captured_s(client.estimates[-1])
        yaw_deg = angles_deg(camera.true_rotation(world.at(captured_s)))[0]
    assert found.sweeps >= 1
    truth, contrast = true_polarization(yaw_deg, found)
    # where something is known, and no lamp or its image begins within the cell
    plain = (found.sigma < 0.03) & (contrast < 1.5)
    error = np.hypot(found.q - truth[0], found.u - truth[1])[plain]
    assert plain.sum() > 4000
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert error.max() < 0.1
    mirrored = plain & (np.hypot(*truth) > 0.1)  # the floor near Brewster's angle: horizontal
    aolp_deg = np.degrees(np.arctan2(found.u, found.q))[mirrored] / 2
    assert mirrored.sum() > 500
    assert np.sqrt(np.mean(aolp_deg**2)) < 3.0
    if not turn_deg_s:
        assert np.isfinite(found.s0).mean() == pytest.approx(0.61, abs=0.02)  # not edge-on


def test_a_turning_head_keeps_its_bearings_behind_the_film() -> None:
    """The film does not turn with the room: what it does to the floor must not turn the picture."""
    world = World([PolishedFloor(random_scene(12))], Behaviour(act_s=0, turn_deg_s=30.0), 30.0)
    camera = SimulatedCamera(
        world, lenses.load("equirect"), SIZE_PX, rate_hz=RATE_HZ, sheet=Sheet()
    )
    ahead, sigma_deg = [], []
    with LiveBox() as box, LiveProbe(camera, box.arguments, box=box) as probe:
        client = probe.client(Subscription())
        probe.run(SWEPT_S)
        for one in client.estimates:
            t_s = probe.captured_s(one)
            if one.orientation is None or t_s < 3.0:  # it has seen for a while that it turns
                continue
            turned_back = geometry.inverse(camera.true_rotation(world.at(t_s)))
            seen = geometry.rotate(turned_back, [0.0, 0.0, -1.0])
            x, y, z, w = one.orientation
            ahead.append(geometry.rotate([w, x, y, z], seen))
            sigma_deg.append(one.orientation_sigma_deg)
    assert len(ahead) > 100
    error_deg = geometry.angle_deg(np.array(ahead), geometry.normalize(np.mean(ahead, axis=0)))
    assert np.all(error_deg < 3 * np.array(sigma_deg))
    # 10 where the picture is compared as the film shows it. While the wheel turns, only what is
    # less than about 40 degrees off the film's axis is compared: beyond, nobody knows what it dims.
    assert error_deg.max() < 2.5


def test_small_lamps_are_seen_to_clip_while_a_bare_room_turns() -> None:
    """By the frame that clips them: the map, in the wrong place by then, takes them for noise."""
    room = PolishedFloor(random_scene(36))  # two lamps of less than a degree, and no texture
    world = World([room], Behaviour(act_s=0, turn_deg_s=30.0), 30.0)
    camera = SimulatedCamera(
        world, lenses.load("equirect"), (1920, 960), rate_hz=RATE_HZ, seed=36, sheet=Sheet()
    )
    with LiveBox(seed=36) as box, LiveProbe(camera, box.arguments, box=box) as probe:
        client = probe.client(Subscription(max_lights=8, smoothing="RAW"))
        probe.run(4.0)
    assert all(one.flags & EstimateFlag.CLIPPED for one in client.estimates)
    assert len(client.estimates[-1].lights) >= len(room.lamps)


def test_a_sweep_on_request_ends_the_rest() -> None:
    with swept(Behaviour(act_s=0), "host", None, "--polarizer-rest=3600") as (_, probe, client):
        probe.run(SWEPT_S + 4.0)
        client.send(encode_start_sweep())
        probe.run(0.5)
        started = [one.message for one in client.received if isinstance(one.message, SweepStarted)]
        assert len(started) == 1
        assert isinstance(started[0], SweepStarted)
        assert client.health is not None
        assert client.health.wheel is not None
        assert client.health.wheel.sweeps == started[0].done_at - 1
        probe.run(SWEPT_S)
        assert client.health.wheel.sweeps == started[0].done_at
        client.send(encode_get_polarization_map())
        probe.run(0.5)
        refusals = [one.message for one in client.received if isinstance(one.message, Refusal)]
        assert len(refusals) == 1
        assert "--publish-polarization" in str(refusals[0])


@pytest.mark.nightly
@pytest.mark.parametrize("max_lights", [1, 8])
def test_a_new_lamp_ends_the_rest(max_lights: int) -> None:
    """Also one that the daemon does not list; what is known, and goes on, does not."""
    scene = random_scene(8)
    weakest = min(scene.lamps, key=lambda lamp: float(luminance(lamp.irradiance)))
    before = PolishedFloor(
        ProceduralScene(scene.name, scene.background,
                        tuple(lamp for lamp in scene.lamps if lamp is not weakest))
    )  # fmt: skip
    change_s = SWEPT_S + 6.0
    factor = World([ROOM], None, 30.0).scenes[0].lamps[0].irradiance / ROOM.lamps[0].irradiance
    world = World([before.scaled(factor[0]), ROOM.scaled(factor[0])], Behaviour(act_s=change_s))
    camera = SimulatedCamera(
        world, lenses.load("equirect"), SIZE_PX, rate_hz=RATE_HZ, sheet=Sheet()
    )
    with LiveBox() as box:
        arguments = (*box.arguments, "--orientation=none", "--polarizer-rest=3600",
                     f"--lights={max_lights}")  # fmt: skip
        with LiveProbe(camera, arguments, box=box) as probe:
            client = probe.client(Subscription(max_lights=8, health_period_ms=100))
            probe.run(change_s - 0.5)
            assert client.health is not None
            assert client.health.wheel is not None
            rested = client.health.wheel.sweeps
            at_rest = box.box.get("wheel_deg")
            seen = [one.message for one in client.received if isinstance(one.message, Health)]
            late = seen[-30:]  # 3 s
            assert {one.wheel.sweeps for one in late if one.wheel} == {rested}
            probe.run(2.0)
            assert abs(box.box.get("wheel_deg") - at_rest) > 5
            probe.run(10.0)  # one sweep, and another if it took more than one look to see it all
            assert client.health.wheel.sweeps in (rested + 1, rested + 2)
            at_rest = box.box.get("wheel_deg")
            probe.run(3.0)
            assert box.box.get("wheel_deg") == pytest.approx(at_rest, abs=0.5)
            direction = weakest.direction
            if max_lights == 1:
                assert not any(
                    geometry.angle_deg(light.direction, direction) < 5
                    for one in client.estimates for light in one.lights
                )  # fmt: skip


def test_a_sweep_is_refused_where_the_polarizer_stays() -> None:
    with swept(Behaviour(act_s=0), "host", None, "--polarizer=fixed:45") as (_, probe, client):
        probe.run(2.0)
        client.send(encode_start_sweep())
        probe.run(0.5)
        refusals = [one.message for one in client.received if isinstance(one.message, Refusal)]
        assert len(refusals) == 1
        assert "start lightprobed with --polarizer=sweep" in str(refusals[0])


def test_a_film_fixed_by_hand_is_where_it_is_said_to_be() -> None:
    """Without a wheel; off its axis it lets through more at one angle than at another."""
    world = World([random_scene(8)], Behaviour(act_s=0), 30.0)
    camera = SimulatedCamera(  # its film is at 0°
        world, lenses.load("equirect"), SIZE_PX, rate_hz=RATE_HZ, sheet=Sheet()
    )
    normals = geometry.sphere_normals(1)
    true, errors = world.at(0.0).truth().irradiance(normals), []
    for stated_deg in (0, 90):
        with LiveProbe(camera, [f"--polarizer=fixed:{stated_deg}"]) as probe:
            client = probe.client(Subscription(max_lights=8, smoothing="RAW"))
            probe.run(2.0)
        found = client.estimates[-1]
        assert (found.wheel_deg, found.wheel_sigma_deg) == (stated_deg, 0.5)
        errors.append(np.abs(found.irradiance(normals) - true).mean() / true.max())
    assert errors[0] < 0.03, errors
    assert errors[1] > 2 * errors[0], errors


def test_pictures_need_a_film_that_is_swept() -> None:
    status, _, log = run(
        "--source=file:nothing.pfm", "--publish-polarization", "--polarizer=films"
    )  # fmt: skip
    assert status == 2
    assert "add --polarizer=sweep" in log


def test_a_turn_is_followed_in_a_room_so_bare_that_nothing_contradicts_the_map():
    rate_deg_s = 30.0
    world = World(
        [PolishedFloor(random_scene(10))], Behaviour(act_s=0, turn_deg_s=rate_deg_s), 30.0
    )
    camera = SimulatedCamera(
        world, lenses.load("equirect"), SIZE_PX, rate_hz=RATE_HZ, sheet=Sheet()
    )
    with LiveBox() as box, LiveProbe(camera, box.arguments, box=box) as probe:
        client = probe.client(Subscription())
        probe.run(5.0)
        found = [
            (probe.captured_s(one), 2 * np.arctan2(one.orientation[1], one.orientation[3]))
            for one in client.estimates
            if one.orientation is not None and probe.captured_s(one) > 2.0
        ]
    t_s, yaw = np.array(found).T
    turned_deg = np.degrees(np.unwrap(yaw)) - rate_deg_s * t_s
    assert t_s[-1] - t_s[0] > 2.0
    # The wheel homes and turns in most of this time. 8 behind a film without surfaces: what those
    # dim is not compared then, and near the film's axis this room shows hardly anything.
    assert np.ptp(turned_deg) < 17.0
