"""`lightprobe evaluate`: figures as a table, as JSON, as a plot."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from lightprobe.imaging import image
from lightprobe.sim.room import Room

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
LONG_S = 180


def run(*arguments):
    return subprocess.run(
        [LIGHTPROBE, "evaluate", *map(str, arguments)],
        capture_output=True, text=True, timeout=LONG_S,
    )  # fmt: skip


def test_every_figure_in_every_form(tmp_path):
    plot, figures = tmp_path / "plot.png", tmp_path / "figures.json"
    image.write_pfm(tmp_path / "map.pfm", Room().render(256, 128).compose([1, 1, 1, 1]))
    done = run(
        "--scenes", "procedural:2", "--scenes", tmp_path, "--brackets", "float,2",
        "--settings", "default", "--settings", "preset=fast,lights=1",
        "--plot", plot, "--json-file", figures, "--per-scene",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    for word in ("relighting MAE", "missed", "truth lies within the stated sigma", "procedural-1"):
        assert word in done.stdout
    report = json.loads(figures.read_text())
    assert len(report["cases"]) == 3 * 2 * 2
    assert {(s["settings"], s["input"]) for s in report["summary"]} == {
        (settings, name)
        for settings in ("default", "preset=fast,lights=1")
        for name in ("float", "2")
    }
    best = next(s for s in report["summary"] if (s["settings"], s["input"]) == ("default", "float"))
    assert best["scenes"] == 3
    assert best["missed"] == best["false"] == 0
    assert best["direction_rmse_deg"] < 0.5
    # A panorama file has no lamps that truth knows of; a setting of one light misses the second.
    maps = [case for case in report["cases"] if case["scene"] == "map"]
    assert all(case["score"]["matches"] == [] for case in maps)
    one = next(s for s in report["summary"] if s["settings"] != "default" and s["input"] == "float")
    assert one["missed"] == 1
    assert np.ptp(cv2.imread(str(plot))) > 200


@pytest.mark.nightly
def test_the_same_seed_gives_the_same_figures():
    runs = [run("--scenes", "procedural:1", "--brackets", "1", "--seed", 4, "--json") for _ in "ab"]
    assert runs[0].returncode == 0, runs[0].stderr
    assert json.loads(runs[0].stdout) == json.loads(runs[1].stdout)
    other = run("--scenes", "procedural:1", "--brackets", "1", "--seed", 5, "--json")
    assert json.loads(other.stdout) != json.loads(runs[0].stdout)


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (["--settings", "speed=9"], 2, "KEY one of camera, preset"),
        (["--settings", "lights=many"], 2, "whole number"),
        (["--brackets", "9"], 2, "expected float"),
        (["--scenes", "procedural:none"], 2, "procedural:N"),
        (["--scenes", "none.exr"], 1, "no such file"),
        (["--scenes", "procedural:1", "--settings", "preset=magic"], 2, "magic"),
    ],
)
def test_bad_options_say_what_to_do(options, code, message):
    done = run(*options)
    assert (done.returncode, message in done.stderr) == (code, True), done.stderr
    assert "Traceback" not in done.stderr


def test_maps_without_truth_are_refused(tmp_path):
    image.write_pfm(tmp_path / "square.pfm", np.ones((64, 64, 3), np.float32))
    assert "twice as wide" in run("--scenes", tmp_path / "square.pfm").stderr
    image.write_pfm(tmp_path / "nan.pfm", np.full((32, 64, 3), np.nan, np.float32))
    assert "no exact truth" in run("--scenes", tmp_path / "nan.pfm").stderr
    (tmp_path / "empty").mkdir()
    assert run("--scenes", tmp_path / "empty").returncode == 2
