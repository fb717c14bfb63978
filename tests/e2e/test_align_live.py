"""`lightprobe align` with the real daemon: a simulated headset carries the simulated camera."""

import json

import numpy as np
import pytest
from lightprobe.align import hand_eye, lever, mount, poses
from lightprobe.align.track import make
from lightprobe.cli.align_poses import samples_of, sightings_of
from lightprobe.imaging import camera as lenses
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.clock import START_NS, UNIX_NS
from lightprobe.sim.headset import Headset, line
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.motion import Track, turned
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription
from scipy.spatial.transform import Rotation
from test_align import align, off_deg

pytestmark = pytest.mark.many_frames

MOUNT = Rotation.from_euler("YXZ", [12, -35, 5], degrees=True)
SECONDS = 20.0


def world(**behaviour):
    return World(
        scenes.load(["room"]),
        Behaviour(**{"act_s": 0, "swing_deg": 35, "swing_hz": 0.27, "nod_deg": 18} | behaviour),
        30.0,
    )


def looked_around(folder, **behaviour):
    """Files of head and probe, where the daemon saw by its frames how it turned."""
    place = world(**behaviour)
    camera = SimulatedCamera(place, lenses.equirect(), (960, 480), rate_hz=30)
    with LiveProbe(camera) as probe:
        client = probe.client(Subscription(sh_order=0, max_lights=0))
        probe.run(SECONDS)
        orientations = samples_of(client.estimates)
    told = [line(one.time_ns, np.array(one.rotation_xyzw)) for one in orientations]
    (folder / "probe.jsonl").write_text("\n".join(told))
    headset = Headset(tuple(MOUNT.as_quat()), noise_deg=0.1, late_ms=30)
    with open(folder / "head.jsonl", "w") as file:
        for number in range(int(SECONDS * headset.rate_hz)):
            t_s, pose = headset.pose(place, number)
            file.write(line(UNIX_NS + START_NS + round(1e9 * t_s), pose) + "\n")
    return folder / "head.jsonl", folder / "probe.jsonl"


@pytest.mark.nightly
def test_the_mount_of_a_simulated_headset_is_found_within_half_a_degree(tmp_path, record_property):
    done = align("poses", *looked_around(tmp_path), "--json", "--output", tmp_path / "mount.ini")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    error_deg = off_deg(mount.load(tmp_path / "mount.ini").rotation, MOUNT)
    record_property("figure", f"mount: off by {error_deg:.3f}°, ± {found['sigma_deg']:.3f}° stated")
    print(found, error_deg)
    assert error_deg < 0.5
    assert error_deg < 4 * found["sigma_deg"]
    assert found["time_offset_s"] == pytest.approx(0.030, abs=0.005)


@pytest.mark.nightly
def test_a_head_that_only_turns_left_and_right_does_not_tell(tmp_path):
    done = align("poses", *looked_around(tmp_path, nod_deg=0.0), "--output", tmp_path / "no.ini")
    assert done.returncode == 1
    assert "turn about another axis too" in done.stderr
    assert not (tmp_path / "no.ini").exists()


@pytest.mark.nightly
def test_a_head_that_goes_to_and_fro_tells_where_the_probe_is(record_property):
    """A near room turns the pictures of a probe that moves: lamps make the mount exact, too."""
    offset_m = np.array([0.02, 0.07, -0.09])
    t_s = np.arange(0, SECONDS + 1, 1 / 60)
    to_scene = turned(35 * np.sin(1.7 * t_s), 18 * np.sin(1.2 * t_s + 1), 5 * np.sin(2.1 * t_s))
    head = Rotation.from_quat(to_scene[:, [1, 2, 3, 0]])
    way = [np.sin(1.9 * t_s), 0.4 * np.sin(1.3 * t_s), np.sin(2.7 * t_s + 1)]
    head_m = 0.25 * np.stack(way, axis=-1)
    probe = (head * MOUNT).as_quat()[:, [3, 0, 1, 2]]
    path = Track(t_s, probe, head_m + head.apply(offset_m))
    place = World(scenes.load(["room"]), Behaviour(act_s=0, path=path), 30.0)
    camera = SimulatedCamera(place, lenses.equirect(), (640, 320), rate_hz=15)
    with LiveProbe(camera) as daemon:
        client = daemon.client(Subscription(smoothing="RAW", sh_order=0, max_lights=8))
        daemon.run(SECONDS)
        estimates = client.estimates
    rng = np.random.default_rng(1)
    noise = Rotation.from_rotvec(0.1 * rng.standard_normal((len(t_s), 3)), degrees=True)
    stamps = [UNIX_NS + START_NS + round(1e9 * (t + 0.03)) for t in t_s]
    told_m = head_m + 0.005 * rng.standard_normal(head_m.shape)
    told = make("head", stamps, (head * noise).as_quat(), told_m)
    turns = hand_eye.solve(told, poses.track("probe", samples_of(estimates)))
    found = lever.solve(told, sightings_of(estimates), turns.rotation, turns.time_offset_s)
    assert isinstance(found, lever.Lever), found
    off_m, error_deg = np.abs(found.offset_m - offset_m), off_deg(found.rotation, MOUNT)
    record_property(
        "figure", f"offset: off by {1000 * off_m.max():.1f} mm, ± {1000 * found.sigma_m.max():.1f} "
        f"mm stated; mount: {error_deg:.3f}°, by turns alone {off_deg(turns.rotation, MOUNT):.3f}°",
    )  # fmt: skip
    print(found, off_m, error_deg)
    assert off_m.max() < 0.02
    assert (off_m < 3 * found.sigma_m).all()
    assert error_deg < max(0.3, 4 * found.rotation_sigma_deg)
