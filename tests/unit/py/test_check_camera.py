"""`lightprobe check-camera`: simulated cameras by their pictures, without a daemon.

tests/accuracy/check_camera.py has the whole table; here is one row of each kind, and bad input.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from lightprobe.calibrate import camera_file
from lightprobe.check_camera import balance, edges, noise, pixels, tearing
from lightprobe.check_camera.answers import Answer, Outcome, Verdict
from lightprobe.cli import check_camera as cli
from lightprobe.errors import UsageError
from lightprobe.imaging import camera as cameras
from lightprobe.imaging.camera import CameraError
from lightprobe.sim.movers import Card
from lightprobe.sim.scene import has_exact_lamps
from lightprobe.sim.scenes import load
from lightprobe.sim.world import Behaviour, World

sys.path.append(str(Path(__file__).resolve().parents[2] / "accuracy"))
import check_camera as table


@pytest.mark.parametrize(
    "name",
    [
        "no defect", "tone mapping 1 EV", "response srgb:1.04", "sharpening 0.3",
        "noise reduction in time 0.4", "white balance adapts 0.6", "12 stuck pixels",
        "commands without effect", "a dark room", "exposure tears at 0.33",
        "lamps flicker at 100 Hz by 0.3, rows 0 µs apart",
        *(
            pytest.param(name, marks=pytest.mark.nightly)
            for name in (
                "tone mapping 0.5 EV to middle grey", "white balance drifts 0.06",
                "glare 0.03 and stuck pixels", "sharpening 0.7 and white balance drifts 0.06",
            )
        ),
    ],
)  # fmt: skip
def test_a_defect_is_named_and_no_other(name, tmp_path):
    case = table.CASES[name]
    found = table.verdict(case, tmp_path)
    assert table.wrong(case, found) == [], found.words


@pytest.mark.parametrize("rows", [3, 10, 37])
def test_where_a_picture_is_torn(rows):
    """The row in which it is torn may be of either, or between the two."""
    before, after = np.full((40, 80), 30.0, np.float32), np.full((40, 80), 90.0, np.float32)
    before[20, :], after[:, :30] = 90, 31  # a row and places that tell nothing
    for middle in (30, 60, 90):
        seen = after.copy()
        seen[:rows] = before[:rows]
        seen[rows] = np.where(after[rows] > 40, middle, 31)
        found = tearing.torn_share(before, after, seen)
        assert found == pytest.approx(rows / 40, abs=1.01 / 40)


def test_what_is_no_torn_picture():
    before, after = np.full((40, 80), 30.0, np.float32), np.full((40, 80), 90.0, np.float32)
    assert tearing.torn_share(before, after, before) is None  # it comes later
    assert tearing.torn_share(before, after, after) == 0
    assert tearing.torn_share(before, before + 5, before) is None  # nobody can tell
    assert tearing.torn_share(before, after, before + 45) == 0  # on its way, everywhere
    patches = np.where(np.arange(80) % 20 < 10, before, after)
    assert not tearing.torn_share(before, after, patches)
    below = after.copy()
    below[20:] = before[20:]
    assert not tearing.torn_share(before, after, below)


def answer(outcome, question="tone mapping"):
    return Answer(question, outcome, "something")


@pytest.mark.parametrize(
    ("outcomes", "words", "status"),
    [
        ((Outcome.FINE,), "fit", 0),
        ((Outcome.FINE, Outcome.DEFECT), "fit with something", 0),
        ((Outcome.UNKNOWN, Outcome.UNFIT), "unfit because of something", 1),
        ((Outcome.UNKNOWN,), "cannot tell whether it is fit", 3),
        ((Outcome.SKIPPED,), "cannot tell whether it is fit", 3),
        ((), "cannot tell whether it is fit", 3),
    ],
)
def test_a_verdict_sums_up_its_answers(outcomes, words, status):
    verdict = Verdict("here", tuple(answer(one) for one in outcomes))
    assert (verdict.words, verdict.status) == (words, status)


def test_a_picture_without_edges_tells_nothing_of_sharpening():
    assert edges.profile([np.full((64, 128), 100.0, np.float32)]) is None
    assert edges.judge(None).outcome is Outcome.UNKNOWN


def test_noise_that_is_rounded_away_tells_nothing():
    still = [np.full((64, 128, 3), 100, np.uint8)] * 4
    assert noise.kinship([still]) is None
    assert noise.judge(None).outcome is Outcome.UNKNOWN


def test_a_cover_that_leaks_tells_nothing():
    empty = np.empty((0, 2), np.intp)
    leaky = pixels.ShiningPixels(empty, empty, 80.0, 32768.0, np.full((8, 8), 80, np.float32))
    assert pixels.judge(leaky).outcome is Outcome.UNKNOWN
    assert pixels.judge(None).outcome is Outcome.UNKNOWN


def test_more_pixels_than_a_camera_file_takes_are_unfit():
    many = np.zeros((pixels.MOST + 1, 2), np.intp)
    shining = pixels.ShiningPixels(many, many[:0], 1.0, 32768.0, np.zeros((8, 8), np.float32))
    assert pixels.judge(shining).outcome is Outcome.UNFIT


def test_nothing_coloured_in_view_tells_nothing():
    same = balance.Adaption(shift=0.0, cast=0.0, covered=0.0, places=500)
    assert balance.judge_adaption(same).outcome is Outcome.UNKNOWN
    assert balance.judge_adaption(None).outcome is Outcome.UNKNOWN
    assert balance.judge_drift(None).outcome is Outcome.UNKNOWN


def test_light_that_changes_place_by_place_is_not_the_cameras():
    times = np.arange(0.0, 30.0)
    light = np.zeros((30, 20, 40, 3))
    light[:, :, :20, 0] = 0.4 * (times / 30)[:, None, None]  # one lamp grows red
    light[:, :, 20:, 0] = -0.4 * (times / 30)[:, None, None]
    light[..., 0] += 0.02 * (times / 30)[:, None, None]
    found = balance.drift(balance.Colours(light, times, np.ones((30, 3))))
    assert balance.judge_drift(found).outcome is Outcome.UNKNOWN


def test_stuck_pixels_are_written_beside_the_camera_file(tmp_path):
    path, places = tmp_path / "my.camera", np.array([[3, 4], [630, 310]])
    first = camera_file.save_stuck(path, (640, 320), places)
    assert np.array_equal(cameras.load(str(path)).stuck_px, places)
    second = camera_file.save_stuck(path, (640, 320), places[:1])
    assert first.exists()
    assert second != first
    with pytest.raises(CameraError, match="640x320"):
        camera_file.save_stuck(path, (1280, 640), places)


def test_a_camera_file_without_a_size_gets_that_of_its_stuck_pixels(tmp_path):
    path = tmp_path / "my.camera"
    path.write_text("[camera]\nprojection = equirect\n")
    camera_file.save_stuck(path, (640, 320), np.array([[3, 4]]))
    assert cameras.load(str(path)).width_px == 640


@pytest.mark.parametrize("skip", ["turn", "scene,,colours", "Cover"])
def test_unknown_steps_are_refused(skip):
    with pytest.raises(UsageError, match="--skip"):
        cli._steps(skip)


def test_a_card_hides_what_is_behind_it_and_the_truth_knows():
    world = World(load(["room"]), Behaviour(act_s=0))
    lamp = world.scenes[0].lamps[0]
    assert has_exact_lamps(world.scenes[0])
    x, y, z = lamp.direction
    azimuth, elevation = np.degrees([np.arctan2(x, -z), np.arcsin(y)])
    before = world.at(0).truth().irradiance([lamp.direction])
    world.card = Card(float(azimuth), float(elevation), 8.0)
    behind = world.at(0).truth()
    assert len(behind.lamps) == len(world.scenes[0].lamps) - 1
    lost = before - behind.irradiance([lamp.direction])
    assert np.all(lost >= 0.99 * lamp.irradiance)
    world.card = Card(0, 0, 180)
    assert np.abs(world.at(0).truth().irradiance([[0, 1, 0]])).max() < 1e-3 * before.max()
