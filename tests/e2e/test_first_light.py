"""docs/users/first_light.md: its Python, as it is printed, with a live daemon."""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest
from harness import Daemon
from lightprobe.cli import simulate
from lightprobe.imaging import image
from lightprobe.sim import scenes
from lightprobe.sim.room import Room
from matplotlib.image import imread

PAGE = (Path(__file__).resolve().parents[2] / "docs/users/first_light.md").read_text()


def test_the_sphere_is_lit_from_where_the_lamp_is(tmp_path, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.S)
    room = np.full((64, 128, 3), 0.2, np.float32)
    room[15:18, 94:98] = [400, 300, 200]  # 45° up, 90° to the right
    monkeypatch.chdir(tmp_path)
    image.write_pfm("room.pfm", room)
    with Daemon(f"--source=file:{tmp_path / 'room.pfm'}?rate=30") as probe:
        uri = f"unix:{probe.socket}"
        assert "tcp:127.0.0.1:7700" in code
        exec(compile(code.replace("tcp:127.0.0.1:7700", uri), "first_light.md", "exec"), {})
    assert "1 lamps" in capsys.readouterr().out
    sphere = imread(tmp_path / "sphere.png")[..., :3]
    row, column = np.unravel_index(np.argmax(sphere.sum(axis=-1)), (256, 256))
    assert column == pytest.approx(127.5 * (1 + np.sqrt(0.5)), abs=12)
    assert row == pytest.approx(127.5 * (1 - np.sqrt(0.5)), abs=12)
    assert sphere[row, column, 0] > 1.05 * sphere[row, column, 2]  # the lamp is warm
    assert sphere[200, 60].max() < 0.5 * sphere[row, column].min()  # what it does not reach
    assert not sphere[0, 0].any()


def test_the_page_s_simulated_probe_stands_in_one_room():
    """It was five made-up scenes in turn, some so even that the sphere was a flat disc."""
    assert "lightprobe simulate\n" in PAGE
    (scene,) = scenes.load(inspect.signature(simulate.command).parameters["scene"].default)
    assert isinstance(scene, Room)
    assert len(scene.lamps) == 4
