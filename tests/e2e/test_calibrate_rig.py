"""`lightprobe calibrate rig`: two fisheye modules whose mounting is wrong by some degrees."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lightprobe.align import rig
from lightprobe.align.rig import RigError
from lightprobe.calibrate import camera_file, rig_overlap
from lightprobe.calibrate.exposure_series import decode
from lightprobe.cli.calibrate_rig import EXPOSURES_US, track_of
from lightprobe.imaging import camera as lenses
from lightprobe.imaging.camera import Camera
from lightprobe.sim import scenes
from lightprobe.sim.camera import Shot, SimulatedCamera
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.nightly  # test_calibrate_rig_live.py runs the command each time

CAMERAS = Path(__file__).parents[2] / "packaging" / "cameras"
FILES = [CAMERAS / f"module_{name}.camera" for name in ("ahead", "back")]
NAMES = [path.name for path in FILES]
#: How the second module really sits, against what its file says.
WRONG = Rotation.from_euler("YXZ", [3, -2, 4], degrees=True)
TURNING = Behaviour(act_s=0, swing_deg=70, swing_hz=0.2, nod_deg=25)
SIZE_PX = (520, 520)
SECONDS = 15.0


def mounted(file: Path, turn: Rotation) -> Camera:
    """What really sits there."""
    camera = lenses.load(str(file))
    lens = camera.lenses[0]
    w, x, y, z = lens.rotation_wxyz
    x, y, z, w = (turn * Rotation.from_quat([x, y, z, w])).as_quat()
    return replace(camera, lenses=(replace(lens, rotation_wxyz=(w, x, y, z)),))


def module(
    number: int, behaviour: Behaviour, moved: Rotation | None = None, **more: object
) -> SimulatedCamera:
    """One of two modules: 8 ms apart, 3 % different, read row by row, with noise."""
    world = World(scenes.load(["room"]), behaviour, 4.0)
    turn = WRONG if number else Rotation.identity()
    camera = mounted(FILES[number], turn if moved is None else moved * turn)
    other = {"phase_s": 0.008, "seed": 1, "white_balance": (1.03, 1.0, 0.97)} if number else {}
    more = {"size_px": SIZE_PX, "row_time_us": 15.0} | other | more
    return SimulatedCamera(world, camera, **more)


def turned(behaviour: Behaviour, seconds: float = SECONDS):
    """Tracks of both modules, each by a daemon of its own, in simulated time."""
    tracks = []
    for number, file in enumerate(FILES):
        with LiveProbe(module(number, behaviour), [f"--camera={file}"]) as probe:
            client = probe.client(Subscription(sh_order=0, max_lights=0))
            probe.run(seconds)
            tracks.append(track_of(NAMES[number], client.estimates))
    return tracks


def seen(
    max_theta_deg: float | None = None,
    moved: Rotation | None = None,
    size_px: tuple[int, int] = SIZE_PX,
    first: int = 0,
):
    """Views of both modules, of the box at rest, by the frames from `first`.

    `moved`: before the second one's were taken.
    """
    views = []
    for number, file in enumerate(FILES):
        camera = module(number, Behaviour(act_s=0), moved if number else None, size_px=size_px)
        shots = []
        for us in EXPOSURES_US:
            jpegs = [camera.frame(first + k, Shot(us)) for k in range(4)]
            frames = [decode(jpeg, "MJPG", size_px) for jpeg in jpegs]
            shots.append((us, np.rint(np.mean(frames, axis=0)).astype(np.uint8)))
        told = lenses.load(str(file))
        if max_theta_deg is not None:
            told = replace(told, lenses=(replace(told.lenses[0], max_theta_deg=max_theta_deg),))
        views += rig_overlap.views(number, told, shots)
    return views


@pytest.fixture(scope="module")
def tracks():
    return turned(TURNING)


@pytest.fixture(scope="module")
def views():
    return seen()


def off_deg(rotation: Rotation) -> float:
    return float(np.degrees((rotation * WRONG.inv()).magnitude()))


def test_the_mounting_is_found(tracks, views, tmp_path, record_property):
    (by_turning,) = rig.solve(NAMES, tracks, [])
    (found,) = rig.solve(NAMES, tracks, views)
    print(
        f"rig of two simulated modules, wrong by {np.degrees(WRONG.magnitude()):.1f}°: found by "
        f"turning within {off_deg(by_turning.turned.rotation):.2f}° "
        f"(± {by_turning.turned.sigma_deg:.2f}° stated), with the overlap within "
        f"{off_deg(found.turned.rotation):.2f}° (± {found.turned.sigma_deg:.2f}°)"
    )
    for one, most_deg in ((by_turning, 0.8), (found, 0.25)):
        assert off_deg(one.turned.rotation) < most_deg
        assert off_deg(one.turned.rotation) < 3 * one.turned.sigma_deg
    assert found.turned.sigma_deg < 0.17
    assert abs(found.time_offset_s) < 0.01
    # and the camera files say it
    paths = [tmp_path / name for name in NAMES]
    for path, file in zip(paths, FILES, strict=True):
        path.write_text(file.read_text())
    turn = found.turned.rotation
    camera_file.save_rig(paths, [Rotation.identity(), turn], [0.0, found.turned.sigma_deg])
    told = lenses.load(str(paths[1])).lenses[0].rotation_wxyz
    wanted = mounted(FILES[1], turn).lenses[0].rotation_wxyz
    assert abs(np.dot(told, wanted)) == pytest.approx(1, abs=1e-6)
    assert "# " in paths[1].read_text()  # comments stay


def test_few_pixels_and_plain_walls_are_less_certain(tracks):
    distances, side_px = [], 260
    for number in range(3):
        views = seen(size_px=(side_px, side_px), first=10 * number)
        (found,) = rig.solve(NAMES, tracks, views)
        error = (found.turned.rotation * WRONG.inv()).as_rotvec(degrees=True)
        distances.append(np.sqrt(error @ np.linalg.solve(found.turned.covariance, error)))
        print(f"{side_px} px: off {error.round(2)}° ± {found.turned.sigma_deg:.2f}°")
    print(f"distances in sigmas of three axes: {np.round(distances, 1)}")
    assert max(distances) < 4.0  # 1 in 1000 by chance


def test_a_box_that_turns_too_little_or_about_one_axis(tracks):
    still = tracks[1].changed(lambda r: Rotation.from_rotvec(0.02 * r.as_rotvec()))
    with pytest.raises(RigError, match=r"module_back.camera: turning: too little, .* turn the box"):
        rig.solve(NAMES, [tracks[0], still], [])
    yaw = tracks[1].changed(lambda r: Rotation.from_rotvec(r.as_rotvec() * [0, 1, 0]))
    with pytest.raises(RigError, match=r"module_back.camera: turning: about one axis only"):
        rig.solve(NAMES, [tracks[0], yaw], [])


def test_cameras_that_do_not_turn_alike(tracks):
    other = tracks[1].changed(lambda r: Rotation.from_rotvec(2 * r.as_rotvec()))
    # half a period of TURNING: it turns as fast at the same moments, but back
    late = replace(tracks[1], start_ns=tracks[1].start_ns + 2_500_000_000)
    for track in (other, late):
        with pytest.raises(RigError, match=r"it does not turn as module_ahead.camera does"):
            rig.solve(NAMES, [tracks[0], track], [])


def test_lenses_that_do_not_overlap(tracks):
    with pytest.raises(RigError, match=r"module_back.camera: overlap: .*--turning-only"):
        rig.solve(NAMES, tracks, seen(max_theta_deg=88))


def test_a_box_that_was_turned_between_the_pictures(tracks):
    moved = Rotation.from_euler("Y", 4, degrees=True)
    with pytest.raises(RigError, match="overlap: it contradicts the turning by"):
        rig.solve(NAMES, tracks, seen(moved=moved))
