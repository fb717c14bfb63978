"""`lightprobe align`: the command, on a simulated headset that carries the probe."""

import asyncio
import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from harness import LONG_S, Daemon, jpeg
from lightprobe import recording
from lightprobe.align import mount
from lightprobe.server import ProbeServer
from lightprobe.sim.headset import Headset, line
from lightprobe.sim.procedural import random_scene
from lightprobe.sim.world import Behaviour, World
from lightprobe_proto import lightprobe_pb2 as pb
from scipy.spatial.transform import Rotation

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
MOUNT = Rotation.from_euler("YXZ", [12, -35, 5], degrees=True)
OFFSET_M = np.array([0.02, 0.07, -0.09])
LOOKING_AROUND = Behaviour(act_s=0, swing_deg=35, swing_hz=0.27, nod_deg=18, nod_hz=0.19)


def align(*words, **popen):
    return subprocess.run(
        [LIGHTPROBE, "align", *map(str, words)], capture_output=True, text=True, timeout=LONG_S,
        **popen,
    )  # fmt: skip


def write_poses(path, headset, seconds=20.0, world=None):
    world = world or World([random_scene(1)], LOOKING_AROUND)
    with open(path, "w") as file:
        for number in range(int(seconds * headset.rate_hz)):
            t_s, pose = headset.pose(world, number)
            file.write(line(round(1e9 * t_s), pose) + "\n")
    return path


def off_deg(found, true=MOUNT):
    return np.degrees((found.inv() * true).magnitude())


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Poses of a head, and a probe's own as another tracker on the same head would tell them."""
    folder = tmp_path_factory.mktemp("align")
    probe = write_poses(folder / "probe.jsonl", Headset(rate_hz=30, seed=5))
    mounted = Headset(tuple(MOUNT.as_quat()), late_ms=25, jump_deg=9, jump_s=8)
    return write_poses(folder / "head.jsonl", mounted), probe


def test_files_of_poses_give_a_mount_file(files, tmp_path):
    output = tmp_path / "mounts" / "mine.ini"
    done = align("poses", *files, "--output", output, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert off_deg(Rotation.from_quat(found["rotation_xyzw"])) < 0.2
    assert found["time_offset_s"] == pytest.approx(0.025, abs=0.003)
    assert 0 < found["sigma_deg"] < 0.2
    written = mount.load(output)
    assert off_deg(written.rotation) < 0.2
    assert written.sigma_deg == pytest.approx(found["sigma_deg"], rel=1e-3)
    assert "written: " in done.stderr


def test_words_for_people_csv_and_stdin(files, tmp_path):
    head = tmp_path / "head.csv"
    poses = [json.loads(text) for text in files[0].read_text().splitlines()]
    rows = [f"{p['time_ns'] / 1e9:.9f},{','.join(map(str, p['rotation_xyzw']))}" for p in poses]
    head.write_text("\n".join(["time_s,x,y,z,w", *rows]))
    done = align("poses", head, files[1])
    assert done.returncode == 0, done.stderr
    assert "turned left 12." in done.stdout or "turned left 11.9" in done.stdout
    assert "± 0." in done.stdout
    piped = align("poses", "-", files[1], input=files[0].read_text())
    assert piped.returncode == 0, piped.stderr


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"time_ns": 1, "rotation_xyzw": [0, 0, 1]}', "line 1: not understood"),
        ('{"time_ns": 1}', "line 1: not understood"),
        ('{"time_ns": 1, "rotation_xyzw": [0, 0, 0, 1], "position_m": [0, 1]}', "line 1: not und"),
        ("nonsense", "line 1: not understood"),
        ("7", "line 1: not understood"),
        ('{"time_ns": 1, "rotation_xyzw": [0, 0, 0, 1]}', "1 poses: record some seconds"),
        ("", "0 poses"),
    ],
)
def test_bad_poses_are_named(files, tmp_path, text, words):
    head = tmp_path / "head.jsonl"
    head.write_text(text)
    done = align("poses", head, files[1])
    assert done.returncode == 1
    assert words in done.stderr
    assert "Traceback" not in done.stderr


def test_no_motion_one_axis_and_files_that_are_not_there(files, tmp_path):
    world = World([random_scene(1)], Behaviour(act_s=0, swing_deg=40, swing_hz=0.3))
    head = write_poses(tmp_path / "head.jsonl", Headset(), world=world)
    probe = write_poses(tmp_path / "probe.jsonl", Headset(seed=3), world=world)
    done = align("poses", head, probe, "--output", tmp_path / "no.ini")
    assert done.returncode == 1
    assert "turn about another axis too" in done.stderr
    assert not (tmp_path / "no.ini").exists()
    missing = align("poses", tmp_path / "missing.jsonl", files[1])
    assert missing.returncode == 1
    assert "No such file" in missing.stderr
    live = align("poses", files[0], "tcp:127.0.0.1:1")
    assert live.returncode == 2
    assert "lightprobe record" in live.stderr


def estimates(world):
    """Estimates of a probe on the head, for 15 seconds."""
    for number in range(450):
        t_s, (x, y, z, w) = Headset(rate_hz=30, seed=5).pose(world, number)
        estimate = pb.Estimate(ttl_ms=5000, exposure_count=1, orientation=[x, y, z, w])
        estimate.capture_time_unix_ns = round(1e9 * t_s) + 1
        estimate.sh.kind, estimate.sh.order = pb.SphericalHarmonics.AMBIENT, 0
        estimate.sh.coefficients[:] = [1, 1, 1]
        yield estimate


def walked(folder):
    """Poses with positions of a head that goes to and fro, and a recording of its probe.

    The probe sits at OFFSET_M, sees three lamps (0.1°), and is off by 0.1° and 5 mm as it is told.
    """
    rng = np.random.default_rng(3)
    lamps_m = np.array([[1.2, 1.3, -1.5], [-2.0, 1.1, -0.8], [0.4, 1.4, 2.1]])

    def turn(t_s):
        angles = [40 * np.sin(1.5 * t_s), 18 * np.sin(1.1 * t_s + 2), 0.0]
        return Rotation.from_euler("YXZ", angles, degrees=True)

    def noise():
        return Rotation.from_rotvec(0.1 * rng.standard_normal(3), degrees=True)

    def place_m(t_s):
        return 0.25 * np.array([np.sin(1.9 * t_s), 0.4 * np.sin(1.3 * t_s), np.sin(2.7 * t_s)])

    with open(folder / "head.jsonl", "w") as file:
        for t_s in np.arange(0, 15, 1 / 60):
            told_m = place_m(t_s) + 0.005 * rng.standard_normal(3)
            pose = {"time_ns": round(1e9 * t_s), "position_m": told_m.tolist(),
                    "rotation_xyzw": (turn(t_s) * noise()).as_quat().tolist()}  # fmt: skip
            file.write(json.dumps(pose) + "\n")
    with recording.Recorder(folder / "room.mcap") as recorder:
        for number, t_s in enumerate(np.arange(0.3, 14.5, 1 / 15)):
            probe = turn(t_s) * MOUNT
            estimate = pb.Estimate(ttl_ms=5000, exposure_count=1, sequence=number + 1)
            estimate.orientation[:] = (probe * noise()).as_quat()
            estimate.capture_time_unix_ns = 1_700_000_000_000_000_000 + round(1e9 * t_s)
            estimate.sh.kind, estimate.sh.order = pb.SphericalHarmonics.AMBIENT, 0
            estimate.sh.coefficients[:] = [1, 1, 1]
            for lamp, lamp_m in enumerate(lamps_m, 1):
                towards = probe.inv().apply(lamp_m - place_m(t_s) - turn(t_s).apply(OFFSET_M))
                towards = noise().apply(towards / np.linalg.norm(towards))
                estimate.lights.add(id=lamp, direction=towards, irradiance=[1, 1, 1],
                                    angular_radius_deg=2, direction_sigma_deg=0.1)  # fmt: skip
            payload = pb.FromProbe(estimate=estimate).SerializeToString()
            recorder.write(payload, estimate.capture_time_unix_ns)
    return folder / "head.jsonl", folder / "room.mcap"


def test_poses_with_positions_tell_where_the_probe_is(tmp_path):
    output = tmp_path / "mount.ini"
    head, probe = walked(tmp_path)
    done = align("poses", head, probe, "--output", output, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    off_m = np.abs(np.array(found["offset_m"]) - OFFSET_M)
    assert off_m.max() < 0.01
    assert (off_m < 3 * np.array(found["offset_sigma_m"])).all()
    written = mount.load(output)
    assert written.offset_m == pytest.approx(found["offset_m"], abs=1e-4)
    assert off_deg(written.rotation) < 0.2
    # In CSV, too. A run that does not tell it says why, and leaves that of the file as it was.
    poses = [json.loads(text) for text in head.read_text().splitlines()]
    rows = [[p["time_ns"], *p["rotation_xyzw"], *p["position_m"]] for p in poses]
    for columns, said in ((8, "its lens is at x, y, z ="), (5, "offset_m stays as it was")):
        names = ["time_ns", *"xyzw", "x_m", "y_m", "z_m"][:columns]
        lines = [",".join(map(str, row[:columns])) for row in [names, *rows]]
        (tmp_path / "head.csv").write_text("\n".join(lines))
        done = align("poses", tmp_path / "head.csv", probe, "--output", output)
        assert done.returncode == 0, done.stderr
        assert said in done.stdout + done.stderr
    assert "offset_m left out: the poses have no positions" in done.stderr
    assert (mount.load(output).offset_m == written.offset_m).all()


def test_live_poses_from_an_app_and_orientations_from_a_probe(files, tmp_path):
    """Both come while the command runs; it ends when the app closes its pipe."""
    told = list(estimates(World([random_scene(1)], LOOKING_AROUND)))

    async def look_around():
        server = ProbeServer("head", "test")
        async with server.listening("tcp:127.0.0.1:0") as address:
            process = await asyncio.create_subprocess_exec(
                LIGHTPROBE, "align", "poses", "-", address, "--seconds", "600", "--json",
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            )  # fmt: skip
            process.stdin.write(files[0].read_bytes())
            await process.stdin.drain()
            while not server._clients:
                await asyncio.sleep(0.05)
            for estimate in told:  # faster than real time: the stamps count
                server.publish(estimate)
                await asyncio.sleep(0.015)
            process.stdin.close()
            return *await process.communicate(), process.returncode

    out, said, status = asyncio.run(look_around())
    assert status == 0, said
    assert off_deg(Rotation.from_quat(json.loads(out)["rotation_xyzw"])) < 0.3


def test_a_probe_that_does_not_tell_how_it_is_turned(tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg())
    with Daemon(f"--source=file:{tmp_path}/a.jpg?rate=30", "--orientation=none") as daemon:
        uri = f"unix:{daemon.socket}"
        done = align("poses", "-", uri, "--seconds", 5, stdin=subprocess.DEVNULL)
    assert done.returncode == 1
    assert "--orientation=visual" in done.stderr


def test_lamps(tmp_path):
    places = [[0.6, 0.8, 0], [0, 0.6, -0.8], [0.36, 0.48, 0.8], [-0.8, 0.36, 0.48]]
    lamps = [{"direction": place, "irradiance": [1.0, 1, 1]} for place in places]
    (tmp_path / "probe.json").write_text(json.dumps({"lights": lamps}))
    turned = [{"direction": MOUNT.apply(lamp["direction"]).tolist()} for lamp in lamps[::-1]]
    (tmp_path / "head.json").write_text(json.dumps({"lights": turned}))
    done = align("lamps", tmp_path / "head.json", tmp_path / "probe.json", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert off_deg(Rotation.from_quat(found["rotation_xyzw"])) < 1e-3
    assert sorted(found["pairs"]) == [[0, 3], [1, 2], [2, 1], [3, 0]]
    for text in ("", "{}", '{"lights": 3}', '{"lights": [{}]}'):
        (tmp_path / "head.json").write_text(text)
        done = align("lamps", tmp_path / "head.json", tmp_path / "probe.json")
        assert done.returncode == 1
        assert "not understood" in done.stderr


def test_a_marker_that_was_printed_is_found(tmp_path):
    printed = tmp_path / "marker.png"
    done = align("marker", "--print", printed, "--size-mm", 40, "--marker", 3)
    assert done.returncode == 0, done.stderr
    paper = cv2.imread(str(printed), cv2.IMREAD_GRAYSCALE)
    assert paper.shape[0] == pytest.approx(40 * 8 / 6 / 25.4 * 600, abs=2)
    pdf = align("marker", "--print", tmp_path / "marker.pdf")
    assert pdf.returncode == 0
    assert (tmp_path / "marker.pdf").read_bytes().startswith(b"%PDF")
    # A photo from aside: the paper turned by 40° about its upright axis, before a pinhole camera.
    rotation = Rotation.from_euler("YX", [40, 15], degrees=True)
    corners = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0.0]])
    seen = rotation.apply(corners) + np.array([0.2, 0.1, -6])
    pixels = np.stack(
        [500 + 1500 * seen[:, 0] / -seen[:, 2], 400 - 1500 * seen[:, 1] / -seen[:, 2]]
    )
    side = paper.shape[0]
    square = np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float32) - 0.5
    warp = cv2.getPerspectiveTransform(square, pixels.T.astype(np.float32))
    photo = cv2.warpPerspective(paper, warp, (1000, 800), flags=cv2.INTER_AREA, borderValue=128)
    cv2.imwrite(str(tmp_path / "photo.png"), cv2.GaussianBlur(photo, (3, 3), 0))
    words = ["marker", tmp_path / "photo.png", "--marker", 3, "--intrinsics", "1500,1500,500,400"]
    done = align(*words, "--json", "--output", tmp_path / "mount.ini")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert off_deg(mount.load(tmp_path / "mount.ini").rotation, rotation) < 0.5
    assert found["pictures_used"] == 1
    other = align(*words[:2], "--intrinsics", "1500,1500,500,400")
    assert other.returncode == 1
    assert "left out: the marker is not found" in other.stderr
    for option, value in (("--intrinsics", "1,2"), ("--intrinsics", "a,b,c,d"),
                          ("--camera-on-head", "1,1,1,1"), ("--on", "inside")):  # fmt: skip
        assert align(*words, option, value).returncode == 2


def test_a_simulated_headset_writes_its_poses_while_time_goes_on(tmp_path):
    """Through a pipe, as an app would; the reader may go first."""
    pipe = tmp_path / "poses"
    os.mkfifo(pipe)
    simulator = subprocess.Popen(
        [LIGHTPROBE, "simulate", "--socket", tmp_path / "s", "--size", "64x32", "--headset", pipe,
         "--headset-mount", "0,0.6,0,0.8", "--swing-deg", "30", "--nod-deg", "20"],
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        with open(pipe) as file:
            told = [json.loads(file.readline()) for _ in range(40)]
        steps_ms = np.diff([pose["time_ns"] for pose in told]) / 1e6
        assert np.allclose(steps_ms, 1000 / 72, atol=1e-3)
        assert np.linalg.norm(told[9]["rotation_xyzw"]) == pytest.approx(1)
    finally:
        simulator.terminate()
        _, said = simulator.communicate(timeout=LONG_S)
    assert simulator.returncode == 0, said
    assert "Traceback" not in said
    refused = subprocess.run(
        [LIGHTPROBE, "simulate", "--headset", tmp_path / "f", "--headset-mount", "1,1,1,1"],
        capture_output=True, text=True, timeout=LONG_S,
    )  # fmt: skip
    assert refused.returncode == 2
    assert "--headset-mount" in refused.stderr
