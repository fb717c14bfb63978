"""A recording with poses: `file:FOLDER?poses=FILE`, light in the world of the poses."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from lightprobe.client import Client
from lightprobe.estimate import Estimate
from lightprobe.geometry import angle_deg, direction_from_angles
from lightprobe.wire import Subscription

from .harness import Daemon, jpeg, panorama

PICTURES, RATE_HZ, SWING_DEG = 60, 15, 30.0
#: Left of where the camera looks at first, by the column of the lamp; row 0.3 is 36° up.
LAMP_COLUMN = 0.4
LAMP = direction_from_angles(360 * (LAMP_COLUMN - 0.5), 36.0)


def turns_deg() -> np.ndarray:
    """To the left, in each picture: it swings, and a recording that begins anew does not leap."""
    return SWING_DEG * np.sin(2 * np.pi * np.arange(PICTURES) / PICTURES)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of pictures of a room, by a camera that swings, and poses.txt."""
    folder = tmp_path_factory.mktemp("recording")
    width = 480
    room = panorama(width, lamp_column=LAMP_COLUMN)
    random = np.random.default_rng(1)
    for _ in range(110):  # furniture, in pictures without a seam
        x, y = random.integers(0, width - 40), random.integers(20, width // 2 - 40)
        if y > 0.38 * width / 2:
            colour = [int(value) for value in random.integers(10, 140, 3)]
            cv2.rectangle(room, (x, y), (x + int(random.integers(5, 40)), y + 20), colour, -1)
    rows = []
    for number, turn_deg in enumerate(turns_deg()):
        # The camera turns to the left: what it sees moves to the right.
        shift = np.float32([[1, 0, turn_deg / 360 * width], [0, 1, 0]])
        wide = cv2.warpAffine(np.tile(room, (1, 3, 1)), shift, (3 * width, width // 2))
        (folder / f"{number}.jpg").write_bytes(jpeg(wide[:, width : 2 * width], quality=97))
        half = np.radians(turn_deg) / 2
        rows.append(f"{1e9 + number / RATE_HZ:.6f} 0 0 0 0 {np.sin(half)} 0 {np.cos(half)}")
    (folder / "poses.txt").write_text("\n".join(rows))
    return folder


@contextmanager
def packets(recording: Path, poses: Path) -> Iterator[Iterator[Estimate]]:
    """Estimates of the daemon on the recording."""
    query = f"rate={RATE_HZ}&poses={poses}&pose_sigma_m=0&exposures_us=1000"
    with (
        Daemon(f"--source=file:{recording}?{query}", "--orientation=frames") as daemon,
        Client(f"unix:{daemon.socket}", Subscription(frame="WORLD", smoothing="RAW")) as client,
    ):
        yield client.estimates(timeout_s=60)


def test_lamps_stay_in_the_world_of_the_poses(recording: Path) -> None:
    with packets(recording, recording / "poses.txt") as estimates:
        told = [one for one, _ in zip(estimates, range(110), strict=False)]
    known = [one for one in told if one.frame == "WORLD"]
    assert len(known) > 90
    for one in known[30:]:
        assert len(one.lights) >= 1
        assert angle_deg(one.lights[0].direction, LAMP) < 1.5


def test_poses_that_nobody_uses_are_told(recording: Path) -> None:
    query = f"rate={RATE_HZ}&poses={recording / 'poses.txt'}"
    with Daemon(f"--source=file:{recording}?{query}") as daemon:
        assert "its recorded poses are not used — add --orientation=frames" in daemon.log()


def test_poses_of_another_sense_are_not_believed(recording: Path, tmp_path: Path) -> None:
    """A turn to the left that is told as one to the right: no packet says WORLD and is wrong."""
    rows = [row.split() for row in (recording / "poses.txt").read_text().splitlines()]
    wrong = tmp_path / "wrong.txt"
    wrong.write_text("\n".join(" ".join([*row[:5], str(-float(row[5])), *row[6:]]) for row in rows))
    with packets(recording, wrong) as estimates:
        told = [one for one, _ in zip(estimates, range(110), strict=False)]
    assert all(one.frame == "PROBE" for one in told[50:])


#: An ordinary camera, which sees 60° of a textured wall.
PINHOLE = """
[camera]
projection = pinhole
width_px = 240
height_px = 180
[lens.0]
cx_px = 120
cy_px = 90
fx_px = 208
fy_px = 208
"""


def test_a_pose_that_leaps_away_while_the_picture_stays_is_not_believed(tmp_path: Path) -> None:
    """An app that recentres: where the camera then seems to look, nobody has seen anything."""
    random = np.random.default_rng(3)
    wall = np.full((180, 240, 3), 90, np.uint8)
    for _ in range(120):
        x, y = random.integers(0, 220), random.integers(0, 160)
        colour = [int(value) for value in random.integers(20, 200, 3)]
        cv2.rectangle(wall, (x, y), (x + int(random.integers(5, 30)), y + 15), colour, -1)
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    count, leaps_at, rows = 150, 60, []
    for number in range(count):
        noisy = np.clip(wall + random.normal(0, 1.5, wall.shape), 0, 255).astype(np.uint8)
        (pictures / f"{number}.jpg").write_bytes(jpeg(noisy, quality=97))
        half = np.radians(90 if number >= leaps_at else 0) / 2
        rows.append(f"{number / RATE_HZ:.6f} 0 0 0 0 {np.sin(half)} 0 {np.cos(half)}")
    (tmp_path / "poses.txt").write_text("\n".join(rows))
    (tmp_path / "wall.camera").write_text(PINHOLE)
    query = f"rate={RATE_HZ}&poses={tmp_path / 'poses.txt'}&pose_sigma_m=0&exposures_us=1000&loop=0"
    with (
        Daemon(
            f"--source=file:{pictures}?{query}", f"--camera={tmp_path / 'wall.camera'}",
            "--orientation=frames",
        ) as daemon,
        Client(f"unix:{daemon.socket}", Subscription(frame="WORLD", smoothing="RAW")) as client,
    ):  # fmt: skip
        frames = [
            one.frame for one, _ in zip(client.estimates(60), range(count - 15), strict=False)
        ]
    assert frames[20:50].count("WORLD") > 25
    assert frames[leaps_at + 5 :].count("WORLD") == 0
