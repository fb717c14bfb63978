"""Delay and obedience of cameras, from series written by the test."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe.calibrate.exposure_response import ExposureResponseError, judge_commands
from lightprobe.calibrate.exposure_series import SeriesError, load

SIZE = (64, 32)
SCHEDULE_US = (100, 400, 1600, 6400, 3200, 800, 200)
SCENE = np.linspace(2, 40, SIZE[0] * SIZE[1]).reshape(SIZE[1], SIZE[0])


def write_series(folder, delay, *, frames=12, scene=SCENE, lost=(), ignores=False, fades=0):
    """A camera that obeys so many frames late: a frame begins right after each command."""
    folder.mkdir()
    rng = np.random.default_rng(0)
    rows = [{"lightprobe_series": 1, "source": "test", "exposure_settable": True,
             "reports_exposure": False, "exposure_min_us": None, "exposure_max_us": None,
             "exposure_step_us": 0}]  # fmt: skip
    in_force = np.full(delay + 1, 1000.0)
    smooth = 1000.0
    for number in range(len(SCHEDULE_US) * frames):
        step, commanded = number // frames, SCHEDULE_US[number // frames]
        in_force = np.append(in_force, 1000.0 if ignores else float(commanded))[1:]
        smooth += (in_force[0] - smooth) / (1 + fades)
        light = scene * smooth / 6400
        picture = 255 * np.sqrt(np.clip(light / 40, 0, 1)) + rng.normal(0, 0.7, scene.shape)
        if number in lost:
            continue
        name = f"{number:05}.grey"
        (folder / name).write_bytes(np.clip(np.rint(picture), 0, 255).astype(np.uint8).tobytes())
        rows.append({"file": name, "format": "GREY", "width_px": SIZE[0], "height_px": SIZE[1],
                     "stride_bytes": 0, "sequence": number, "t_read_ns": 1000 * number,
                     "t_arrival_ns": 0, "corrupt": False, "step": step,
                     "t_command_ns": 1000 * step * frames - 1, "commanded_us": commanded,
                     "exposure_us": None, "gain": None})  # fmt: skip
    rows.append({"frames": len(rows) - 1, "complete": True})
    (folder / "index.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return load(folder)


@settings(max_examples=10)
@given(st.integers(0, 6))
def test_any_delay_is_found(tmp_path_factory, delay):
    series = write_series(tmp_path_factory.mktemp("series") / "s", delay)
    obedience = judge_commands(series.steps())
    assert obedience.follows
    assert obedience.delay_frames == delay
    assert set(obedience.delays()) == {delay}
    assert not obedience.gradual


def test_frames_lost_around_a_change_do_not_count(tmp_path):
    series = write_series(tmp_path / "s", 2, lost={12 + 2, 36 + 1, 48 + 2})
    obedience = judge_commands(series.steps())
    assert set(obedience.delays()) == {2}
    assert len(obedience.delays()) == 3
    assert obedience.follows


def test_a_camera_that_ignores_commands(tmp_path):
    obedience = judge_commands(write_series(tmp_path / "s", 0, ignores=True).steps())
    assert obedience.ignores
    assert not obedience.follows
    assert obedience.expected == 6


def test_a_camera_that_fades(tmp_path):
    assert judge_commands(write_series(tmp_path / "s", 1, fades=1).steps()).gradual


def test_darkness_says_nothing(tmp_path):
    series = write_series(tmp_path / "s", 1, scene=SCENE * 1e-4)
    with pytest.raises(ExposureResponseError, match="too dark"):
        judge_commands(series.steps())


def test_glare_says_nothing(tmp_path):
    series = write_series(tmp_path / "s", 1, scene=SCENE * 1e6)
    with pytest.raises(ExposureResponseError, match="too bright"):
        judge_commands(series.steps())


def test_what_is_no_whole_series_is_refused(tmp_path):
    with pytest.raises(SeriesError, match="read"):
        load(tmp_path)
    write_series(tmp_path / "s", 0)
    index = tmp_path / "s" / "index.jsonl"
    whole = index.read_text()
    index.write_text(whole.replace('"complete": true', '"complete": false'))
    with pytest.raises(SeriesError, match="incomplete"):
        load(tmp_path / "s")
    index.write_text(whole[: len(whole) // 2])
    with pytest.raises(SeriesError, match="parse"):
        load(tmp_path / "s")
    index.write_text(whole.replace('"lightprobe_series": 1', '"lightprobe_series": 2'))
    with pytest.raises(SeriesError, match="version"):
        load(tmp_path / "s")
    index.write_text(whole.replace('"sequence"', '"number"'))
    with pytest.raises(SeriesError, match="sequence"):
        load(tmp_path / "s")
