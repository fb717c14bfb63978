"""`lightprobe check-camera`: veiling glare, by pictures with and without a lamp, without a daemon.

Veils are the simulator's, and those of a direct sum over directions that shares no code with it.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from lightprobe.calibrate import camera_file
from lightprobe.calibrate.exposure_series import ExposureSeries, Frame
from lightprobe.check_camera import glare
from lightprobe.check_camera.answers import Answer, Outcome
from lightprobe.check_camera.shade import SHADE_US
from lightprobe.imaging import camera as cameras
from lightprobe.imaging.camera import Camera, Glare, Lens, equirect
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.exposure import ExposureLimits
from lightprobe.sim.flicker import Flicker
from lightprobe.sim.lens_defects import LensDefects
from lightprobe.sim.movers import Card
from lightprobe.sim.series import Photographer
from lightprobe.sim.world import Behaviour, World

SIZE_PX = (640, 320)


@dataclass
class Room:
    """A simulated camera in a room, and a card for its lamp."""

    folder: object
    defects: str = ""
    scene: str = "room"
    median_radiance: float = 30.0
    flicker: Flicker | None = None

    def __post_init__(self):
        behaviour = Behaviour(act_s=0, **({"flicker": self.flicker} if self.flicker else {}))
        self.world = World(scenes.load([self.scene]), behaviour, self.median_radiance)
        self.taker = Photographer(
            SimulatedCamera(
                self.world, equirect(), SIZE_PX, limits=ExposureLimits(8, 33000, 0),
                lens_defects=LensDefects().merged(self.defects),
            ),
            self.folder,
        )  # fmt: skip

    def card(self, radius_deg=6.0, albedo=(0.0, 0.0, 0.0)):
        """Before the brightest lamp."""
        lamp = max(self.world.scenes[0].lamps, key=lambda one: np.sum(one.irradiance))
        x, y, z = lamp.direction
        azimuth, elevation = np.degrees([np.arctan2(x, -z), np.arcsin(y)])
        return Card(float(azimuth), float(elevation), radius_deg, albedo)

    def shoot(self):
        return self.taker.shoot(SHADE_US, 5)

    def answer(self, card):
        before = self.shoot()
        self.world.card = card
        return answered(before, self.shoot())


def answered(before, after, lens=None):
    lens = lens or equirect(*SIZE_PX)
    return glare.judge(glare.look(lens, before, after, equirect().response_table()))


def share(found):
    return found.numbers["even"] + found.numbers["around"]


@pytest.mark.parametrize("strength", [0.01, 0.03, 0.1])
def test_a_veil_of_the_simulator_is_measured(strength, tmp_path):
    room = Room(tmp_path, f"glare={strength}")
    found = room.answer(room.card(albedo=(0.1, 0.1, 0.1)))
    assert found.outcome is Outcome.DEFECT, found.words
    assert share(found) == pytest.approx(strength, rel=0.25)
    assert abs(share(found) - strength) < 3 * found.numbers["sigma"]


def test_the_picture_shows_how_the_veil_falls_off(tmp_path):
    room = Room(tmp_path, "glare=0.05")
    before = room.shoot()
    room.world.card = room.card()
    veil = glare.look(equirect(*SIZE_PX), before, room.shoot(), equirect().response_table())
    off_deg, went, fitted = veil.by_angle[np.isfinite(veil.by_angle).all(axis=1)].T
    assert off_deg[0] < 20 < 120 < off_deg[-1]
    assert fitted[0] > 5 * fitted[off_deg > 60].max()
    np.testing.assert_allclose(went, fitted, atol=0.15 * fitted[0])


def test_a_veil_at_the_limit_is_told_with_its_sigma(tmp_path):
    room = Room(tmp_path, "glare=0.005")
    found = room.answer(room.card())
    assert abs(share(found) - 0.005) < 3 * found.numbers["sigma"] < 0.006


@pytest.mark.parametrize("radius_deg", [3.0, 10.0])
def test_a_lens_without_a_veil_is_fine_whatever_the_card(radius_deg, tmp_path):
    room = Room(tmp_path)
    found = room.answer(room.card(radius_deg))
    assert found.outcome is Outcome.FINE, found.words


def test_a_wide_veil_is_told_by_its_width(tmp_path):
    room = Room(tmp_path, "glare=0.05&glare_deg=20")
    found = room.answer(room.card())
    assert found.numbers["width_deg"] > 10
    assert share(found) == pytest.approx(0.05, rel=0.25)


def test_a_ghost_is_no_veil(tmp_path):
    room = Room(tmp_path, "glare=0.03&ghost=0.01")
    found = room.answer(room.card())
    assert found.outcome is Outcome.UNKNOWN or share(found) == pytest.approx(0.03, rel=0.25)


def test_nothing_is_told_without_a_card(tmp_path):
    room = Room(tmp_path, "glare=0.03")
    found = room.answer(None)
    assert found.outcome is Outcome.UNKNOWN
    assert "no lamp was hidden" in found.words


def test_nothing_is_told_when_a_dark_place_was_hidden(tmp_path):
    room = Room(tmp_path, "glare=0.03")
    lamp = room.card()
    found = room.answer(Card(lamp.azimuth_deg + 150, -30, 5))
    assert found.outcome is Outcome.UNKNOWN, found.words


def test_nothing_is_told_when_half_the_view_is_covered(tmp_path):
    room = Room(tmp_path, "glare=0.03")
    found = room.answer(room.card(90))
    assert found.outcome is Outcome.UNKNOWN, found.words


def test_nothing_is_told_in_the_dark(tmp_path):
    room = Room(tmp_path, "glare=0.03", median_radiance=0.0003)
    found = room.answer(room.card())
    assert found.outcome is Outcome.UNKNOWN
    assert "dark" in found.words


def test_nothing_is_told_when_the_lamp_clips(tmp_path):
    room = Room(tmp_path, "glare=0.03", median_radiance=3000.0)
    found = room.answer(room.card())
    assert found.outcome is Outcome.UNKNOWN
    assert "clips" in found.words


def test_nothing_is_told_under_lamps_that_flicker(tmp_path):
    room = Room(tmp_path, "glare=0.03", flicker=Flicker(100.0, (0.3,)))
    found = room.answer(room.card())
    assert found.outcome is Outcome.UNKNOWN
    assert "flickers" in found.words


@pytest.mark.parametrize("factor", [0.95, 1.5])
def test_nothing_is_told_when_the_light_changes_meanwhile(factor, tmp_path):
    room = Room(tmp_path / "a", "glare=0.03")
    before = room.shoot()
    other = Room(tmp_path / "b", "glare=0.03", median_radiance=30.0 * factor)
    other.world.card = other.card()
    found = answered(before, other.shoot())
    assert found.outcome is Outcome.UNKNOWN
    assert "changed" in found.words


def test_a_missing_picture_is_told(tmp_path):
    room = Room(tmp_path, "glare=0.03")
    before = room.shoot()
    room.world.card = room.card()
    after = room.taker.shoot(SHADE_US[:-1], 5)
    assert "missing" in answered(before, after).words


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (Answer("tone mapping", Outcome.UNFIT, "local tone mapping"), "local tone mapping"),
        (Answer("tone mapping", Outcome.UNKNOWN, "because …"), "tone mapping"),
        (Answer("response", Outcome.UNKNOWN, "because …"), "response"),
        (Answer("exposure", Outcome.UNFIT, "commands without effect"), "without effect"),
        (Answer("exposure", Outcome.UNKNOWN, "because …"), "exposures are obeyed"),
        (Answer("exposure", Outcome.DEFECT, "late"), ""),
        (Answer("response", Outcome.FINE, "is sRGB"), ""),
        (Answer("sharpening", Outcome.UNKNOWN, "because …"), ""),
    ],
)
def test_what_makes_light_incomparable_forbids_the_question(answer, words):
    found = glare.hindrance([answer])
    assert words in found
    assert bool(found) == bool(words)


# ---------------------------------------------------------------- a veil by a direct sum

#: A camera of one lens of 200 degrees, and a panorama of one lens.
_LENS = Lens((240.0, 240.0), (137.0, 137.0), (0.0, 0.0, 0.0, 0.0), max_theta_deg=100.0)
FISHEYE = Camera("one", 480, 480, (_LENS,))
PANORAMA = equirect(480, 240)


def directions_and_areas(camera):
    """By the formulas of the two projections: (H, W, 3) and sr (H, W), 0 where nothing is seen."""
    width, height = camera.width_px, camera.height_px
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    if camera.is_equirect:
        lon, lat = (x / width - 0.5) * 2 * np.pi, (0.5 - y / height) * np.pi
        look = np.stack([np.cos(lat) * np.sin(lon), np.sin(lat), -np.cos(lat) * np.cos(lon)], -1)
        return look, np.cos(lat) * (2 * np.pi / width) * (np.pi / height)
    a, b = (x - 240) / 137, (y - 240) / 137
    theta = np.hypot(a, b)
    sine = np.sin(theta) / np.maximum(theta, 1e-9)
    area = np.where(theta < np.radians(100), sine / 137**2, 0)
    return np.stack([a * sine, -b * sine, -np.cos(theta)], -1), area


BLOCK_PX = 8


def blocks(values):
    """Sums of blocks of 8 × 8 pixels."""
    rows, columns = values.shape[0] // BLOCK_PX, values.shape[1] // BLOCK_PX
    return values.reshape(rows, BLOCK_PX, columns, BLOCK_PX, -1).sum(axis=(1, 3))


def veiled(light, look, area, stated):
    """(1 - s) x + even mean + around spread, by a sum over the directions of blocks."""
    flux, of = blocks(light * area).ravel(), blocks(area).ravel()
    middle = blocks(look).reshape(-1, 3)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    kernel = np.arccos(np.clip((middle @ middle.T).astype(np.float32), -1, 1))
    kernel = (1 + (np.degrees(kernel) / stated.width_deg) ** 2) ** -1.5
    entering = 1 / np.maximum(kernel @ of, 1e-9)  # of each source, so that none is lost
    spread = (kernel @ (flux * entering)).reshape(blocks(area).shape[:2])
    around = cv2.resize(spread, light.shape[::-1], interpolation=cv2.INTER_LINEAR)
    s, even = stated.even + stated.around, flux.sum() / of.sum()
    return np.where(area > 0, (1 - s) * light + stated.even * even + stated.around * around, 0)


def room_light(look, lamp, hidden):
    """Walls bright and dark in turn, and a lamp of 3 degrees, perhaps behind a card of 7."""
    turn = np.degrees(np.arctan2(look[..., 0], -look[..., 2]))
    wall = np.where(np.floor(turn / 24) % 2 == 0, 1.0, 0.15) * (1.3 + look[..., 1])
    off = np.degrees(np.arccos(np.clip(look @ lamp, -1, 1)))
    light = np.where(off < 3, 400.0, wall)
    return np.where(off < 7, 0.02, light) if hidden else light


def series(light, folder, seed):
    """Frames of an sRGB camera with a little noise, in format GREY."""
    rng, frames = np.random.default_rng(seed), []
    folder.mkdir()
    height, width = light.shape
    for step, us in enumerate(SHADE_US):
        for k in range(4):
            full = np.clip(light * us / 4096 + rng.normal(0, 0.002, light.shape), 0, 1)
            srgb = np.where(full < 0.0031308, 12.92 * full, 1.055 * full ** (1 / 2.4) - 0.055)
            path = folder / f"{step}-{k}.grey"
            path.write_bytes(np.rint(255 * srgb).astype(np.uint8).tobytes())
            frames.append(Frame(
                path=path, format="GREY", width_px=width, height_px=height, stride_bytes=0,
                sequence=len(frames), t_read_ns=len(frames) * 33_000_000, corrupt=False, step=step,
                t_command_ns=0, commanded_us=us, stated_us=None,
            ))  # fmt: skip
    return ExposureSeries("made", True, False, 8, 33000, 0, None, tuple(frames))


@pytest.mark.nightly_rows
@pytest.mark.parametrize("camera", [PANORAMA, FISHEYE], ids=["panorama", "fisheye"])
@pytest.mark.parametrize(("even", "around"), [(0.05, 0.05), (0.0, 0.0), (0.02, 0.0), (0.01, 0.01)])
def test_a_veil_by_a_direct_sum_is_measured(camera, even, around, tmp_path):
    look, area = directions_and_areas(camera)
    lamp = np.array([0.4, 0.3, -0.866])
    lamp /= np.linalg.norm(lamp)
    before, after = (
        series(
            veiled(room_light(look, lamp, hidden), look, area, Glare(even, around, 10)),
            tmp_path / str(hidden), int(hidden),
        )
        for hidden in (False, True)
    )  # fmt: skip
    found = answered(before, after, camera)
    if even + around == 0:
        assert found.outcome is Outcome.FINE, found.words
        return
    assert found.outcome is Outcome.DEFECT, found.words
    assert share(found) == pytest.approx(even + around, rel=0.25)
    assert abs(found.numbers["even"] - even) < 0.25 * (even + around)


# ---------------------------------------------------------------- the camera file


def test_a_veil_is_written_into_the_camera_file(tmp_path):
    path = tmp_path / "my.camera"
    camera_file.save_glare(path, (640, 320), Glare(0.0123, 0.004, 14))
    assert cameras.load(str(path)).glare == Glare(0.0123, 0.004, 14)
    camera_file.save_glare(path, (640, 320), Glare(0.02, 0.0, 10))
    assert cameras.load(str(path)).glare == Glare(0.02, 0.0, 10)
