"""What a real lens does to light: each defect does what its name says."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from lightprobe import geometry
from lightprobe.errors import UsageError
from lightprobe.imaging import camera as lenses
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.lens_defects import DefectiveLens, LensDefects
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.world import Behaviour, World

SIZE, SHOT = (256, 128), Shot(1000)
MODULE = Path(__file__).resolve().parents[3] / "packaging/cameras/theta_s.camera"
WEIGHT = np.repeat(geometry.equirect_solid_angles(*SIZE)[:, None], SIZE[0], 1)[..., None]
#: Each kind at a strength that shows.
KINDS = [
    "glare=0.05", "ghost=0.05", "point_spread_deg=2", "fringe=0.2", "dirt=0.5", "drops=5",
]  # fmt: skip


def lens(query: str, size: tuple[int, int] = SIZE, optics: Any = None, seed: int = 0) -> Any:
    defects = LensDefects().merged(query)
    return DefectiveLens(defects, optics or lenses.equirect(), size, seed)


def point(longitude_deg: float, latitude_deg: float, power: float = 1000.0) -> Any:
    """A panorama that is black but for one pixel."""
    radiance = np.zeros((SIZE[1], SIZE[0], 3), np.float32)
    radiance[place(longitude_deg, latitude_deg)] = power
    return radiance


def place(longitude_deg: float, latitude_deg: float) -> tuple[int, int]:
    return (
        int((90 - latitude_deg) / 180 * SIZE[1]),
        int((longitude_deg + 180) / 360 * SIZE[0]) % SIZE[0],
    )


def energy(radiance: Any) -> Any:
    return (radiance * WEIGHT).sum(axis=(0, 1))


def camera(query: str, behaviour: Behaviour | None = None, **more: Any) -> SimulatedCamera:
    world = World([random_scene(3)], behaviour or Behaviour(act_s=0))
    more = {"pixel_format": "RGBF", "rate_hz": 10, **more}
    return SimulatedCamera(
        world, lenses.equirect(), SIZE, lens_defects=LensDefects().merged(query), **more
    )


def floats(simulated: SimulatedCamera, number: int = 0) -> Any:
    return np.frombuffer(simulated.frame(number, SHOT), "<f4").reshape(SIZE[1], SIZE[0], 3)


@pytest.mark.parametrize("kind", ["glare=0.2", "ghost=0.2", "point_spread_deg=3", "fringe=0.3"])
@pytest.mark.parametrize("where", [(20.0, 5.0), (150.0, -60.0), (-100.0, 84.0)])
def test_light_that_is_spread_is_neither_lost_nor_made(
    kind: str, where: tuple[float, float]
) -> None:
    before = point(*where)
    after = lens(kind).through(before)
    assert energy(after) == pytest.approx(energy(before), rel=0.01)
    assert after.min() >= 0
    even = lens(kind).through(np.ones_like(before))
    assert even == pytest.approx(np.ones_like(before), abs=0.02)


def test_glare_lifts_black_by_its_share_of_a_sun_however_far_that_clips() -> None:
    sun = point(0, 10, 1e6)
    after = lens("glare=0.04").through(sun)
    assert after[place(0, 10)] == pytest.approx(0.96e6, rel=0.01)
    # Half of it is even over the lens ahead, half of the sphere, and no light gets to the other.
    even = 0.5 * 0.04 * energy(sun) / (2 * np.pi)
    far = after[place(-80, -50)]
    assert np.all(far > even)
    assert np.all(far < 1.5 * even)
    assert np.all(after[place(180, 0)] == 0)
    near, mid = after[place(12, 10)], after[place(40, 10)]
    assert np.all(near > 3 * mid)
    wide = lens("glare=0.04&glare_deg=40").through(sun)
    assert np.all(wide[place(40, 10)] > mid)
    assert lens("glare=0.02").through(sun)[place(60, 0)] == pytest.approx(
        after[place(60, 0)] / 2, rel=1e-3
    )


def test_a_clipped_sun_casts_the_veil_of_all_its_light() -> None:
    """Codes of black beside suns that both clip tell one from the other."""
    simulated = camera("glare=0.05", pixel_format="MJPG")
    sensor = simulated.sensor
    veils = [
        sensor.capture(lens("glare=0.05").through(point(0, 10, power)), 1e6)[place(-60, 0)].mean()
        for power in (1e3, 1e4)
    ]
    assert veils[1] > veils[0] + 20


@pytest.mark.parametrize(("at", "seen"), [((30, 20), (-30, -20)), ((150, 40), (-150, -40))])
def test_a_ghost_is_seen_on_the_other_side_of_its_lens_axis(at: Any, seen: Any) -> None:
    after = lens("ghost=0.02&ghost_deg=2").through(point(*at))[..., 1]
    after[place(*at)] = 0
    row, column = np.unravel_index(np.argmax(after), after.shape)
    wanted = place(*seen)
    assert abs(row - wanted[0]) <= 1
    assert abs(column - wanted[1]) <= 1
    mirrored = point(*seen)[..., 1] > 0
    near = cv2.dilate(mirrored.astype(np.uint8), np.ones((25, 25), np.uint8)) > 0
    there = (after[..., None] * WEIGHT)[near].sum()
    assert there == pytest.approx(0.02 * energy(point(*at))[1], rel=0.05)


def test_a_point_spreads_by_the_stated_angle_wherever_it_is() -> None:
    for latitude_deg in (0.0, 50.0):
        after = lens("point_spread_deg=3").through(point(0, latitude_deg))[..., 1:2] * WEIGHT
        directions = geometry.equirect_directions(*SIZE)
        middle = geometry.normalize((directions * after).sum(axis=(0, 1)))
        off_deg = geometry.angle_deg(directions, middle)[..., None]
        rms_deg = np.sqrt((after * off_deg**2).sum() / after.sum())
        assert rms_deg == pytest.approx(3 * np.sqrt(2), rel=0.05)


def test_what_clips_has_purple_beside_it() -> None:
    disc = np.zeros((SIZE[1], SIZE[0], 3), np.float32)
    disc[50:70, 100:120] = 50.0
    after = lens("fringe=0.1&fringe_deg=2").through(disc)
    red, green, blue = after[60, 122]
    assert blue > red > green == 0
    assert lens("fringe=0.1").through(disc)[60, 110, 1] == 50.0


def test_dirt_takes_its_share_at_its_spots_and_is_where_the_seed_says() -> None:
    white = np.ones((SIZE[1], SIZE[0], 3), np.float32)
    after = lens("dirt=0.4&dirt_spots=1&dirt_deg=5").through(white)
    assert after.min() == pytest.approx(0.6, abs=0.01)
    assert np.median(after) == pytest.approx(1)
    darker = (after[..., 0] < 1 - 0.4 * np.exp(-0.5)) @ np.ones(SIZE[0]) @ WEIGHT[:, 0, 0]
    assert darker == pytest.approx(2 * np.pi * (1 - np.cos(np.radians(5))), rel=0.1)
    again = lens("dirt=0.4&dirt_spots=1&dirt_deg=5").through(white)
    other = lens("dirt=0.4&dirt_spots=1&dirt_deg=5", seed=1).through(white)
    assert np.array_equal(after, again)
    assert not np.array_equal(after, other)


def test_a_drop_shows_a_blur_of_what_is_around() -> None:
    rng = np.random.default_rng(0)
    noise = rng.uniform(0, 2, (SIZE[1], SIZE[0], 3)).astype(np.float32)
    after = lens("drops=1&drops_deg=15").through(noise)
    changed = np.any(after != noise, axis=-1)
    share = (changed[..., None] * WEIGHT).sum() / (4 * np.pi)
    assert share == pytest.approx((1 - np.cos(np.radians(15))) / 2, rel=0.1)
    directions = geometry.equirect_directions(*SIZE)
    middle = geometry.normalize((directions * changed[..., None] * WEIGHT).sum(axis=(0, 1)))
    inside = geometry.angle_deg(directions, middle) < 10
    assert after[inside].std() < 0.05
    assert after[inside].mean() == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("kind", KINDS)
def test_defects_stand_still_on_the_camera_while_it_turns(kind: str) -> None:
    """What the turning camera shows is what its lens makes of the turned picture."""
    turning = Behaviour(act_s=0, turn_deg_s=90)
    plain, spoilt = camera("", turning), camera(kind, turning)
    wanted = lens(kind).through(floats(plain, 4))
    assert floats(spoilt, 4) == pytest.approx(wanted, rel=1e-4, abs=1e-4)
    assert not np.array_equal(floats(spoilt, 4), floats(plain, 4))


@pytest.mark.parametrize("kind", KINDS)
def test_two_fisheye_lenses_have_them_too(kind: str) -> None:
    optics = lenses.load(str(MODULE))
    size = (400, 400 * optics.height_px // optics.width_px // 2 * 2)
    seen = (optics.look(*size)[1] > 0)[..., None]
    rng = np.random.default_rng(0)
    light = rng.uniform(0, 2, (size[1], size[0], 3)).astype(np.float32) * seen
    after = lens(kind, size, optics).through(light)
    assert not np.array_equal(after, light)
    assert np.all(after[~seen[..., 0]] == 0)
    if kind.startswith("glare"):
        assert after.sum() == pytest.approx(light.sum(), rel=1e-3)


def test_a_ghost_of_a_fisheye_lens_is_mirrored_at_its_own_centre() -> None:
    optics = lenses.load(str(MODULE))
    size = (optics.width_px // 4 * 2, optics.height_px // 4 * 2)
    scale = size[0] / optics.width_px
    for one in optics.lenses:
        x, y = (scale * value for value in one.centre_px)
        light = np.zeros((size[1], size[0], 3), np.float32)
        light[int(y) + 30, int(x) + 40] = 1000
        after = lens("ghost=0.1&ghost_deg=1", size, optics).through(light)[..., 1]
        after[int(y) + 30, int(x) + 40] = 0
        row, column = np.unravel_index(np.argmax(after), after.shape)
        assert abs(row + 0.5 - (2 * y - int(y) - 30.5)) <= 1.5
        assert abs(column + 0.5 - (2 * x - int(x) - 40.5)) <= 1.5


@pytest.mark.parametrize("pixel_format", ["RGBF", "MJPG"])
def test_they_come_and_go_and_pictures_follow_although_some_are_kept(pixel_format: str) -> None:
    more: dict[str, Any] = {"pixel_format": pixel_format, "kept": 2}
    plain = camera("", **more)
    spoilt = camera("glare=0.1&from_s=1&to_s=2", **more)
    differs = [spoilt.frame(n, SHOT) != plain.frame(n, SHOT) for n in range(30)]
    first, last = differs.index(True), 29 - differs[::-1].index(True)
    assert (first, last) == (10, 19)  # the exposure of frame 9 begins just before
    assert all(differs[first : last + 1])


def test_a_hand_is_before_the_lens() -> None:
    hand = Behaviour(act_s=0, cover_from_s=0.0, cover_to_s=5.0)
    wanted = lens("glare=0.1").through(floats(camera("", hand)))
    assert floats(camera("glare=0.1", hand)) == pytest.approx(wanted, rel=1e-4, abs=1e-4)


def test_a_perfect_lens_changes_no_byte() -> None:
    for more in ({"pixel_format": "RGBF"}, {"pixel_format": "MJPG"}):
        plain = SimulatedCamera(
            World([random_scene(3)], Behaviour(act_s=0, turn_deg_s=30)), lenses.equirect(), SIZE,
            rate_hz=10, **more,
        )  # fmt: skip
        same = camera("ghost_deg=5&dirt_deg=9", Behaviour(act_s=0, turn_deg_s=30), **more)
        assert [plain.frame(n, SHOT) for n in range(3)] == [same.frame(n, SHOT) for n in range(3)]


def test_what_no_lens_has_is_refused() -> None:
    with pytest.raises(UsageError, match="lens defects: unknown option fog: known are glare"):
        LensDefects().merged("fog=1")
    with pytest.raises(UsageError, match="lens defects: glare=2: expected a number, 0…0"):
        LensDefects().merged("glare=2")
