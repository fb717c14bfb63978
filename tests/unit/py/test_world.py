"""The world over time, the room in it, and how the camera sees it."""

import cv2
import numpy as np
import pytest
from lightprobe import geometry, sh
from lightprobe.colour import luminance, srgb_table
from lightprobe.errors import UsageError
from lightprobe.imaging import camera as lenses
from lightprobe.imaging.film import Sheet
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.exposure import ExposureLimits, median_luminance
from lightprobe.sim.faults import Faults
from lightprobe.sim.flicker import WAVES, Flicker
from lightprobe.sim.link import Exposure
from lightprobe.sim.motion import turned
from lightprobe.sim.polarized import PolishedFloor
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.room import Room
from lightprobe.sim.scene import MapTruth, disc_layer
from lightprobe.sim.world import Behaviour, World

SIZE = (256, 128)


def test_acts_follow_each_other_and_come_again():
    world = World([random_scene(0), random_scene(1)], Behaviour(act_s=2))
    assert [world.at(t).act for t in (0, 1.9, 2, 3.9, 4)] == [0, 0, 1, 1, 0]
    assert World([random_scene(0), random_scene(1)], Behaviour(act_s=0)).at(99).act == 0
    world.kept = 1
    assert [world.at(t).act for t in (0, 1.9, 2, 3.9, 4)] == [1] * 5


def test_pictures_are_kept_while_nothing_changes():
    world = World([random_scene(2)], Behaviour(act_s=0, switch_s=1))
    fresh, keeping = (
        SimulatedCamera(world, lenses.equirect(), SIZE, rate_hz=30, kept=kept) for kept in (0, 2)
    )
    shot, other = Shot(2000), Shot(500)
    for number in (0, 1):
        assert keeping.frame(number, shot) == fresh.frame(number, shot)
    assert keeping.frame(2, shot) is keeping.frame(0, shot)
    assert keeping.frame(3, shot) is keeping.frame(1, shot)
    assert fresh.frame(2, shot) != fresh.frame(0, shot)
    assert keeping.frame(2, other) == fresh.frame(2, other)
    lamp_off = 45  # in the second second
    assert keeping.frame(lamp_off, shot) == fresh.frame(lamp_off, shot)
    keeping.white_balance = fresh.white_balance = (1.2, 1.0, 0.9)
    assert keeping.frame(4, shot) == fresh.frame(4, shot)


def test_lamps_are_off_in_turn():
    world = World([random_scene(2)], Behaviour(act_s=0, switch_s=1))
    lit = [tuple(world.at(t + 0.5).powers > 0) for t in range(4)]
    assert lit == [
        (True, True, True),
        (False, True, True),
        (True, False, True),
        (True, True, False),
    ]
    assert len(world.at(1.5).truth().lamps) == 2
    assert np.all(World([random_scene(0)], Behaviour(switch_s=1)).at(1.5).powers == 1)


def test_flicker_is_averaged_by_the_exposure():
    world = World([random_scene(0)], Behaviour(flicker=Flicker(100, (0.4,))))
    powers = [float(world.at(t, 1e-6).powers[0]) for t in np.linspace(0, 0.01, 41)]
    assert max(powers) == pytest.approx(1.4, abs=0.01)
    assert min(powers) == pytest.approx(0.6, abs=0.01)
    assert world.at(0.0033, 0.01).powers[0] == pytest.approx(1)


def test_a_turning_scene_is_as_in_the_middle_of_the_exposure_and_smears():
    world = World([random_scene(0)], Behaviour(act_s=0, turn_deg_s=-100))
    state = world.at(2.0, 0.03)
    assert state.angles_deg[0] % 360 == pytest.approx(-201.5 % 360)
    assert state.smear_deg == pytest.approx(3.0)
    assert World([random_scene(0)]).at(2.0, 0.03).smear_deg == 0


def test_a_head_swings_about_where_it_looks():
    world = World([random_scene(0)], Behaviour(act_s=0, swing_deg=40, swing_hz=0.5))
    yaw = [world.at(t).angles_deg[0] for t in (0, 0.5, 1, 1.5)]
    assert yaw == pytest.approx([0, 40, 0, -40], abs=1e-9)
    assert world.at(0, 0.01).smear_deg == pytest.approx(40 * np.pi * 0.01, rel=1e-3)


@pytest.mark.parametrize("optics", ["equirect", "fisheye", "film", "fisheye and film"])
def test_what_turns_during_the_exposure_is_smeared_and_keeps_its_light(tmp_path, optics):
    """A second long at 45° a second: as the mean of many short ones. Films do not turn with it."""
    lens = dual_fisheye(tmp_path) if "fisheye" in optics else lenses.load("equirect")
    sheet = Sheet() if "film" in optics else None
    world = World([PolishedFloor(Room())], Behaviour(act_s=0, turn_deg_s=45))
    camera = SimulatedCamera(world, lens, SIZE, rate_hz=100, pixel_format="RGBF", sheet=sheet)

    def shown(frame, exposure_s):
        data = camera.frame(frame, Shot(1e6 * exposure_s))
        return luminance(np.frombuffer(data, "<f4").reshape(*SIZE[::-1], 3))

    mean = np.mean([shown(frame, 1e-6) for frame in range(100)], axis=0)
    smeared = shown(99, 1.0)  # read when the last short one is
    assert np.abs(smeared - mean).mean() < 0.03 * mean.mean()
    assert np.abs(shown(50, 1e-6) - mean).mean() > 0.1 * mean.mean()  # one moment is not like it


def test_scenes_are_brought_to_one_brightness():
    for scene in World([random_scene(3), Room()], median_radiance=30).scenes:
        radiance = scene.render(*SIZE).compose(np.ones(len(scene.lamps)))
        assert median_luminance(radiance) == pytest.approx(30, rel=1e-3)


def test_room_truth_is_its_picture_and_its_lamps_are_in_it():
    room, powers = Room(), [0, 1, 0.7, 0.5]
    truth = room.truth(powers, turned(30))
    shown = MapTruth(room.render(1920, 960).compose(powers), turned(30))
    assert truth.total[:9] == pytest.approx(shown.total[:9], abs=5e-3 * np.abs(shown.total).max())
    assert len(truth.lamps) == np.count_nonzero(powers)
    dark = MapTruth(room.render(*SIZE).compose([0, 0, 0, 0]), turned(30)).total
    for lamp in truth.lamps:
        share = np.outer(sh.lamp(lamp.direction, 2), lamp.irradiance)
        assert np.all(truth.total[0] > dark[0] + share[0])


def test_room_lights_its_walls_by_the_inverse_square():
    """Radiance of a disc's own pixels is the bulb's; walls are dimmer, and brightest near it."""
    room = Room()
    radiance = room.render(1024, 512).compose([0, 0, 1, 0])
    lamp = room.lamps[2]
    disc = disc_layer(lamp, 1024, 512)
    inside = radiance.reshape(-1, 3)[disc.index]
    assert inside.max(axis=0) == pytest.approx(lamp.radiance + inside.min() * 0, rel=0.02)
    away = geometry.angle_deg(geometry.equirect_directions(1024, 512), lamp.direction)
    wall = luminance(radiance)
    assert wall[away > 90].max() < 0.2 * wall[(away > 6) & (away < 20)].max()


def dual_fisheye(tmp_path):
    text = "[camera]\nprojection = fisheye\nwidth_px = 256\nheight_px = 128\n"
    for k, rotation in enumerate(("1, 0, 0, 0", "0, 0, 1, 0")):
        text += f"[lens.{k}]\ncx_px = {64 + 128 * k}\ncy_px = 64\nfx_px = 38\nfy_px = 38\n"
        text += f"max_theta_deg = 95\nrotation_wxyz = {rotation}\nrolloff = -0.1, 0, 0\n"
    (tmp_path / "dual.camera").write_text(text)
    return lenses.load(str(tmp_path / "dual.camera"))


def test_fisheye_sees_the_scene_through_its_lenses(tmp_path):
    """Floats off the sensor are the scene's radiance where each pixel looks, times roll-off."""
    lens = dual_fisheye(tmp_path)
    scene = random_scene(1)
    world = World([scene], Behaviour(act_s=0, turn_deg_s=40))
    simulated = SimulatedCamera(world, lens, SIZE, rate_hz=1, pixel_format="RGBF")
    frame = np.frombuffer(simulated.frame(1, Shot(1000)), "<f4").reshape(128, 256, 3)
    directions, illumination = lens.look(*SIZE)
    seen = illumination > 0
    rotation = simulated.state(1, Shot(1000)).rotation
    turned_back = geometry.rotate(rotation, directions[seen])
    background = sh.radiance(scene.background, turned_back) * illumination[seen][:, None]
    lit = np.zeros(len(turned_back), bool)
    for lamp in scene.lamps:
        # A pixel is 1.5° wide, and a lens spreads a lamp by four sigmas of 0.65 pixels.
        lit |= geometry.angle_deg(turned_back, lamp.direction) < lamp.radius_deg + 6
    assert frame[seen][~lit] == pytest.approx(background[~lit], rel=0.02)
    assert np.all(frame[~seen] == 0)
    assert luminance(frame[seen][lit]).max() > 10 * luminance(background).max()


@pytest.mark.parametrize("pixel_format", ["MJPG", "YUYV", "NV12", "GREY", "RGBF"])
def test_every_format_shows_the_same_picture(pixel_format):
    """Decoded by OpenCV (limited range, so luma is undone by hand) to the same mean light."""
    world = World([Room()], Behaviour(act_s=0), median_radiance=30)
    simulated = SimulatedCamera(world, lenses.equirect(), SIZE, pixel_format=pixel_format)
    (shot,) = simulated.automatic(0)
    data = np.frombuffer(simulated.frame(0, shot), np.uint8)
    truth = world.scenes[0].render(*SIZE).compose([1, 1, 1, 1]) * shot.exposure_us * 1e-6
    luma = srgb_code(np.minimum(truth, 1)) @ [0.299, 0.587, 0.114]
    if pixel_format == "MJPG":
        picture = cv2.imdecode(data, cv2.IMREAD_COLOR)
        seen = cv2.cvtColor(picture, cv2.COLOR_BGR2YCrCb)[..., 0]
    elif pixel_format == "RGBF":
        radiance = data.view("<f4").reshape(128, 256, 3) * shot.exposure_us * 1e-6
        seen = srgb_code(np.minimum(radiance, 1)) @ [0.299, 0.587, 0.114]
    else:
        assert len(data) == {"YUYV": 2, "NV12": 1.5, "GREY": 1}[pixel_format] * 256 * 128
        seen = data[: 2 * 256 * 128 : 2] if pixel_format == "YUYV" else data[: 256 * 128]
        seen = seen.reshape(128, 256)
    assert np.abs(seen.astype(float) - luma).mean() < 2.5


def srgb_code(linear):
    return np.interp(linear, srgb_table(), np.arange(256))


def test_automatic_bracket():
    world = World([Room()], median_radiance=30)
    simulated = SimulatedCamera(world, lenses.equirect(), SIZE)
    assert [shot.exposure_us for shot in simulated.automatic(0, 3)] == [8300, 500, 100]
    any_us = SimulatedCamera(
        World([Room()], median_radiance=30), lenses.equirect(), SIZE,
        limits=ExposureLimits(1, 1e6, 0),
    )  # fmt: skip
    exposures_us = [shot.exposure_us for shot in any_us.automatic(0, 3)]
    assert exposures_us[0] == pytest.approx(8333, rel=0.02)
    assert exposures_us[0] / exposures_us[2] == pytest.approx(256)
    dim = SimulatedCamera(
        World([Room()], median_radiance=1e-3), lenses.equirect(), SIZE,
        limits=ExposureLimits(1, 1e6, 0),
    )  # fmt: skip
    assert dim.automatic(0)[0].exposure_us == pytest.approx(1e6 / 30)  # never beyond the period


def test_exposures_are_those_that_the_camera_can_do():
    limits = ExposureLimits()
    assert [limits.nearest(us) for us in (1, 149, 151, 20000, 1e6)] == [100, 100, 200, 20000, 33000]
    assert limits.at(30) == limits
    assert limits.at(1) == limits
    assert limits.at(120).most_us == 8300
    assert ExposureLimits(20, 50, 0).nearest(33.3) == 33.3
    with pytest.raises(UsageError, match="the least must be above 0 and not above the most"):
        ExposureLimits(200, 100)
    with pytest.raises(UsageError, match=r"exposures of 2000…1000"):
        ExposureLimits(2000, 33000).at(1000)


def test_commands_are_rounded_as_by_a_camera():
    simulated = SimulatedCamera(World([Room()], median_radiance=30), lenses.equirect(), SIZE)
    exposure = Exposure(simulated)
    for frame, us in enumerate((16.0, 5040.0, 1e6)):
        exposure.command(Shot(us, 2.0), frame, 0)
    assert [exposure.shot(frame) for frame in range(3)] == [
        Shot(100, 2), Shot(5000, 2), Shot(33000, 2)
    ]  # fmt: skip


def test_faults_are_merged_and_checked():
    faults = Faults(drop=0.5).merged("late_ms=40&stall_after=3")
    assert (faults.drop, faults.late_ms, faults.stall_after) == (0.5, 40, 3)
    with pytest.raises(UsageError, match="unknown option explode"):
        faults.merged("explode=1")
    with pytest.raises(UsageError, match="late_ms=soon: expected a number"):
        faults.merged("late_ms=soon")


# ---------------------------------------------------------------- rolling shutter


ROW_US = 200.0
SHUTTER_S = 1e-6 * ROW_US * (SIZE[1] - 1) / 2  # from the first row to the middle


def rolling(scene, behaviour, lens=None, pixel_format="RGBF", **more):
    world = World([scene], behaviour)
    return SimulatedCamera(
        world, lens or lenses.equirect(), SIZE, rate_hz=10, pixel_format=pixel_format,
        row_time_us=ROW_US, **more,
    )  # fmt: skip


def floats(camera, number, shot):
    return np.frombuffer(camera.frame(number, shot), "<f4").reshape(SIZE[1], SIZE[0], 3)


def global_shutter(scene, behaviour, lens=None):
    return SimulatedCamera(
        World([scene], behaviour), lens or lenses.equirect(), SIZE, rate_hz=10, pixel_format="RGBF"
    )


def rows_at_their_times(scene, behaviour, number, shot, lens=None):
    """Each row from a picture of a camera that exposes all rows at that row's time."""
    camera, world = global_shutter(scene, behaviour, lens), World([scene], behaviour)
    picture = np.empty((SIZE[1], SIZE[0], 3), np.float32)
    for row in range(SIZE[1]):
        start_s = camera.start_s(number, shot) + 1e-6 * ROW_US * row
        state = world.at(start_s, 1e-6 * shot.exposure_us)
        camera.state = lambda *_, state=state: state
        picture[row] = floats(camera, 0, shot)[row]
    return picture


FLICKER = Flicker(100, (0.9, 0.5), (0.0, 1 / 3), ("sine", "square"))


@pytest.mark.parametrize(
    "behaviour",
    [
        Behaviour(act_s=0, turn_deg_s=200),
        Behaviour(act_s=0, flicker=FLICKER),
        Behaviour(act_s=0, turn_deg_s=-300, flicker=FLICKER),
        Behaviour(act_s=0, switch_s=0.052),
    ],
)
@pytest.mark.parametrize("fisheye", [False, True])
def test_every_row_is_exposed_at_its_own_time(tmp_path, behaviour, fisheye):
    lens = dual_fisheye(tmp_path) if fisheye else None
    scene, shot = random_scene(3), Shot(500)
    found = floats(rolling(scene, behaviour, lens), 1, shot)
    wanted = rows_at_their_times(scene, behaviour, 1, shot, lens)
    assert found == pytest.approx(wanted, rel=2e-3, abs=2e-3 * float(wanted.max()))
    all_at_once = floats(global_shutter(scene, behaviour, lens), 1, shot)
    assert np.abs(all_at_once - wanted).max() > 0.02 * wanted.max()


def test_codes_roll_as_floats_do():
    """Turned rows come from the cache of one still signal."""
    scene, behaviour = random_scene(3), Behaviour(act_s=0, turn_deg_s=200)
    camera = rolling(scene, behaviour, pixel_format="GREY")
    shot = camera.automatic(0)[0]
    once = np.frombuffer(camera.frame(2, shot), np.uint8).reshape(SIZE[1], SIZE[0])
    radiance = floats(rolling(scene, behaviour), 2, shot)
    codes = srgb_code(np.minimum(radiance * 1e-6 * shot.exposure_us, 1)) @ [0.299, 0.587, 0.114]
    assert np.abs(once - codes).mean() < 2.5


def test_the_middle_row_tells_a_frames_state():
    camera = rolling(random_scene(3), Behaviour(act_s=0, turn_deg_s=100))
    state = camera.state(4, Shot(1000))
    assert state.angles_deg[0] == pytest.approx(100 * (0.5 + SHUTTER_S - 0.0005))


def test_a_still_scene_looks_the_same_through_any_shutter():
    still = Behaviour(act_s=0)
    shots = [
        camera.frame(1, Shot(1000))
        for camera in (rolling(Room(), still), global_shutter(Room(), still))
    ]
    assert shots[0] == shots[1]


def test_a_frame_is_read_before_the_next():
    with pytest.raises(UsageError, match="1000 µs for each of 128 rows"):
        SimulatedCamera(
            World([random_scene(0)]), lenses.equirect(), SIZE, rate_hz=30, row_time_us=1000
        )


# ---------------------------------------------------------------- flicker


@pytest.mark.parametrize("wave", WAVES)
def test_waves_have_mean_0_and_the_depth_below(wave):
    flicker = Flicker(100, (0.6,), (0.25,), (wave,))
    t_s = 3 + np.arange(1000) / 1000 / 100
    moments = flicker.powers(1, t_s, 0.0)[:, 0]
    assert moments.mean() == pytest.approx(1, abs=2e-3)
    assert moments.min() == pytest.approx(0.4, abs=5e-3)
    for exposure_s in (0.001, 0.0123):
        means = [
            flicker.powers(1, t + np.linspace(0, exposure_s, 4001), 0.0).mean() for t in t_s[::97]
        ]
        assert flicker.powers(1, t_s[::97], exposure_s)[:, 0] == pytest.approx(means, abs=2e-3)
    assert flicker.powers(1, 0.0033, 0.01) == pytest.approx(1)


def test_lamps_flicker_each_in_its_own_way():
    flicker = Flicker(100, (0.5, 0.1), (0, 1 / 3, 2 / 3), ("sine", "square"))
    powers = flicker.powers(4, np.linspace(0, 0.01, 401), 0.0)
    assert np.ptp(powers, axis=0) == pytest.approx([1.0, 0.2, 1.0, 0.2], abs=1e-3)
    assert np.argmax(powers[:, 0]) == 100
    assert np.argmax(powers[:, 2]) == pytest.approx(100 - 2 / 3 * 400 + 400, abs=1)


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ({"depths": (1.5,)}, "depths 1.5: expected shares"),
        ({"depths": ()}, "a list is empty"),
        ({"phases": (np.nan,)}, "phases nan: expected parts of a period"),
        ({"waves": ("triangle",)}, "wave triangle: expected sine"),
    ],
)
def test_flicker_that_cannot_be(entries, words):
    with pytest.raises(UsageError, match=words):
        Flicker(100, **entries)
