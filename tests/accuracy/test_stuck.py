"""Pixels that shine by themselves, before a daemon in simulated time; each with a bound."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import live
import numpy as np
import pytest
from judge import Figures, Light, Packet
from lightprobe import geometry
from lightprobe.estimate import EstimateFlag
from lightprobe.evaluate.metrics import relighting_relative
from lightprobe.imaging import camera as lenses
from lightprobe.imaging.film import Sheet
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.live import LiveClient, LiveProbe
from lightprobe.sim.pixel_defects import PixelDefects
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.room import Room
from lightprobe.sim.scene import PanoramaScene
from lightprobe.sim.world import Behaviour, State, World
from lightprobe.wire import Subscription
from recording import INDOORS, SIZE_PX

pytestmark = pytest.mark.many_frames

SMALL_PX = (960, 480)
SCENES = Path(__file__).parents[2] / "build" / "scenes"
STILL = Behaviour(act_s=0)
HEAD = live.MOTIONS["head"]
SUBSCRIPTION = Subscription(smoothing="RAW", max_lights=8, sh_order=4, health_period_ms=100)


@cache
def judged(
    defects: str, size_px: tuple[int, int] = SMALL_PX, exposures: str = "reported"
) -> Figures:
    """Figures of the raw packets while a head looks around; once in each process that asks."""
    run = live.case(
        Room(), "head", exposures, size_px=size_px, pixels=PixelDefects().merged(defects)
    )  # fmt: skip
    return next(one.figures for one in live.judged(run) if one.subscription == "raw")


def watched(
    camera: SimulatedCamera, times_s: Sequence[float], arguments: Sequence[str] = ()
) -> tuple[LiveClient, list[int], str]:
    """Places left out at some times; and the log."""
    counts = []
    with LiveProbe(camera, arguments) as probe:
        client = probe.client(SUBSCRIPTION)
        for before, t_s in zip((0.0, *times_s), times_s, strict=False):
            probe.run(t_s - before)
            assert client.health is not None
            counts.append(client.health.places_left_out)
        log = probe._daemon.log.read_text()
    return client, counts, log


def room(behaviour: Behaviour, defects: PixelDefects | None = None) -> SimulatedCamera:
    """A camera in a room, whose sensor has them."""
    world = World([Room()], behaviour, median_radiance=INDOORS)
    return SimulatedCamera(world, lenses.load("equirect"), SMALL_PX, pixels=defects)


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    ("defects", "size_px"),
    [
        ("stuck=12", SMALL_PX),
        ("stuck=12&bayer=1", SMALL_PX),
        ("stuck=60", SMALL_PX),
        ("stuck=12", SIZE_PX),
    ],
)
def test_stuck_pixels_cost_a_head_that_moves_nothing(
    defects: str, size_px: tuple[int, int]
) -> None:
    without, found = judged("", size_px), judged(defects, size_px)
    assert found.births_per_s <= without.births_per_s + 1.0
    assert found.error_median < without.error_median + 0.002
    assert found.wrong_and_healthy == 0


@pytest.mark.nightly
def test_exposures_need_not_be_reported() -> None:
    without, found = (judged(one, exposures="unreported") for one in ("", "stuck=12"))
    assert found.births_per_s <= without.births_per_s + 1.0
    assert found.error_median < without.error_median + 0.002


@pytest.mark.nightly
def test_a_row_that_shines_does_no_harm_and_a_thousand_pixels_less() -> None:
    for defects, error, births_per_s in (("row=240", 0.02, 1.5), ("stuck=1000", 0.15, 8.0)):
        found = judged(defects)
        assert found.births_per_s <= births_per_s
        assert found.error_median < error
        assert found.wrong_and_healthy == 0


def test_they_are_learned_counted_and_named_and_forgotten_when_they_are_cured() -> None:
    defects = PixelDefects(stuck=12, to_s=5.0)
    _, counts, log = watched(room(HEAD, defects), (1.5, 4.8, 8.0))
    assert counts[0] >= 6
    assert 8 <= counts[1] <= 13
    assert counts[2] <= 2
    assert len(re.findall("places of the picture shine wherever it looks", log)) == 1
    places = {
        tuple(place // 8)
        for place in defects.at(SMALL_PX, 1.0, lenses.load("equirect").response_table()).places
    }
    named = re.findall(r"(\d+),(\d+)", log.split("around the pixels")[1].split(";")[0])
    assert len(named) >= 6
    assert {(int(x) // 8, int(y) // 8) for x, y in named} <= places


@pytest.mark.nightly
def test_they_may_come_while_the_camera_runs() -> None:
    _, counts, _ = watched(room(HEAD, PixelDefects(stuck=12, from_s=3.0)), (2.9, 6.0))
    assert counts[0] == 0
    assert counts[1] >= 8


@pytest.mark.nightly
def test_lamps_of_a_room_are_none_whether_the_camera_holds_still_or_turns() -> None:
    for behaviour in (STILL, HEAD, Behaviour(act_s=0, turn_deg_s=30)):
        client, counts, _ = watched(room(behaviour), (2.0, 4.0, 6.0))
        assert counts == [0, 0, 0]
        assert len(client.estimates[-1].lights) >= 3


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    ("scene", "size_px", "behaviour"),
    [
        ("studio", SMALL_PX, Behaviour(act_s=0, turn_deg_s=30)),
        ("night", (480, 240), HEAD),
        ("interior", (480, 240), HEAD),
    ],
)
def test_lamps_in_rows_are_none(scene: str, size_px: tuple[int, int], behaviour: Behaviour) -> None:
    """Up to 18 places were left out, and up to 80 % of the packets had PARTIAL_VIEW."""
    panorama = PanoramaScene.load(str(SCENES / f"{scene}.exr"))
    world = World([panorama], behaviour, median_radiance=INDOORS)
    camera = SimulatedCamera(world, lenses.load("equirect"), size_px)
    client, counts, _ = watched(camera, (2.0, 4.0, 6.0))
    assert counts == [0, 0, 0]
    assert not any(one.flags & EstimateFlag.PARTIAL_VIEW for one in client.estimates[30:])


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    ("size_px", "rate_hz", "film"),
    [(SMALL_PX, 10.0, False), ((1920, 960), 30.0, True)],
)
def test_a_lamp_about_which_the_camera_turns_is_none(
    size_px: tuple[int, int], rate_hz: float, film: bool
) -> None:
    """One lamp at the zenith of a room without texture: all else tells little of the turn.

    It was left out as a light of the box: a quarter of the light was missing, flags were 0.
    """
    behaviour = Behaviour(act_s=0, swing_deg=40, swing_hz=0.2)
    world = World([random_scene(0)], behaviour, None if film else 0.2)
    camera = SimulatedCamera(
        world, lenses.load("equirect"), size_px, rate_hz=rate_hz, sheet=Sheet() if film else None
    )
    light = Light.of(world.scenes[0])
    with LiveProbe(
        camera, ["--polarizer=fixed:45"] if film else [], film_deg=45.0 if film else None
    ) as probe:
        client = probe.client(SUBSCRIPTION)
        probe.run(6.0)
        assert client.health is not None
        assert client.health.places_left_out == 0
        for one in client.estimates[len(client.estimates) // 2 :]:
            t_s = probe.captured_s(one)
            turn = Packet(one, camera.true_rotation(world.at(t_s))).turn
            got = one.irradiance(light.normals @ turn.T)
            assert relighting_relative(light.irradiance, got) < 0.05
            assert one.lights


def test_a_camera_that_holds_still_takes_a_stuck_pixel_for_what_it_may_be() -> None:
    _, counts, _ = watched(room(STILL, PixelDefects(stuck=12)), (6.0,))
    assert counts == [0]


def naming(places: Iterable[Sequence[int]], folder: Path) -> Path:
    """Camera file that names pixels."""
    (folder / "stuck.txt").write_text("".join(f"{x} {y}\n" for x, y in places))
    file = folder / "probe.camera"
    file.write_text(
        "[camera]\nprojection = equirect\nwidth_px = 960\nheight_px = 480\n"
        "stuck_pixels = stuck.txt\n"
    )
    return file


def test_a_camera_file_names_them_to_a_camera_that_holds_still(tmp_path: Path) -> None:
    defects = PixelDefects(stuck=12)
    camera = room(STILL, defects)
    places = defects.at(SMALL_PX, 1.0, lenses.load("equirect").response_table()).places
    file = naming(places, tmp_path)
    assert (lenses.load(str(file)).stuck_px == places).all()
    spoilt, _, _ = watched(camera, (4.0,))
    told, counts, _ = watched(room(STILL, defects), (4.0,), [f"--camera={file}"])
    without, _, _ = watched(room(STILL), (4.0,))
    lamps = [len(one.estimates[-1].lights) for one in (without, spoilt, told)]
    assert counts[0] >= 12
    assert lamps[0] == lamps[2] < lamps[1]


@pytest.mark.nightly
def test_a_lamp_behind_a_place_that_is_left_out_is_not_missing_unsaid(tmp_path: Path) -> None:
    """To a camera that holds still nothing shows what is there: it is filled, and PARTIAL_VIEW."""
    scene = random_scene(1)
    lamp = min(scene.lamps, key=lambda one: one.radius_deg)
    column, row = np.floor(geometry.equirect_pixel(lamp.direction, *SMALL_PX)).astype(int)
    file = naming([(column, row)], tmp_path)
    for behaviour, flagged in ((STILL, True), (HEAD, False)):
        world = World([scene], behaviour, median_radiance=INDOORS)
        camera = SimulatedCamera(world, lenses.load("equirect"), SMALL_PX)
        client, _, _ = watched(camera, (4.0,), [f"--camera={file}"])
        flags = [bool(one.flags & EstimateFlag.PARTIAL_VIEW) for one in client.estimates[-60:]]
        assert all(flags) if flagged else not any(flags)


class Stops(World):
    """A world that holds still after 5 s."""

    def at(self, t_s: float, exposure_s: float = 0.0) -> State:
        """Give its state."""
        return super().at(min(t_s, 5.0), exposure_s if t_s < 5 else 0.0)


@pytest.mark.nightly
def test_what_was_learned_is_known_when_the_camera_holds_still_again() -> None:
    found = []
    for defects in (PixelDefects(), PixelDefects(stuck=12)):
        world = Stops([Room()], HEAD, median_radiance=INDOORS)
        camera = SimulatedCamera(world, lenses.load("equirect"), SMALL_PX, pixels=defects)
        client, counts, _ = watched(camera, (5.0, 9.0))
        assert counts[1] == counts[0]
        found.append(len(client.estimates[-1].lights))
    assert found[0] == found[1]


class Hands(World):
    """A world in which a hand comes before the right half of the lens every 3 s, for 1.5 s."""

    def at(self, t_s: float, exposure_s: float = 0.0) -> State:
        """Give its state."""
        return replace(super().at(t_s, exposure_s), is_covered=t_s % 3 > 1.5)


@pytest.mark.nightly
def test_a_hand_shows_a_camera_that_holds_still_what_shines() -> None:
    defects = PixelDefects(stuck=24)
    places = defects.at(SMALL_PX, 1.0, lenses.load("equirect").response_table()).places
    well_behind = [place for place in places if 520 < place[0] < 920 and 80 < place[1] < 400]
    for some, expected in ((defects, len(well_behind)), (PixelDefects(), 0)):
        world = Hands([Room()], STILL, median_radiance=INDOORS)
        camera = SimulatedCamera(world, lenses.load("equirect"), SMALL_PX, pixels=some)
        _, counts, _ = watched(camera, (2.9, 14.0))
        assert counts[0] == 0
        assert expected <= counts[1] <= bool(expected) * 14
