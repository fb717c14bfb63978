"""Pixels of the simulated sensor that are stuck, warm or dead."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from lightprobe.errors import UsageError
from lightprobe.imaging import camera as lenses
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.pixel_defects import PixelDefects
from lightprobe.sim.processing import Processing
from lightprobe.sim.room import Room
from lightprobe.sim.sensor import SensorModel
from lightprobe.sim.world import Behaviour, World

SIZE = (128, 64)


def camera(defects=None, behaviour=None, **more):
    world = World([Room()], behaviour or Behaviour(act_s=0), median_radiance=4.0)
    return SimulatedCamera(world, lenses.equirect(), SIZE, pixels=defects, **more)


def codes(simulated, number=0, exposure_us=1000.0):
    data = np.frombuffer(simulated.frame(number, Shot(exposure_us)), np.uint8)
    return cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def spoilt(defects, exposure_us=1000.0, t_s=0.0, grey=40):
    """A grey frame with the defects, and their places."""
    placed = defects.at(SIZE, 12000.0, lenses.equirect().response_table())
    frame = np.full((SIZE[1], SIZE[0], 3), grey, np.uint8)
    return placed.spoil(frame, exposure_us, t_s), placed.places


@pytest.mark.parametrize("more", [{}, {"kept": 3}, {"row_time_us": 30.0}])
def test_without_any_the_bytes_are_the_same(more):
    behaviour = Behaviour(act_s=0, turn_deg_s=20)
    without, none = (camera(one, behaviour, **more) for one in (None, PixelDefects()))
    for number in range(4):
        assert without.frame(number, Shot(500)) == none.frame(number, Shot(500))


def test_stuck_pixels_are_at_full_scale_in_every_exposure_and_nothing_else_changes():
    for exposure_us in (100.0, 30000.0):
        frame, places = spoilt(PixelDefects(stuck=5), exposure_us)
        assert (frame[places[:, 1], places[:, 0]] == 255).all()
        assert np.count_nonzero((frame != 40).any(-1)) == 5


def test_dead_ones_are_black():
    frame, places = spoilt(PixelDefects(dead=5))
    assert (frame[places[:, 1], places[:, 0]] == 0).all()


def test_warm_ones_grow_with_exposure_and_temperature():
    """Half a well in 10 ms at 25 °C, all of it 6 K above."""
    table = lenses.equirect().response_table()
    defects = PixelDefects(warm=1, warm_e_per_s=600_000.0)
    for exposure_us, celsius, share in ((1e4, 25, 0.5), (1e3, 25, 0.05), (1e3, 31, 0.1)):
        frame, ((x, y),) = spoilt(replace(defects, celsius=celsius), exposure_us, grey=0)
        assert table[frame[y, x, 1], 1] == pytest.approx(share, rel=0.02)


def test_one_colour_is_spread_by_demosaicing():
    frame, places = spoilt(PixelDefects(stuck=40, bayer=1), grey=0)
    for x, y in places:
        if 1 <= x < SIZE[0] - 1 and 1 <= y < SIZE[1] - 1:
            colour = x % 2 + y % 2
            assert frame[y, x, colour] == 255
            assert 0 < frame[y, x + 1, colour] <= 255
    assert np.count_nonzero(frame.sum(-1) > 0) > 5 * 30


def test_a_row_may_be_stuck():
    frame, _ = spoilt(PixelDefects(row=9))
    assert (frame[9] == 255).all()
    assert (np.delete(frame, 9, axis=0) == 40).all()


def test_they_come_and_go():
    defects = PixelDefects(stuck=3, from_s=1.0, to_s=2.0)
    for t_s, there in ((0.5, False), (1.5, True), (2.5, False)):
        assert (spoilt(defects, t_s=t_s)[0] != 40).any() == there


def test_they_stay_where_they_are_while_the_picture_turns():
    """In pictures that go through the whole camera; a JPEG spreads them a little."""
    behaviour = Behaviour(act_s=0, turn_deg_s=60)
    for more in ({}, {"model": SensorModel(read_noise_e=1.0)}, {"row_time_us": 50.0}):
        simulated = camera(
            PixelDefects(stuck=4, seed=3), behaviour, quality=100, chroma="444", **more
        )
        places = PixelDefects(stuck=4, seed=3).at(SIZE, 1.0, np.zeros((256, 3))).places
        for number in (0, 20):
            frame = codes(simulated, number, 100.0)
            assert (frame[places[:, 1], places[:, 0]] > 200).all()


def test_a_picture_that_is_repeated_is_not_one_without_them():
    simulated = camera(PixelDefects(stuck=4, from_s=0.2), kept=2)
    first, later = (codes(simulated, number, 100.0) for number in (0, 10))
    assert (later.astype(int) - first > 100).any()


@pytest.mark.parametrize(
    ("processing", "least", "beside"),
    [("sharpen=0.7", 250, -10), ("tone_ev=1", 250, 0), ("saturation=0.6", 250, 0)],
)
def test_a_camera_that_processes_processes_them_too(processing, least, beside):
    """Sharpening darkens what is beside a white pixel; they come and go as without it."""
    more = {"quality": 100, "chroma": "444", "processing": Processing().merged(processing)}
    defects = PixelDefects(stuck=4, seed=3, from_s=0.2)
    places = defects.at(SIZE, 1.0, np.zeros((256, 3))).places
    with_them, without = (camera(one, **more) for one in (defects, None))
    assert with_them.frame(0, Shot(3000.0)) == without.frame(0, Shot(3000.0))
    frame, clean = (codes(one, 20, 3000.0).astype(int) for one in (with_them, without))
    x, y = places.T
    assert frame[y, x].min() >= least
    assert (frame[y, x + 1] - clean[y, x + 1]).min() <= beside


def test_processing_that_is_not_on_yet_leaves_them_as_they_are():
    later = Processing().merged("sharpen=0.7&from_s=9")
    some = [camera(PixelDefects(stuck=4), processing=one) for one in (later, None)]
    assert some[0].frame(3, Shot(300.0)) == some[1].frame(3, Shot(300.0))


@pytest.mark.parametrize(
    "text", ["hot=3", "stuck=-1", "stuck=1.5", "stuck=many", "bayer=2", "warm="]
)
def test_what_is_no_defect_is_refused(text):
    with pytest.raises(UsageError, match="pixel defects"):
        PixelDefects().merged(text)


def test_words_are_understood():
    assert PixelDefects().merged("stuck=12&warm_e_per_s=2e4&bayer=1") == PixelDefects(
        stuck=12, warm_e_per_s=2e4, bayer=1
    )
    assert not PixelDefects().merged("")
