"""Malus' law through the simulated wheel, and the polarized scenes that it is for."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe import geometry
from lightprobe.errors import LightprobeError
from lightprobe.imaging import camera
from lightprobe.imaging.camera import Camera, Lens
from lightprobe.imaging.film import Sheet
from lightprobe.imaging.polarizer import Polarizer
from lightprobe.sim import scenes
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.exposure import ExposureLimits
from lightprobe.sim.motion import turned
from lightprobe.sim.polarized import PolishedFloor, Sky, StokesPanorama, fresnel, pixel_frame
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.world import Behaviour, World

SIZE = (32, 16)
#: Without surfaces: those of real ones are looked at below.
SHEET = Sheet(transmission=0.8, extinction_ratio=100, index=1.0)
FISHEYE = Camera(
    "two", 64, 32,
    lenses=tuple(
        Lens((x, 16), (9, 9), (0, 0, 0, 0), 95, rotation_wxyz=turn)
        for x, turn in ((16, (1, 0, 0, 0)), (48, (0, 0, 1, 0)))
    ),
)  # fmt: skip

angles = st.floats(-360, 360)
seeds = st.integers(0, 2**32 - 1)


def equirect_polarizer() -> Polarizer:
    return Polarizer(SHEET, camera.equirect(), SIZE)


def drawn_stokes(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Physical S0 (H, W, 3) and S1, S2 (2, H, W, 3)."""
    rng = np.random.default_rng(seed)
    s0 = rng.uniform(0.1, 10, (SIZE[1], SIZE[0], 3))
    degree, turn = rng.uniform(0, 1, s0.shape), rng.uniform(0, 2 * np.pi, s0.shape)
    linear = np.stack([degree * s0 * np.cos(turn), degree * s0 * np.sin(turn)])
    return s0.astype(np.float32), linear.astype(np.float32)


@given(wheel_deg=angles, light_deg=angles)
def test_malus_law_on_the_axis(wheel_deg: float, light_deg: float) -> None:
    """Straight ahead, wholly polarized at light_deg: transmission of the sheet's two axes."""
    polarizer = equirect_polarizer()
    s0 = np.ones((SIZE[1], SIZE[0], 3), np.float32)
    turn = np.radians(2 * light_deg)
    linear = np.stack([np.cos(turn) * s0, np.sin(turn) * s0]).astype(np.float32)
    seen = polarizer.through(s0, linear, (wheel_deg,))[7:9, 15:17].mean()
    along = SHEET.transmission * SHEET.extinction_ratio / (SHEET.extinction_ratio + 1)
    across = SHEET.transmission / (SHEET.extinction_ratio + 1)
    cosine = np.cos(np.radians(wheel_deg - light_deg)) ** 2
    # Half a pixel off the axis all around: their mean is on it, to second order.
    assert seen == pytest.approx(along * cosine + across * (1 - cosine), abs=0.01)


@given(wheel_deg=angles, seed=seeds)
def test_unpolarized_light_loses_the_same_everywhere(wheel_deg: float, seed: int) -> None:
    s0, _ = drawn_stokes(seed)
    polarizer = equirect_polarizer()
    assert polarizer.through(s0, None, (wheel_deg,)) == pytest.approx(0.4 * s0, rel=1e-6)
    none = np.zeros((2, *s0.shape), np.float32)
    assert polarizer.through(s0, none, (wheel_deg,)) == pytest.approx(0.4 * s0, rel=1e-6)


@pytest.mark.parametrize("lens", [camera.equirect(), FISHEYE])
@given(wheel_deg=angles)
def test_what_passes_is_across_what_the_sheet_absorbs(lens: Camera, wheel_deg: float) -> None:
    """The field that passes is normal to the ray and to the absorbing direction n × p."""
    size = (32, 16)
    cosine, sine = Polarizer(SHEET, lens, size).axis(wheel_deg)
    directions, light = lens.look(*size)
    directions = np.where(light[..., None] > 0, directions, [0, 0, -1.0])
    right, up = pixel_frame(directions)
    psi = np.arctan2(sine, cosine) / 2
    field = np.cos(psi)[..., None] * right + np.sin(psi)[..., None] * up
    owner = lens.owner(*size)
    turns = [geometry.rotation_matrix(part.rotation_wxyz) for part in lens.lenses] or [np.eye(3)]
    t = np.radians(wheel_deg)
    for number, turn in enumerate(turns):
        absorbed = turn @ np.cross([0, 0, -1.0], [np.cos(t), np.sin(t), 0])
        mine = field[(owner == number) & (light > 0)]
        assert np.abs(mine @ absorbed).max() < 1e-5
    assert np.abs((field * directions).sum(-1)).max() < 1e-6
    assert cosine**2 + sine**2 == pytest.approx(1, abs=1e-5)


@given(seed=seeds)
def test_three_angles_give_the_stokes_parameters_back(seed: int) -> None:
    s0, linear = drawn_stokes(seed)
    polarizer = equirect_polarizer()
    wheel = (0.0, 60.0, 120.0)
    seen = np.stack([polarizer.through(s0, linear, (deg,)) for deg in wheel]).astype(np.float64)
    axes = [polarizer.axis(deg) for deg in wheel]
    d = SHEET.diattenuation
    # (H, W, 3 angles, 3 unknowns); badly conditioned where the sheet is seen edge-on.
    system = 0.4 * np.stack([np.stack([np.ones_like(c), d * c, d * s], -1) for c, s in axes], -2)
    good = np.linalg.cond(system) < 20
    assert good.mean() > 0.6
    found = np.linalg.solve(system[good], np.moveaxis(seen, 0, 2)[good])
    truth = np.stack([s0, *linear], axis=2)[good]
    assert found == pytest.approx(truth, abs=2e-3)


@given(start=angles, speed=st.floats(-8, 8), seed=seeds)
def test_a_moving_wheel_is_the_mean_of_its_angles(start: float, speed: float, seed: int) -> None:
    s0, linear = drawn_stokes(seed)
    polarizer = equirect_polarizer()
    way = [start + speed * k for k in range(4)]
    mean = np.mean([polarizer.through(s0, linear, (deg,)) for deg in way], axis=0)
    assert polarizer.through(s0, linear, way) == pytest.approx(mean, rel=1e-3, abs=1e-4)


# ---------------------------------------------------------------- scenes


def test_fresnel() -> None:
    across, along = fresnel([0, np.degrees(np.arctan(1.5)), 90], 1.5)
    assert across[0] == along[0] == pytest.approx(0.04)
    assert along[1] == pytest.approx(0, abs=1e-12)
    assert across[1] == pytest.approx(0.14793, abs=1e-5)
    assert (across[2], along[2]) == pytest.approx((1, 1))


@settings(max_examples=12)
@given(seed=st.integers(0, 200), yaw=st.floats(0, 360))
def test_a_polished_floor_mirrors_lamps_and_adds_none(seed: int, yaw: float) -> None:
    plain = random_scene(seed)
    scene = PolishedFloor(plain)
    powers = np.ones(len(scene.lamps))
    before, after = plain.render(64, 32), scene.render(64, 32)
    s0, (s1, s2) = after.compose(powers), after.compose_polarized(powers)
    assert not after.unpolarized
    assert s0[:16] == pytest.approx(before.compose(powers)[:16])
    mirrored = s0[16:] - before.compose(powers)[16:]
    elevation_deg = 180 * (np.arange(16) + 0.5) / 32
    across, along = fresnel(90 - elevation_deg, 1.5)
    sky = before.compose(powers)[15::-1]
    tall = 1e-5 * float(s0.max())
    assert mirrored == pytest.approx((across + along)[:, None, None] / 2 * sky, rel=1e-3, abs=tall)
    assert s1[16:] == pytest.approx((across - along)[:, None, None] / 2 * sky, rel=1e-3, abs=tall)
    assert not s2.any()
    assert np.all(np.hypot(s1, s2) <= s0 + tall)
    assert len(scene.truth(powers, turned(yaw)).lamps) == len(plain.lamps)


def test_a_polished_polished_floor_switches_lamps_with_their_reflections() -> None:
    scene = PolishedFloor(scenes.load(["room"])[0])
    layers = scene.render(64, 32)
    off = np.zeros(len(scene.lamps))
    dark, lit = layers.compose_polarized(off), layers.compose_polarized(off + 1)
    assert lit[0].max() > 3 * dark[0].max()
    assert scene.scaled(2).render(64, 32).compose_polarized(off + 1) == pytest.approx(2 * lit)


def test_the_skys_polarization() -> None:
    sky = Sky(sun_elevation_deg=0, sun_azimuth_deg=0)
    assert sky.sun == pytest.approx([0, 0, -1])
    # 90° to the right of a sun on the horizon: scattered in the horizontal plane, so vertical.
    right = sky.stokes(np.array([1.0, 0, 0]))
    assert right[1] / right[0] == pytest.approx(-0.75)
    assert right[2] == pytest.approx(0, abs=1e-12)
    # At the sun itself nothing is polarized.
    near = sky.stokes(geometry.direction_from_angles(0.1, 0))
    assert np.hypot(near[1], near[2]) / near[0] == pytest.approx(0, abs=1e-5)


@given(azimuth=st.floats(-180, 180), elevation=st.floats(-85, 85), sun=st.floats(-80, 80))
def test_the_skys_field_is_across_sun_and_view(
    azimuth: float, elevation: float, sun: float
) -> None:
    sky = Sky(sun_elevation_deg=sun)
    view = geometry.direction_from_angles(azimuth, elevation)
    s0, s1, s2 = sky.stokes(view)[:, 1]
    degree = np.hypot(s1, s2) / s0
    assert degree <= 0.75 + 1e-9
    if degree > 1e-3:
        right, up = pixel_frame(view)
        psi = np.arctan2(s2, s1) / 2
        field = np.cos(psi) * right + np.sin(psi) * up
        assert field @ sky.sun == pytest.approx(0, abs=1e-6)


def test_stokes_panoramas_from_files(tmp_path: Path) -> None:
    layers = Sky().render(64, 32)
    stokes = np.zeros((32, 64, 4, 3), np.float32)
    stokes[:, :, 0] = layers.base
    stokes[:, :, 1:3] = np.moveaxis(layers.polarized, 0, 2)
    np.savez(tmp_path / "sky.npz", S=stokes)
    scene = scenes.load([str(tmp_path / "sky.npz")])[0]
    assert isinstance(scene, StokesPanorama)
    powers = np.ones(len(scene.lamps))
    assert scene.render(64, 32).compose_polarized(powers) == pytest.approx(layers.polarized)
    small = scene.scaled(2).render(32, 16).compose_polarized(powers)
    means = layers.polarized.reshape(2, 16, 2, 32, 2, 3).mean(axis=(2, 4))
    assert small == pytest.approx(2 * means, rel=1e-4, abs=1e-5)
    np.savez(tmp_path / "bad.npz", S=stokes[:, :32])
    (tmp_path / "text.npz").write_text("no archive")
    for name, message in [
        ("bad.npz", "expected"),
        ("text.npz", "array S"),
        ("none.npz", "No such"),
    ]:
        with pytest.raises(LightprobeError, match=message):
            scenes.load([str(tmp_path / name)])


# ---------------------------------------------------------------- through the camera


def simulated(scene: object, behaviour: Behaviour, lens: Camera, form: str) -> SimulatedCamera:
    world = World([scene], behaviour)
    return SimulatedCamera(world, lens, SIZE, pixel_format=form, sheet=SHEET)


def floats(frame: bytes) -> np.ndarray:
    return np.frombuffer(frame, "<f4").reshape(SIZE[1], SIZE[0], 3)


@given(wheel_deg=angles, number=st.integers(0, 400))
def test_the_camera_sees_a_turning_polarized_world_through_a_wheel_that_does_not_turn_with_it(
    wheel_deg: float, number: int
) -> None:
    lens = camera.equirect()
    taken = simulated(Sky(), Behaviour(turn_deg_s=30), lens, "RGBF")
    frame = floats(taken.frame(number, Shot(1000), (wheel_deg,)))
    turn_px = round(taken.state(number, Shot(1000)).angles_deg[0] / 360 * SIZE[0])
    layers = Sky().render(*SIZE)
    s0 = np.roll(layers.compose([1]), turn_px, axis=1)
    linear = np.roll(layers.compose_polarized([1]), turn_px, axis=2)
    assert frame == pytest.approx(equirect_polarizer().through(s0, linear, (wheel_deg,)), rel=1e-5)


@pytest.mark.parametrize("lens", [camera.equirect(), FISHEYE])
def test_codes_follow_the_wheel_only_where_light_is_polarized(lens: Camera) -> None:
    quiet = Behaviour(turn_deg_s=10)
    for scene, follows in ((random_scene(2), False), (Sky(), True)):
        taken = simulated(scene, quiet, lens, "GREY")
        shot = taken.automatic(0)[0]
        frames = [taken.frame(9, shot, (deg,)) for deg in (0.0, 90.0, 180.0)]
        assert frames[0] == frames[2]
        assert (frames[0] != frames[1]) == follows


def test_automatic_exposure_makes_up_for_the_polarizer() -> None:
    world = World([random_scene(1)], None, 30.0)
    finely = ExposureLimits(1, 33000, 0)
    bare = SimulatedCamera(world, camera.equirect(), SIZE, limits=finely)
    through = SimulatedCamera(world, camera.equirect(), SIZE, sheet=SHEET, limits=finely)
    shots = bare.automatic(0)[0], through.automatic(0)[0]
    assert shots[1].exposure_us == pytest.approx(shots[0].exposure_us / 0.4)
    same = [taken.frame(3, shot) for taken, shot in zip((bare, through), shots, strict=True)]
    assert same[0] == same[1]


# ---------------------------------------------------------------- several sheets


def test_a_stack_of_three_is_one_sheet_and_a_grey_filter():
    """Equations 1 to 3 of the research, and what its stack is: ideal sheets, on the axis."""
    film = Polarizer(Sheet(1.0, 1e9), camera.load("equirect"), (128, 64))
    ones = np.ones((64, 128, 3), np.float32)
    row, column = 32, 64  # ahead

    def passed(*stack_deg, polarized=None):
        return film.through_stack(ones, polarized, stack_deg)[row, column, 0]

    assert passed(90) == pytest.approx(0.5, abs=1e-3)
    assert passed(90, 0) == pytest.approx(0.0, abs=2e-3)
    assert passed(90, 45, 0) == pytest.approx(0.125, abs=1e-3)
    upright = np.stack([-ones, 0 * ones])
    assert passed(90, 45, 0, polarized=upright) == pytest.approx(0.25, abs=2e-3)
    assert passed(90, 45, 0, polarized=-upright) == pytest.approx(0, abs=1e-3)


def test_one_sheet_is_a_stack_of_one():
    scene = PolishedFloor(random_scene(2))
    layers, powers = scene.render(128, 64), np.ones(len(scene.lamps))
    light = layers.compose(powers), layers.compose_polarized(powers)
    film = Polarizer(Sheet(0.8, 50, 12.0), camera.load("equirect"), (128, 64))
    np.testing.assert_allclose(
        film.through_stack(*light, (30.0,)), film.through(*light, (30.0,)), rtol=1e-4, atol=1e-4
    )


def test_three_real_sheets():
    """0.0675 S0 - 0.0672 S1 + 0.0066 S2, by Mueller matrices of 84 % and 500 : 1."""
    film = Polarizer(Sheet(), camera.load("equirect"), (128, 64))
    ones, none = np.ones((64, 128, 3), np.float32), np.zeros((64, 128, 3), np.float32)
    behind = [
        film.through_stack(s0, np.stack([s1, s2]), (90, 45, 0))[32, 64, 0]
        for s0, s1, s2 in [(ones, none, none), (ones, -ones, none), (ones, none, ones)]
    ]
    assert behind[0] == pytest.approx(0.0675, abs=2e-4)
    assert behind[1] - behind[0] == pytest.approx(0.0672, abs=2e-4)
    assert behind[2] - behind[0] == pytest.approx(0.0066, abs=5e-4)


# ---------------------------------------------------------------- surfaces


class Ray:
    """A lens of one pixel, which looks along a direction."""

    lenses = ()

    def __init__(self, off_deg: float, round_deg: float) -> None:
        off, turn = np.radians([off_deg, round_deg])
        self._direction = [np.sin(off) * np.cos(turn), np.sin(off) * np.sin(turn), -np.cos(off)]

    def look(self, _width: int, _height: int) -> tuple[np.ndarray, np.ndarray]:
        return np.array([[self._direction]]), np.ones((1, 1))

    def owner(self, _width: int, _height: int) -> np.ndarray:
        return np.zeros((1, 1), np.intp)


def gain(index: float, wheel_deg: float, off_deg: float, round_deg: float = 0.0) -> float:
    sheet = Sheet(1.0, 1e9, index=index)
    return float(Polarizer(sheet, Ray(off_deg, round_deg), (1, 1)).gain(wheel_deg)[0, 0])


@pytest.mark.parametrize(
    ("off_deg", "dolp", "loss"),
    [(20, 0.014, 0), (45, 0.086, 0.019), (60, 0.186, 0.091), (74, 0.355, 0.339)],
)
def test_what_two_surfaces_do_to_unpolarized_light(off_deg: float, dolp: float, loss: float):
    """What a sweep would call its DoLP, and what is lost: two surfaces of acrylic, 1.49.

    The figures are without what is mirrored inside, 1 / (1 - R²), which is taken out here.
    """
    across, along = fresnel([off_deg], 1.49)[0][0], fresnel([off_deg], 1.49)[1][0]
    head_on = fresnel([0], 1.49)[0][0]
    once = [gain(1.49, wheel, off_deg) * (1 - r**2) / (1 - head_on**2)
            for wheel, r in ((0, along), (90, across))]  # fmt: skip
    assert (once[0] - once[1]) / sum(once) == pytest.approx(dolp, abs=0.0006)
    assert 1 - sum(once) / 2 == pytest.approx(loss, abs=0.001)


@pytest.mark.parametrize(
    ("off_deg", "darkest", "brightest", "dolp"), [(60, 0.76, 1.08, 0.17), (74, 0.49, 0.91, 0.30)]
)
def test_a_white_wall_aside_is_as_the_page_has_it(off_deg, darkest, brightest, dolp):
    """Figures of docs/users/polarization.md, for an index of 1.5."""
    along, across = gain(1.5, 0, off_deg), gain(1.5, 90, off_deg)
    assert (across, along) == pytest.approx((darkest, brightest), abs=0.006)
    assert (along - across) / (along + across) == pytest.approx(dolp, abs=0.006)


@given(
    off_deg=st.floats(0, 74.9), round_deg=st.floats(0, 360), wheel_deg=angles,
    index=st.floats(1, 2),
)  # fmt: skip
def test_surfaces_take_light_and_make_none(
    off_deg: float, round_deg: float, wheel_deg: float, index: float
) -> None:
    """Each ray once more, as a sum over all ways to and fro between the surfaces, in space."""
    off, turn, wheel = np.radians([off_deg + 0.05, round_deg, wheel_deg])
    d = np.array([np.sin(off) * np.cos(turn), np.sin(off) * np.sin(turn), -np.cos(off)])
    n = np.array([0, 0, -1.0])
    absorbed = np.cross(n, [np.cos(wheel), np.sin(wheel), 0])
    s = np.cross(n, d) / np.sin(off)
    inner = np.arcsin(np.sin(off) / index)
    k = np.sin(inner) * np.cross(s, n) + np.cos(inner) * n
    mirrored = k - 2 * (k @ n) * n
    e, back = (np.cross(way, absorbed) for way in (k, mirrored))
    e, back = e / np.linalg.norm(e), back / np.linalg.norm(back)
    across, along = (float(part[0]) for part in fresnel([np.degrees(off)], index))
    # Amplitudes inside, with their signs: along the plane it turns round at Brewster's angle.
    sign = 1 if np.tan(off) < index else -1
    r = np.sqrt(across) * (e @ s) * (back @ s)
    r += sign * np.sqrt(along) * (e @ np.cross(s, k)) * (back @ np.cross(mirrored, s))
    passes = (1 - across) * (e @ s) ** 2 + (1 - along) * (e @ np.cross(s, k)) ** 2
    share = sum(passes**2 * r ** (4 * way) for way in range(200))
    assert share <= 1 + 1e-9
    head_on = ((index - 1) / (index + 1)) ** 2
    ahead = (1 - head_on) ** 2 / (1 - head_on**2)
    found = gain(index, wheel_deg, off_deg + 0.05, round_deg)
    assert found == pytest.approx(share / ahead, rel=1e-3)
    assert gain(index, wheel_deg, 0) == pytest.approx(1, abs=1e-4)


def test_a_film_off_its_axis_dims_a_grey_world() -> None:
    """Also pictures in which nothing is polarized; an ideal film does not."""
    world = World([random_scene(1)])
    shot, wheel = Shot(1000), (20.0,)
    for index, same in ((1.0, True), (1.5, False)):
        sheet = Sheet(0.8, 100, index=index)
        taken = SimulatedCamera(world, camera.equirect(), SIZE, pixel_format="RGBF", sheet=sheet)
        assert taken.sees_wheel(taken.state(0, shot)) != same
        bare = SimulatedCamera(world, camera.equirect(), SIZE, pixel_format="RGBF")
        share = floats(taken.frame(0, shot, wheel)) / floats(bare.frame(0, shot))
        film = Polarizer(sheet, camera.equirect(), SIZE)
        assert share[..., 1] == pytest.approx(0.4 * film.gain(wheel[0]), rel=1e-5)
        assert (share.std() < 1e-6) == same
