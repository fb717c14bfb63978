"""Three axes and three translations: rotations, tracks and files, pictures and truth of them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st
from lightprobe import geometry, sh
from lightprobe.errors import UsageError
from lightprobe.geometry import Array
from lightprobe.imaging import camera as lenses
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.polarizer import pixel_frame
from lightprobe.sim import track_file
from lightprobe.sim.auto_exposure import AutoExposure
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.link import account
from lightprobe.sim.motion import Track, angles_deg, is_level, level_yaw_deg, turned, way_deg
from lightprobe.sim.polarized import Sky
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.room import Room
from lightprobe.sim.scene import Layers, PanoramaScene, ProceduralScene
from lightprobe.sim.world import Behaviour, State, World
from scipy.spatial.transform import Rotation, Slerp

SIZE = (256, 128)
DIRECTIONS = geometry.equirect_directions(*SIZE)
SOLID_ANGLES = np.repeat(geometry.equirect_solid_angles(*SIZE)[:, None], SIZE[0], axis=1)
SHOT = Shot(1000.0)

#: Pictures take long, and no rotation is simpler than another.
PICTURES = settings(deadline=None, phases=(Phase.explicit, Phase.reuse, Phase.generate))
rotations = st.lists(st.floats(-1, 1), min_size=4, max_size=4).map(np.array)
rotations = rotations.filter(lambda q: np.linalg.norm(q) > 0.1).map(lambda q: q / np.linalg.norm(q))
angles = st.floats(-179, 179)


def held(rotation: Array, place_m: Array | None = None) -> Behaviour:
    """A probe that stays so."""
    places_m = np.zeros((1, 3)) if place_m is None else place_m[None]
    return Behaviour(act_s=0, path=Track(np.zeros(1), np.asarray(rotation)[None], places_m))


@cache
def gradient() -> ProceduralScene:
    """Soft light without lamps: a picture of it can be told in closed form."""
    return ProceduralScene("gradient", random_scene(5).background, ())


def picture(
    world: World, number: int = 0, shot: Shot = SHOT, size_px: tuple[int, int] = SIZE, **more
) -> Array:
    """Radiance (H, W, 3) of an equirectangular camera."""
    camera = SimulatedCamera(world, lenses.equirect(), size_px, pixel_format="RGBF", **more)
    return np.frombuffer(camera.frame(number, shot), "<f4").reshape(size_px[1], size_px[0], 3)


def irradiance(radiance: Array, normals: Array) -> Array:
    height, width, _ = radiance.shape
    light = radiance * geometry.equirect_solid_angles(width, height)[:, None, None]
    directions = geometry.equirect_directions(width, height).reshape(-1, 3)
    return np.maximum(normals @ directions.T, 0) @ light.reshape(-1, 3)


# ---------------------------------------------------------------- rotations


@given(yaw=angles, nod=st.floats(-89, 89), roll=angles)
def test_angles_of_a_rotation_are_those_that_made_it(yaw, nod, roll):
    assert angles_deg(turned(yaw, nod, roll)) == pytest.approx((yaw, nod, roll), abs=1e-6)


def test_each_angle_turns_as_it_says():
    """The scene goes to the right, the probe looks up, its right side goes down."""
    ahead, right = [0.0, 0, -1], [1.0, 0, 0]
    assert geometry.rotate(geometry.inverse(turned(90)), ahead) == pytest.approx([1, 0, 0])
    assert geometry.rotate(turned(0, 90), ahead) == pytest.approx([0, 1, 0])
    assert geometry.rotate(turned(0, 0, 90), right) == pytest.approx([0, -1, 0])


@given(yaw=angles)
def test_what_turns_about_the_vertical_alone_is_level(yaw):
    assert is_level(turned(yaw))
    assert level_yaw_deg(turned(yaw)) == pytest.approx(yaw)
    assert not is_level(turned(yaw, 1))
    assert not is_level(turned(yaw, 0, 1))


def test_the_way_is_all_that_was_turned():
    yaw_deg = np.array([0, 100, 200, 300, 200, 100.0])
    for nod_deg, roll_deg in ((0, 0), (20, -30)):
        assert way_deg(turned(yaw_deg, nod_deg, roll_deg)) == pytest.approx(500)


# ---------------------------------------------------------------- pictures


@given(rotation=rotations)
@example(rotation=turned(0, 90))
@example(rotation=turned(0, 0, 180))
@settings(PICTURES, max_examples=25)
def test_a_turned_probe_sees_the_scene_through_its_rotation(rotation):
    """Whatever the axis: each pixel is what the scene has where the pixel's ray points."""
    seen = picture(World([gradient()], held(rotation)))
    there = geometry.rotate(rotation, DIRECTIONS)
    expected = sh.radiance(gradient().background, there)
    tolerance = 5e-3 if not is_level(rotation) else 0.03  # by whole pixels
    assert (np.abs(seen - expected) <= tolerance * (expected + expected.mean())).all()


@given(rotation=rotations, seed=st.integers(0, 50))
@settings(PICTURES, max_examples=3)
def test_truth_is_what_its_picture_casts(rotation, seed):
    """Lamps and all, on surfaces of any direction; and in SH."""
    scene = random_scene(seed)
    world = World([scene], held(rotation))
    # Smaller pictures show small lamps above the head too strong or too weak: by 8 % at 960 × 480.
    seen, truth = picture(world, size_px=(1920, 960)), world.at(0.0).truth()
    normals = geometry.sphere_normals(1)
    expected = truth.irradiance(normals)
    assert irradiance(seen, normals) == pytest.approx(expected, abs=0.05 * expected.max())
    coefficients = sh.project(seen, 2)
    assert coefficients == pytest.approx(truth.total[:9], abs=0.05 * np.abs(truth.total).max())


@given(rotation=rotations)
@settings(PICTURES, max_examples=10)
def test_truth_of_maps_is_what_their_picture_casts(rotation):
    room = Room()
    drawn = room.render(512, 256).compose(np.ones(len(room.lamps)))
    for scene in (room, PanoramaScene.of("drawn", drawn)):
        world = World([scene], held(rotation))
        truth = world.at(0.0).truth()
        normals = geometry.sphere_normals(1)
        expected = truth.irradiance(normals)
        found = irradiance(picture(world), normals)
        assert found == pytest.approx(expected, abs=0.02 * expected.max())
        cast = sh.irradiance(truth.total, normals)  # of a high order: nearly the same
        assert cast == pytest.approx(expected, abs=0.02 * expected.max())


@given(rotation=rotations)
@settings(PICTURES, max_examples=15)
def test_lamps_are_where_their_picture_has_them(rotation):
    scene = random_scene(3)
    world = World([scene], held(rotation))
    bright = picture(world).sum(axis=-1) * SOLID_ANGLES
    for lamp in world.at(0.0).truth().lamps:
        near = geometry.angle_deg(DIRECTIONS, lamp.direction) < lamp.radius_deg + 3
        centre = geometry.normalize(np.sum((near * bright)[..., None] * DIRECTIONS, axis=(0, 1)))
        assert geometry.angle_deg(centre, lamp.direction) < 1.5  # others may be beside it


@cache
def sky() -> tuple[Sky, Layers]:
    """And its map."""
    return Sky(), Sky().render(2048, 1024)


@given(rotation=rotations)
@settings(PICTURES, max_examples=5)
def test_polarized_light_is_seen_in_the_frame_of_the_tilted_camera(rotation):
    """The field's direction in space stays; what a film of each angle passes is told by it."""
    scene, layers = sky()
    world = World([scene], held(rotation))
    there = geometry.rotate(rotation, DIRECTIONS)
    column, row = (
        np.rint(place).astype(int).clip(0) for place in geometry.equirect_pixel(there, 2048, 1024)
    )
    column, row = np.minimum(column, 2047), np.minimum(row, 1023)
    s0 = layers.compose(np.ones(len(scene.lamps)))[row, column]
    s1, s2 = layers.compose_polarized(np.ones(len(scene.lamps)))[:, row, column]
    angle = np.arctan2(s2, s1)[..., 1] / 2
    x, y = pixel_frame(there)
    field = np.cos(angle)[..., None] * x + np.sin(angle)[..., None] * y
    field = geometry.rotate(geometry.inverse(rotation), field)  # in the camera's frame
    right, up = pixel_frame(DIRECTIONS)
    own = np.arctan2(np.sum(field * up, -1), np.sum(field * right, -1))
    depth = np.hypot(s1, s2)
    sheet = Sheet(index=1)
    for wheel_deg in (0.0, 45.0):
        camera = SimulatedCamera(world, lenses.equirect(), SIZE, pixel_format="RGBF", sheet=sheet)
        seen = np.frombuffer(camera.frame(0, SHOT, (wheel_deg,)), "<f4").reshape(128, 256, 3)
        cosine, sine = camera._view._polarizer.axis(wheel_deg)
        along = cosine * np.cos(2 * own) + sine * np.sin(2 * own)
        share = s0 + sheet.diattenuation * along[..., None] * depth
        expected = sheet.unpolarized_gain * share
        smooth = (np.abs(DIRECTIONS[..., 1]) < 0.98) & (np.abs(there[..., 1]) > 0.05)
        smooth &= np.abs(there[..., 1]) < 0.98
        off = np.abs(seen - expected)[smooth] / expected[smooth].mean()
        assert np.quantile(off, 0.98) < 0.03  # but the sun's rim


def test_rows_of_a_tilting_camera_are_each_of_its_own_time():
    behaviour = Behaviour(
        act_s=0, swing_deg=40, swing_hz=2, nod_deg=30, nod_hz=1.3, roll_deg=30, roll_hz=1.7
    )
    world = World([gradient()], behaviour)
    shot = Shot(10.0)
    seen = picture(world, 1, shot, rate_hz=5, row_time_us=1000.0)
    row_s = 1 / 5 * 2 - 1e-5 + 1e-3 * np.arange(SIZE[1])
    there = np.einsum("hij,hwj->hwi", geometry.rotation_matrix(world.rotation(row_s)), DIRECTIONS)
    assert seen == pytest.approx(sh.radiance(gradient().background, there), rel=1e-2)
    assert way_deg(world.rotation(row_s)) > 20


def test_a_tilted_turn_smears_and_keeps_its_light():
    """Of a long exposure: the mean of many short ones along the way, not along a shortcut."""
    spin = geometry.quaternion([0.3, 1, -0.5], 90)
    keys = [np.array(geometry.UNTURNED)]
    for _ in range(4):
        keys.append(geometry.turn_after(spin, keys[-1]))
    track = Track(np.linspace(0, 2, 5), np.array(keys), np.zeros((5, 3)))
    world = World([Room()], Behaviour(act_s=0, path=track))
    state = world.at(0.0, 0.25)
    assert state.smear_deg == pytest.approx(45)
    long = picture(world, 0, Shot(250_000.0), rate_hz=4)
    short = np.mean([picture(world, k, Shot(1.0), rate_hz=100) for k in range(25)], axis=0)
    assert np.abs(long - short).mean() < 0.05 * short.mean()
    assert np.abs(picture(world, 0, Shot(1.0), rate_hz=4) - short).mean() > 0.1 * short.mean()


def test_the_account_tells_the_rotation():
    world = World([random_scene(0)], held(turned(30, -20, 10)))
    camera = SimulatedCamera(world, lenses.equirect(), SIZE)
    line = account(camera, 0, SHOT, 0)
    assert (line["yaw_deg"], line["nod_deg"], line["roll_deg"]) == pytest.approx((30, -20, 10))
    x, y, z, w = line["rotation_xyzw"]
    assert [w, x, y, z] == pytest.approx(turned(30, -20, 10))


def test_automatic_exposure_meters_what_the_tilted_camera_sees():
    """Half of the weight ahead: looking up at the only lamp, it exposes shorter."""
    scene = gradient()
    lamp = random_scene(0).lamps[0]
    scene = ProceduralScene("one", scene.background, (lamp,))
    towards = turned(*geometry_angles(lamp.direction))
    assert geometry.rotate(towards, [0.0, 0, -1]) == pytest.approx(lamp.direction)
    exposures = []
    for rotation in (towards, geometry.turn_after(towards, turned(180))):
        camera = SimulatedCamera(World([scene], held(rotation), 30.0), lenses.equirect(), SIZE)
        automatic = AutoExposure(camera)
        exposures.append([automatic.shot(frame).exposure_us for frame in range(60)][-1])
    assert exposures[0] < 0.9 * exposures[1]


def geometry_angles(direction: Array) -> tuple[float, float]:
    """Yaw and nod of a probe that looks there."""
    azimuth, elevation = geometry.angles_from_direction(direction)
    return -float(azimuth), float(elevation)


# ---------------------------------------------------------------- tracks


@st.composite
def tracks(draw) -> Track:
    steps = draw(st.lists(st.floats(0.01, 2), min_size=1, max_size=6))
    keys = [draw(rotations) for _ in range(len(steps) + 1)]
    places = draw(st.lists(st.floats(-1, 1), min_size=3 * len(keys), max_size=3 * len(keys)))
    return Track(np.cumsum([0, *steps]), np.array(keys), np.reshape(places, (-1, 3)))


def same(found: Array, expected: Array) -> bool:
    """Rotations: a quaternion and its negative are one."""
    return bool(np.all(np.abs(np.sum(found * expected, axis=-1)) > 1 - 1e-12))


@given(track=tracks())
def test_a_track_is_at_its_keys_at_their_times(track):
    assert same(track.rotation(track.t_s), track.rotations)
    assert track.place_m(track.t_s) == pytest.approx(track.places_m, abs=1e-12)


@given(track=tracks(), share=st.floats(0, 1))
def test_between_keys_it_goes_the_short_way_at_an_even_rate(track, share):
    t_s = share * float(track.t_s[-1])
    turns = Rotation.from_quat(np.roll(track.rotations, -1, axis=1))
    x, y, z, w = Slerp(track.t_s, turns)(t_s).as_quat()
    found = track.rotation(t_s)
    assert abs(found @ [w, x, y, z]) == pytest.approx(1, abs=1e-9)
    places = [np.interp(t_s, track.t_s, axis) for axis in track.places_m.T]
    assert track.place_m(t_s) == pytest.approx(places, abs=1e-9)


@given(track=tracks(), t_s=st.floats(0, 50))
def test_past_its_end_it_goes_back_as_it_came(track, t_s):
    end_s = float(track.t_s[-1])
    assert same(track.rotation(end_s + t_s), track.rotation(end_s - t_s))
    assert same(track.rotation(t_s + 2 * end_s), track.rotation(t_s))


# ---------------------------------------------------------------- files


TUM = """# timestamp tx ty tz qx qy qz qw
1305031102.1758 0.5 0.25 1 0 0 0 1

1305031102.2758 0.5 0.35 1 0 0.7071 0 0.7071
1305031102.5758   0.6 0.25 1.5  0.5 0.5 0.5 0.5
"""
EUROC = """#timestamp [ns], p_x, p_y, p_z, q_w, q_x, q_y, q_z, v_x, v_y, v_z
1403636580838555648,0.5,0.25,1,1,0,0,0,0.1,0.2,0.3
1403636580938555648,0.5,0.35,1,0.7071,0,0.7071,0,0.1,0.2,0.3
1403636581238555648, 0.6,0.25,1.5, 0.5,0.5,0.5,0.5,0.1,0.2,0.3
"""


@pytest.mark.parametrize("text", [TUM, EUROC], ids=["TUM", "EuRoC"])
def test_both_forms_are_replayed_from_their_first_line(tmp_path, text):
    path = tmp_path / "path"
    path.write_text(text)
    world = World([Room()], Behaviour(act_s=0, path=track_file.read(path)))
    for t_s, rotation, place_m in (
        (0.0, [1, 0, 0, 0], (0, 0, 0)),
        (0.1, [0.5**0.5, 0, 0.5**0.5, 0], (0, 0.1, 0)),
        (0.4, [0.5, 0.5, 0.5, 0.5], (0.1, 0, 0.5)),
    ):
        state = world.at(t_s)
        assert state.rotation == pytest.approx(rotation, abs=1e-6)
        assert state.place_m == pytest.approx(place_m, abs=1e-6)
        assert state.scene.place_m == state.place_m


@given(
    keys=st.lists(rotations, min_size=1, max_size=5), step_ns=st.integers(1, 10**10),
    start_ns=st.integers(0, 2 * 10**18), is_euroc=st.booleans(),
)  # fmt: skip
def test_a_file_is_replayed_exactly_at_its_time_stamps(
    tmp_path_factory, keys, step_ns, start_ns, is_euroc
):
    path = tmp_path_factory.mktemp("path") / "any"
    lines = []
    for number, (w, x, y, z) in enumerate(keys):
        stamp_ns = start_ns + number * step_ns
        if is_euroc:
            lines.append(f"{stamp_ns},{number},0,0,{w!r},{x!r},{y!r},{z!r}")
        else:
            stamp = f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09}"
            lines.append(f"{stamp} {number} 0 0 {x!r} {y!r} {z!r} {w!r}")
    path.write_text("\n".join(lines).replace("np.float64(", "").replace(")", ""))
    track = track_file.read(path)
    for number, rotation in enumerate(keys):
        t_s = 1e-9 * number * step_ns
        assert same(track.rotation(t_s), rotation)
        assert track.place_m(t_s)[0] == pytest.approx(number, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no line with a pose"),
        ("# only words\n", "no line with a pose"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 1\n", r":2: 7 numbers: expected t x y z qx qy qz qw"),
        ("0 0 0 0 0 0 0 1 5\n", r":1: 9 numbers: expected t x y z"),
        ("0 0 0 0 0 0 0 1\n1 0 0 up 0 0 0 1\n", r":2: '1 0 0 up 0 0 0 1': expected numbers"),
        ("0 0 0 0 0 0 0 1\n1 0 0 nan 0 0 0 1\n", r":2: not finite"),
        ("0 0 0 0 0 0 0 1\nnan 0 0 0 0 0 0 1\n", r":2: not finite"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 2\n", r":2: a rotation of length 2: expected a unit"),
        ("0 0 0 0 0 0 0 1\n\n0 0 0 0 0 0 0 1\n", r":3: not later than the line before"),
        ("5,0,0,0,1,0,0,0\n7,0,0,0,1,0,0\n", r":2: 7 numbers: expected t, x, y, z, qw"),
        ("5,0,0,0,1,0,0,0\n4,0,0,0,1,0,0,0\n", r":2: not later"),
    ],
)
def test_bad_files_are_named_with_their_line(tmp_path, text, said):
    path = tmp_path / "walk.txt"
    path.write_text(text)
    with pytest.raises(UsageError, match=rf"^path: {path}.*{said}"):
        track_file.read(path)


def test_files_that_are_none(tmp_path):
    with pytest.raises(UsageError, match="No such file"):
        track_file.read(tmp_path / "missing")
    (tmp_path / "picture").write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(UsageError, match="no text"):
        track_file.read(tmp_path / "picture")


# ---------------------------------------------------------------- paths in worlds


def test_a_path_leaves_no_room_and_no_other_motion():
    places_m = np.array([[0, 0, 0], [3.0, 0, 0]])
    out = Track(np.array([0, 2.5]), np.tile(geometry.UNTURNED, (2, 1)), places_m)
    with pytest.raises(UsageError, match=r"2.5 s after its start .* outside the walls of room"):
        World([random_scene(0), Room()], Behaviour(path=out))
    for more in ({"turn_deg_s": 1}, {"swing_deg": 1}, {"nod_deg": 1}, {"roll_deg": 1}):
        with pytest.raises(UsageError, match="the path is all of the motion"):
            World([random_scene(0)], Behaviour(path=out, **more))


def test_nobody_leaves_their_place_in_a_panorama():
    """All of it is far away; the probe turns all the same."""
    track = Track(
        np.array([0, 1.0]), np.array([geometry.UNTURNED, turned(0, 40, 30)]),
        np.array([[0, 0, 0], [9.0, 0, 0]]),
    )  # fmt: skip
    state = World([random_scene(0)], Behaviour(path=track)).at(1.0)
    assert state.place_m == (0, 0, 0)
    assert state.angles_deg == pytest.approx((0, 40, 30))


def test_near_lamps_pass_by_a_probe_that_goes_along_a_path():
    place_m, rotation = np.array([0.8, -0.3, 0.5]), turned(40, 20, -10)
    world = World([Room()], held(rotation, place_m))
    state = world.at(0.0)
    for bulb, lamp in zip(Room().bulbs, state.truth().lamps, strict=True):
        there = geometry.normalize(np.array(bulb.position_m) - place_m)
        assert geometry.rotate(rotation, lamp.direction) == pytest.approx(there)
    normals = geometry.sphere_normals(1)
    expected = state.truth().irradiance(normals)
    found = irradiance(picture(world), normals)
    assert found == pytest.approx(expected, abs=0.03 * expected.max())


def test_a_state_without_an_exposure_does_not_smear():
    assert World([random_scene(0)], Behaviour(nod_deg=30)).at(0.0).smear_deg == 0
    assert State(0, 0, random_scene(0), turned(), np.ones(1)).smear_deg == 0
