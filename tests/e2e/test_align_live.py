"""`lightprobe align` with the real daemon: a simulated headset carries the simulated camera."""

import json

import numpy as np
import pytest
from lightprobe.align import mount
from lightprobe.cli.align_poses import samples_of
from lightprobe.imaging import camera as lenses
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.clock import START_NS, UNIX_NS
from lightprobe.sim.headset import Headset, line
from lightprobe.sim.live import LiveProbe
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
    told = [line(t_ns, np.array(q)) for t_ns, q in orientations]
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
