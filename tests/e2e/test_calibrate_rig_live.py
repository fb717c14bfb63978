"""`lightprobe calibrate rig` as it is called, with two cameras that are live."""

from __future__ import annotations

import json
import re
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from harness import BUILD, run
from lightprobe.geometry import Array
from lightprobe.imaging import camera as lenses
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.clock import SystemClock
from lightprobe.sim.link import Exposure, Link
from lightprobe.sim.world import Behaviour, World
from numpy.typing import ArrayLike
from test_calibrate_rig import FILES, NAMES, WRONG, Rotation, mounted

pytestmark = pytest.mark.many_frames

PROGRAM = BUILD / "venv" / "bin" / "lightprobe"
#: Slow, for a machine that is busy: 2° from frame to frame.
TURNING = Behaviour(act_s=0, swing_deg=40, swing_hz=0.1, nod_deg=20, nod_hz=0.13)


class Held(World):
    """A world that stands still until it is let go, for all cameras at once."""

    turned_from_s = float("inf")

    def rotation(self, t_s: ArrayLike) -> Array:
        return super().rotation(np.maximum(np.asarray(t_s) - self.turned_from_s, 0.0))


@pytest.fixture
def box(tmp_path) -> Iterator[tuple[Held, SystemClock, int, list[Link]]]:
    """Two modules in one world, each served by a thread."""
    world, clock = Held(scenes.load(["room"]), TURNING, 4.0), SystemClock()
    links = []
    for number, file in enumerate(FILES):
        lens = mounted(file, WRONG if number else Rotation.identity())
        camera = SimulatedCamera(world, lens, (260, 260), rate_hz=10, seed=number)
        exposure = Exposure(camera, delay_frames=1)
        links.append(Link(tmp_path / f"{number}.sock", camera, exposure, clock=clock))
        (tmp_path / NAMES[number]).write_text(file.read_text())
    begin_ns = clock.now_ns()
    for link in links:
        link._start_ns = begin_ns  # the world began for both
    threads = [threading.Thread(target=link.serve, daemon=True) for link in links]
    for thread in threads:
        thread.start()
    yield world, clock, begin_ns, links
    for link in links:
        link.stop()
    for thread in threads:
        thread.join(20)


def calibrate(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    sources = [
        word
        for number, name in enumerate(NAMES)
        for word in (
            "--source",
            f"sim:{folder}/{number}.sock",
            "--camera",
            str(folder / name),
        )
    ]
    return subprocess.Popen(
        [PROGRAM, "calibrate", "rig", *sources, *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def calibrated(box, folder: Path) -> tuple[int, str, str]:
    """Status and output of the command, while the box is turned when it asks for it."""
    world, clock, begin_ns, _ = box
    world.turned_from_s = float("inf")
    process = calibrate(folder, "--seconds", "20", "--patience-s", "120", "--json")
    assert process.stderr is not None
    said = ""
    for line in process.stderr:
        said += line
        if "now turn the box" in line:
            world.turned_from_s = (clock.now_ns() - begin_ns) / 1e9
            break
    out, rest = process.communicate(timeout=400)
    return process.returncode, out, said + rest


@pytest.mark.nightly
def test_two_live_cameras_are_calibrated_and_their_files_written(box, tmp_path):
    for _ in range(3):
        status, out, said = calibrated(box, tmp_path)
        if ": turning: " not in said:  # a busy machine drops too many frames: then turn again
            break
    assert status == 0, said
    (found,) = json.loads(out)["cameras"]
    w, x, y, z = found["turn_wxyz"]
    off_deg = (Rotation.from_quat([x, y, z, w]) * WRONG.inv()).magnitude() * 57.3
    print(found, off_deg)
    # Pixels of 0.7° tell little, and a busy machine drops frames: it says so.
    assert off_deg < min(3 * found["sigma_deg"], 1.5)
    files = [tmp_path / name for name in NAMES]
    ids = {re.search(r"\[rig\]\nid = (\w+)", path.read_text())[1] for path in files}
    assert len(ids) == 1
    assert Path(f"{files[0]}.~1~").exists()
    assert lenses.load(str(files[1])).lenses[0].rotation_wxyz != (0, 0, 1, 0)
    # and a daemon takes them, but not one of them with a file of no rig
    both = [f"--source=sim:{tmp_path}/{k}.sock" for k in range(2)]
    status, _, log = run(*both, f"--camera={files[0]}", f"--camera={FILES[1]}")
    assert status == 2
    assert f"is of rig {ids.pop()}" in log
    status, _, log = run(*both, *(f"--camera={path}" for path in files), "--check-config")
    assert status == 0, log


def test_a_box_that_is_not_turned_is_told(box, tmp_path):
    process = calibrate(tmp_path, "--seconds", "6", "--turning-only", "--patience-s", "120")
    _, said = process.communicate(timeout=400)
    assert process.returncode == 1
    assert re.search(r"module_\w+.camera: turning: too little, .*: turn the box", said), said
    assert not Path(f"{tmp_path / NAMES[0]}.~1~").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "1 --source and 1 --camera"),
        (("--source=sim:/b", f"--camera={FILES[0]}"), "one file is named twice"),
        (("--source=sim:/b", "--camera=equirect"), "its picture has no lens to turn"),
    ],
)
def test_command_lines_that_make_no_sense(words, message):
    first = ("--source=sim:/a", f"--camera={FILES[0]}")
    done = subprocess.run(
        [PROGRAM, "calibrate", "rig", *first, *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert message in done.stderr
