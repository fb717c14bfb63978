"""The figures of `make accuracy` about turning cameras are what their names say."""

import itertools
from dataclasses import replace

import judge
import live
import numpy as np
import pytest
import recording
from defects import DEFECTS, defect_rows
from defects import HEAD as DEFECTS_HEAD
from judge import Coverage, Light, Packet
from kinds import KINDS
from lightprobe import geometry, sh
from lightprobe.colour import luminance
from lightprobe.estimate import Estimate, EstimateFlag, LightFlag, SphericalHarmonics
from lightprobe.estimate import Light as Listed
from lightprobe.evaluate.metrics import stated_error
from lightprobe.imaging import camera as lenses
from lightprobe.sim import scenes
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.motion import turned, way_deg
from lightprobe.sim.pixel_defects import PixelDefects
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.room import Room
from lightprobe.sim.scene import PanoramaScene
from lightprobe.sim.world import Behaviour, World
from numpy.typing import ArrayLike
from recording import EXPOSURES, INDOORS, SUBSCRIPTIONS

pytestmark = pytest.mark.many_frames
SCENE = random_scene(3)
LIGHT = Light.of(SCENE)
LAMPS = LIGHT.lamps
SMALL_PX = (480, 240)


def estimate(rotation: ArrayLike, *, flags: int = 0, gain: float = 1.0) -> Estimate:
    """A perfect one of the scene, turned; or too bright by a factor."""
    truth = SCENE.truth(np.ones(len(SCENE.lamps)), rotation)
    ambient = gain * truth.total.copy()
    lights = []
    for k, lamp in enumerate(truth.lamps):
        power = gain * lamp.irradiance
        lights.append(
            Listed(k, lamp.direction, power, lamp.radius_deg, 0.01, 0.02 * lamp.irradiance)
        )
        ambient -= sh.lamp(lamp.direction, sh.order_of(ambient))[:, None] * power
    harmonics = SphericalHarmonics("AMBIENT", sh.order_of(ambient), ambient)
    lit = tuple(lights)
    return Estimate(1, 2, 3, 4, 500, EstimateFlag(flags), lit, harmonics, 0.01, None, 1, None)


def packet(yaw_deg: float = 0, nod_deg: float = 0, roll_deg: float = 0, **changes) -> Packet:
    rotation = turned(yaw_deg, nod_deg, roll_deg)
    return Packet(estimate(rotation, **changes), rotation)


def judged(packets, seconds=4, light=LIGHT) -> judge.Figures:
    return judge.judge(lambda _: light, packets, seconds)


def test_perfect_estimates_are_judged_so_however_the_camera_is_turned() -> None:
    good = [packet(0, 0, 0), packet(77, -50, 20), packet(200, 15, -130)]
    found = judged(good)
    assert found.error_median < 0.01
    assert found.wrong_and_healthy == found.births_per_s == 0
    assert found.healthy == 1
    assert found.ambient_step < 1e-6
    assert found.packets_per_s == 0.75
    assert found.direction == found.irradiance == Coverage(3 * len(LAMPS), 1, 1)
    assert found.relighting.within_3 == 1
    late = [replace(one, rotation=geometry.turn_after(turned(-60), one.rotation)) for one in good]
    assert judged(late).error_median > 0.05
    assert judge.ambient_step([good[0], replace(good[0], rotation=turned(90))], 1) > 0


def test_wrong_is_told_from_wrong_and_flagged() -> None:
    more_lights, clipped = EstimateFlag.MORE_LIGHTS, EstimateFlag.CLIPPED
    bad = [packet(gain=1.5, flags=flags) for flags in (0, more_lights, clipped, clipped)]
    found = judged(bad)
    assert found.wrong_and_healthy == found.healthy == 0.5
    assert found.flags == {"MORE_LIGHTS": 0.25, "CLIPPED": 0.5}
    assert found.relighting.within_3 == 0


def test_a_stated_sigma_counts_as_a_statement() -> None:
    one = packet(gain=1.5)
    assert stated_error(one.estimate) == 0.01
    one = replace(one, estimate=replace(one.estimate, relighting_sigma=0.7))
    assert stated_error(one.estimate) == pytest.approx(np.hypot(0.01, 0.7))
    found = judged([one])
    assert found.wrong_and_healthy == 0
    assert found.relighting.within_1 == 1


def test_births_and_steps_are_of_one_packet_to_the_next() -> None:
    one = packet()
    lights = tuple(replace(light, id=9 + light.id) for light in one.estimate.lights)
    gone = replace(one, estimate=replace(one.estimate, lights=lights))
    assert judge.births([one, one, gone, gone]) == len(lights)
    mean = float(np.mean(LIGHT.irradiance @ [0.2126, 0.7152, 0.0722]))
    assert judge.ambient_step([one, packet(gain=1.2)], mean) > 0.05
    assert judge.ambient_step([one, one], mean) == 0


def test_sigmas_are_judged_lamp_by_lamp() -> None:
    off = packet()
    first, *others = off.estimate.lights
    turn = geometry.rotation_matrix(
        geometry.quaternion(np.cross(first.direction, others[0].direction), 0.025)
    )
    first = replace(first, direction=turn @ first.direction, irradiance=1.05 * first.irradiance)
    off = replace(off, estimate=replace(off.estimate, lights=(first, *others)))
    found = judged([off])
    assert found.direction.within_1 == found.irradiance.within_1 == 1 - 1 / len(LAMPS)
    assert found.direction.within_3 == found.irradiance.within_3 == 1


def test_a_sun_must_be_listed() -> None:
    sun = max(LAMPS, key=lambda lamp: lamp.irradiance.sum())
    light = replace(LIGHT, sun=sun)
    one = packet(50)
    rest = tuple(
        light for light in one.estimate.lights if light.direction @ one.turn @ sun.direction < 0.99
    )
    without = replace(one, estimate=replace(one.estimate, lights=rest))
    assert judged([one, without], light=light).sun_listed == 0.5
    weak = [replace(light, irradiance=0.01 * light.irradiance) for light in one.estimate.lights]
    clipped = [replace(light, flags=LightFlag.CLIPPED) for light in weak]
    for lights, share in ((weak, 0), (clipped, 1)):
        seen = replace(one, estimate=replace(one.estimate, lights=tuple(lights)))
        assert judged([seen], light=light).sun_listed == share
        with_ring = judge.judge(lambda _: light, [seen], 1, bounds_count=False)
        assert with_ring.sun_listed == 0
    assert judged([one], light=replace(light, sun=None)).sun_listed is None


def test_lamps_of_panoramas_are_no_truth() -> None:
    room = Room()
    drawn = room.render(512, 256).compose(np.ones(len(room.lamps)))
    assert Light.of(room).lamps
    assert Light.of(PanoramaScene.of("drawn", drawn)).lamps is None


def test_the_map_of_a_small_camera_holds_while_a_head_moves() -> None:
    """Its blocks are coarser than the map's cells: their quarters are not."""
    _, scene = scenes.load(["procedural:2"])
    run = live.case(scene, "head", "reported", size_px=(960, 480))
    found = {one.subscription: one.figures for one in live.judged(run)}
    for figures in found.values():
        assert figures.ambient_step < 0.005
        assert figures.births_per_s == 0
        assert figures.error_median < 0.012
        assert figures.flags.get("BRACKET_INCOMPLETE", 0) < 0.3


@pytest.mark.nightly_rows
@pytest.mark.parametrize("exposures", ["reported", "unreported"])
@pytest.mark.parametrize("motion", ["head", "100", "swing", "look", "tilted"])
def test_a_turning_camera_is_nearly_as_right_as_a_still_one(motion: str, exposures: str) -> None:
    still = live.judged(live.case(SCENE, "0", exposures, size_px=SMALL_PX))
    turning = live.judged(live.case(SCENE, motion, exposures, size_px=SMALL_PX))
    for before, after in zip(still, turning, strict=True):
        assert after.figures.packets > 100
        assert after.figures.error_median < before.figures.error_median + 0.02
        assert after.figures.wrong_and_healthy == 0
        assert after.figures.flags.get("MOTION", 0) < 0.1
        assert after.figures.births_per_s <= 1
        assert after.figures.ambient_step < 0.03


def test_lamps_are_where_they_are_while_the_camera_turns() -> None:
    """Walls say too little of how the camera turned in a bare room: the lamps must.

    Simulated pictures turn by whole pixels, which no camera that turns steadily does: small ones
    would say little.
    """
    seen = recording.record(live.case(SCENE, "30", "reported", size_px=(960, 480)).run)
    towards = np.stack([lamp.direction for lamp in LAMPS])
    errors = [
        np.degrees(np.arccos(min(1.0, (towards @ packet.turn.T @ light.direction).max())))
        for packet in seen.packets["raw"]
        for light in packet.estimate.lights
    ]
    assert len(errors) > 300
    assert np.percentile(errors, 90) < 0.3


@pytest.mark.nightly_rows
@pytest.mark.parametrize("exposures", ["reported", "unreported"])
@pytest.mark.parametrize("row_time_us", [0.0, 30.0])
def test_directions_are_of_the_time_that_packets_state(row_time_us: float, exposures: str) -> None:
    """Whether frames tell their exposures or not, and when each of their rows was exposed."""
    size_px = (960, 480)
    more = {"size_px": size_px, "row_time_us": 960 / size_px[0] * 2 * row_time_us, "judged_s": 2.0}
    case = live.case(Room(), "100", exposures, **more)
    raw = next(one for one in live.judged(case) if one.subscription == "raw")
    assert raw.figures.packets > 50
    assert raw.figures.direction.within_3 is not None
    assert raw.figures.direction.within_3 > 0.97
    assert raw.figures.error_median < 0.01


@pytest.mark.nightly_rows
@pytest.mark.parametrize("motion", ["30", "100"])
def test_a_lamp_overhead_keeps_its_strength_while_the_camera_turns(motion: str) -> None:
    """Near the picture's poles a lamp is behind many narrow cells, and none of them is missed."""
    case = live.case(random_scene(2), motion, "reported", judged_s=1, orientation="sim")
    recorded = recording.record(case.run)
    (above,) = [
        one for one in Light.of(recorded.world.at(0).scene).lamps if one.direction[1] > 0.99
    ]
    assert len(recorded.packets["raw"]) > 20
    for one in recorded.packets["raw"]:
        (found,) = [light for light in one.estimate.lights if light.direction[1] > 0.99]
        assert luminance(found.irradiance) == pytest.approx(luminance(above.irradiance), rel=0.03)


def test_the_ring_takes_a_turn_for_no_step_and_keeps_the_sun() -> None:
    """A sun that grazes sensors from one moment to the next, and glows into an area light."""
    (sunrise,) = (one for one in scenes.load(["blender"]) if "sunrise" in one.name)
    for one in live.judged(live.case(sunrise, "100", "reported", ring=True)):
        assert one.figures.packets > 100
        assert one.figures.error_p90 < 0.05
        assert one.figures.ambient_step < 0.02
        assert one.figures.sun_listed == 1


def test_without_orientation_a_turning_camera_is_flagged() -> None:
    blind = ("--orientation=none",)
    case = live.case(SCENE, "300", "reported", size_px=SMALL_PX, daemon_arguments=blind)
    found = [one.figures for one in live.judged(case)]
    assert max(figures.error_p90 for figures in found) > 0.05  # otherwise nothing is tested
    assert all(figures.wrong_and_healthy == 0 for figures in found)


def test_a_still_room_is_right_all_the_time() -> None:
    for one in live.judged(live.case(SCENE, "0", "reported", size_px=SMALL_PX)):
        assert one.figures.packets > 100
        assert one.figures.error_p90 < 0.1
        assert one.figures.wrong_and_healthy == one.figures.births_per_s == 0
        assert set(one.figures.flags) <= {"CLIPPED", "MORE_LIGHTS"}


def test_motions_are_as_their_words_say() -> None:
    def angles(motion: str, times_s: list[float]) -> list[tuple[float, float, float]]:
        world = World([SCENE], live.MOTIONS[motion])
        return [world.at(t_s).angles_deg for t_s in times_s]

    yaw, nod, roll = np.array(angles("head", list(np.arange(0, 100, 0.01)))).T
    assert [np.abs(one).max() for one in (yaw, nod, roll)] == pytest.approx([40, 15, 8], rel=1e-3)
    looks = angles("look", [0, 1, 1.5, 2, 4, 4.5, 5, 7])
    assert [one[0] for one in looks] == pytest.approx([0, 0, 45, 90, 90, 45, 0, 0], abs=1e-6)
    tilted = World([SCENE], live.MOTIONS["tilted"])
    turns = [tilted.rotation(t_s + np.array([0, 0.1])) for t_s in (0.0, 0.97, 70.35)]
    axes = [geometry.turn_after(b, geometry.inverse(a))[1:] for a, b in turns]
    assert [way_deg(turn) for turn in turns] == pytest.approx([6, 6, 6])
    assert np.abs(geometry.normalize(axes) @ [0.36, 0.8, 0.48]) == pytest.approx([1, 1, 1])
    assert geometry.angle_deg([0.36, 0.8, 0.48], [0, 1, 0]) > 30


def test_errors_are_compared_with_those_of_the_same_scene_still() -> None:
    def of(scene: str, motion: str, error: float) -> live.Live:
        return live.Live(
            scene, motion, "reported", "raw", replace(judged([packet()]), error_median=error)
        )

    found = [of("a", "0", 0.1), of("a", "30", 0.15), of("b", "0", 0.3), of("b", "30", 0.31)]
    assert [row[5] for row in live.rows(found)] == ["–", "0.050"]
    assert live.rows(found[1:2])[0][5] == "–"


def test_a_scene_without_packets_shows_in_the_table() -> None:
    lives = [
        live.Live(scene, "0", "reported", "raw", judged(packets))
        for scene, packets in (("a", [packet(), packet()]), ("b", []))
    ]
    (row,) = live.rows(lives)
    assert row[3] == "0"
    assert "nan" not in " ".join(row)
    assert len(live.coverage_rows(lives)) == 1
    (alone,) = live.rows(lives[1:])
    assert alone[3] == "0"


@pytest.mark.parametrize("name", list(KINDS))
def test_each_kind_of_camera_is_what_its_words_say(name: str) -> None:
    run = recording.Run(SCENE, size_px=SMALL_PX, cameras=name, pixels=PixelDefects(stuck=3))
    found = recording.cameras(run, World([SCENE], run.behaviour))
    sizes = {"{}×{}".format(*camera.size_px) for camera in found}
    assert sizes == {KINDS[name].words.rpartition(" ")[2] or "480×240"}
    assert len(found) == max(len(run.kind.daemon_arguments), 1)
    assert len(found) == (2 if "modules" in name else 1)
    assert len({(camera.phase_s, camera.sensor.seed) for camera in found}) == len(found)
    looks = [camera.lens.look(*camera.size_px)[0].reshape(-1, 3) for camera in found]
    seen = np.concatenate([look[np.isfinite(look[:, 0])] for look in looks])
    assert all((seen @ axis).max() > 0.99 for axis in np.vstack([np.eye(3), -np.eye(3)]))


def test_cameras_with_lenses_have_rows_of_their_own() -> None:
    still = [
        live.Live("room", "0", "reported", name, judged([packet()]), cameras=cameras)
        for cameras in KINDS
        for name in SUBSCRIPTIONS
    ]
    found = [replace(one, motion="head") for one in still if one.cameras == "dual-fisheye"]
    rows = [row for row in live.rows([*found, *still]) if row[1] == "raw"]
    words = KINDS["dual-fisheye"].words
    assert [row[2].endswith(f"; {words}") for row in rows] == [False, True, True, False, False]
    assert [row[5] for row in rows] == ["–", "–", "0.000", "–", "–"]
    assert defect_rows(found)[0][0] == f"{words}; no defect"
    assert len(live.readme_rows([*found, *still])) == 1
    todo = {(one.run.cameras, one.motion) for one in live.lens_cases()}
    assert todo == set(itertools.product(live.LENS_KINDS, live.LENS_RATES))


@pytest.mark.nightly
def test_a_dual_fisheye_holds_while_a_head_moves() -> None:
    for one in live.judged(live.case(Room(), "head", "reported", cameras="dual-fisheye")):
        figures = one.figures
        assert figures.error_median < 0.01
        assert figures.ambient_step < 0.01
        assert figures.births_per_s == figures.wrong_and_healthy == 0
        assert figures.relighting.within_3 == 1


def test_troubles_are_told_by_name() -> None:
    for trouble, (words, _, _) in live.TROUBLES.items():
        (one, *_) = live.cases(["room"], [trouble], ["reported"])
        assert one.motion == trouble
        assert (
            words
            in live.rows([live.Live("room", trouble, "reported", "raw", judged([packet()]))])[0]
        )
    assert live.cases(["procedural:1"], ["walk"]) == []
    both = live.case(Room(), "ignored", "reported", faults="drop=0.5").run.faults
    assert both == "ignore_exposure=1&drop=0.5"


@pytest.fixture(scope="module")
def plain_pictures() -> list[bytes]:
    return pictures("none")


def pictures(defects: str) -> list[bytes]:
    """Of a run's camera, exposed in turns."""
    scene = World([Room()], median_radiance=INDOORS).scenes[0]
    run = recording.Run(scene, size_px=(960, 480), defects=defects)
    (camera,) = recording.cameras(run, World([scene], run.behaviour))
    return [camera.frame(n, Shot(33000.0 if n % 2 else 8000.0)) for n in range(3)]


@pytest.mark.parametrize("name", [name for name in DEFECTS if name != "none"])
def test_each_defect_shows_in_the_pictures_of_its_run(
    name: str, plain_pictures: list[bytes]
) -> None:
    assert pictures(name)[1:] != plain_pictures[1:]


def test_defects_are_told_in_one_table() -> None:
    more = {"size_px": SMALL_PX, "judged_s": 1.0}
    found = [
        figures
        for name in ("tone-curve", "none")
        for case in live.cases(["room"], ["0"], ["reported"], defects=name, **more)
        for figures in live.judged(case)
    ]
    plain, toned = defect_rows(found)
    assert plain[:3] == ["no defect", "room", "0"]
    assert toned[0] == DEFECTS["tone-curve"].words
    assert float(toned[3]) > float(plain[3]) + 0.02
    assert len(plain) == len(toned) == len(DEFECTS_HEAD)


@pytest.mark.nightly
def test_who_walks_is_judged_by_the_light_where_they_are() -> None:
    walk = live.case(Room(), "walk", "reported", judged_s=1.0)
    walk = replace(walk, run=replace(walk.run, size_px=SMALL_PX))
    for one in live.judged(walk):
        assert one.figures.packets == pytest.approx(30, abs=3)
        assert one.figures.error_median < 0.03  # 0.08 by the light at the start


@pytest.mark.nightly_rows
@pytest.mark.parametrize("turn_deg_s", [0, 30])
@pytest.mark.parametrize("exposures", ["reported", "unreported"])
def test_a_hand_before_the_lens_is_told_and_takes_no_light_away(
    exposures: str, turn_deg_s: float
) -> None:
    covered = live.case(Room(), "covered", exposures)
    behaviour = replace(covered.run.behaviour, turn_deg_s=turn_deg_s)
    run = replace(covered.run, behaviour=behaviour, size_px=SMALL_PX)
    for one in live.judged(replace(covered, run=run)):
        assert one.figures.packets > 100
        assert one.figures.wrong_and_healthy == 0
        assert one.figures.error_p90 < 0.06
        assert one.figures.relighting.within_3 > 0.95
        assert one.figures.flags["COVERED"] == pytest.approx(0.5, abs=0.06)  # 2 of 4 s


@pytest.mark.parametrize("exposures", ["reported", "unreported"])
def test_a_room_that_goes_dark_is_not_covered(exposures: str) -> None:
    lit = World([Room()], median_radiance=INDOORS).scenes[0]
    world = World([lit, lit.scaled(0.02)], Behaviour(act_s=4))
    camera = SimulatedCamera(world, lenses.load("equirect"), SMALL_PX)
    with LiveProbe(camera, faults=EXPOSURES[exposures]) as probe:
        client = probe.client(SUBSCRIPTIONS["raw"])
        probe.run(7)
    assert all(EstimateFlag.COVERED not in one.flags for one in client.estimates)
    truth = Light.of(world.scenes[1])
    dark = [
        Packet(one, geometry.UNTURNED) for one in client.estimates if probe.captured_s(one) > 4.2
    ]
    found = judge.judge(lambda _: truth, dark, 1)
    assert found.wrong_and_healthy == 0
    if exposures == "reported":
        assert found.error_p90 < 0.1
