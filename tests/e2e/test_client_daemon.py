"""The Python client and the real daemon."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from harness import LONG_S, Daemon, jpeg
from lightprobe import geometry
from lightprobe.client import Client
from lightprobe.imaging import image
from lightprobe.sim.scene import MapTruth
from lightprobe.wire import Subscription
from web_daemon import free_port


@pytest.fixture(scope="module")
def uri(tmp_path_factory):
    picture = tmp_path_factory.mktemp("picture") / "a.jpg"
    picture.write_bytes(jpeg())
    with Daemon(f"--source=file:{picture}?rate=30") as daemon:
        yield f"unix:{daemon.socket}"


def take(client: Client, count: int) -> list[tuple[str, int]]:
    got = [client.receive(LONG_S) for _ in range(count)]
    return [(e.sh.kind, e.subscription) for e in got]


def test_the_first_estimate_is_of_the_subscription_asked_for(uri):
    """A probe sends the newest estimate of its defaults at once: that one is not ours."""
    for _ in range(5):
        with Client(uri, Subscription(kind="TOTAL", sh_order=4)) as client:
            assert take(client, 3) == [("TOTAL", 1)] * 3
            assert client.hello is not None
            assert client.hello.protocol_minor >= 1
            # The order that nobody had asked for is computed from the next frame on.
            assert client.wait_for(lambda c: c.receive(LONG_S).sh.order == 4, LONG_S)


def test_after_a_new_subscription_nothing_of_the_former_is_received(uri):
    with Client(uri) as client:
        assert take(client, 2) == [("AMBIENT", 1)] * 2
        for number, kind in enumerate(("TOTAL", "AMBIENT", "TOTAL"), start=2):
            client.subscribe(Subscription(kind=kind, sh_order=1))
            assert take(client, 3) == [(kind, number)] * 3


def export(*words):
    command = [Path(sys.executable).parent / "lightprobe", "export", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=2 * LONG_S)


def test_without_a_camera_for_stills_there_are_none(uri):
    command = [Path(sys.executable).parent / "lightprobe", "still", uri]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LONG_S)
    assert done.returncode == 1
    assert "stills: this probe has no camera for stills" in done.stderr
    assert "--source=ptp:" in done.stderr


def test_all_the_light_of_a_probe_as_lights(uri, tmp_path):
    path = tmp_path / "x.glb"
    done = export(path, "--from", uri, "--constellation", 20, "--wait", LONG_S)
    assert done.returncode == 0, done.stderr
    assert f"written: {path}: 20 lamps" in done.stderr
    data = path.read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert len(document["extensions"]["KHR_lights_punctual"]["lights"]) == 20
    (light,) = document["extensions"]["EXT_lights_image_based"]["lights"]
    assert not np.any(light["irradianceCoefficients"])
    done = export(tmp_path / "x.hdr", "--from", uri, "--constellation", 20)
    assert done.returncode == 2
    assert "lights go into a .glb file" in done.stderr


@pytest.mark.parametrize("name", ["x.hdr", "x.exr", "x.pfm", "x.glb"])
def test_the_light_of_a_probe_as_a_file(uri, tmp_path, name):
    path = tmp_path / name
    done = export(path, "--from", uri, "--width", 256, "--order", 4, "--wait", LONG_S, "--json")
    assert done.returncode == 0, done.stderr
    assert f"written: {path}: " in done.stderr
    assert "SH of order 4; relative units: not calibrated" in done.stderr
    told = json.loads(done.stdout)
    assert [p.name for p in tmp_path.iterdir()] == [name]
    if name == "x.glb":
        data = path.read_bytes()
        assert data[:4] == b"glTF"
        document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
        assert document["scenes"][0]["extras"]["lightprobe"] == told
        return
    radiance = image.read(path).radiance
    assert radiance.shape == (128, 256, 3)
    mean = MapTruth(radiance).irradiance(geometry.sphere_normals()).mean(axis=0)
    ambient = np.array(told["sh"]["coefficients"][0]) * np.pi * 0.282095
    lamps = sum(np.array(light["irradiance"]) for light in told["lights"]) / 4
    assert mean == pytest.approx(ambient + lamps, rel=0.1)


def bake(*words):
    command = [Path(sys.executable).parent / "lightprobe", "bake", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=2 * LONG_S)


def test_a_mesh_is_lit_by_a_probe(uri, tmp_path):
    """Baked once and lit, or both at once: the same; a convex mesh has no shadows."""
    shape = trimesh.creation.icosphere(2)
    shape.export(tmp_path / "ball.obj")
    few = ("--directions", 512)
    done = bake(tmp_path / "ball.obj", tmp_path / "ball.npz", *few)
    assert done.returncode == 0, done.stderr
    lit = []
    for source, more in ((tmp_path / "ball.npz", ()), (tmp_path / "ball.obj", few)):
        out = tmp_path / f"{source.suffix[1:]}.ply"
        done = bake(source, out, "--from", uri, "--wait", LONG_S, "--json", *more)
        assert done.returncode == 0, done.stderr
        assert "a vertex colour of 1 is a radiance of" in done.stderr
        told = json.loads(done.stdout)
        assert told["vertices"] == 162
        raw = trimesh.load(out, process=False).metadata["_ply_raw"]["vertex"]["data"]
        lit.append(np.stack([raw[f"irradiance_{c}"] for c in "rgb"], axis=-1))
        assert told["mean_irradiance"] == pytest.approx(list(lit[-1].mean(axis=0)), rel=1e-4)
    assert lit[0] == pytest.approx(lit[1], rel=0.01)
    with Client(uri, Subscription(max_lights=8, area_lights=True)) as client:
        true = client.receive(LONG_S).irradiance(shape.vertex_normals)
    assert np.abs(lit[0] - true).max() < 0.03 * true.max()
    done = bake(tmp_path / "ball.npz", tmp_path / "ball.glb", "--from", uri, "--wait", LONG_S)
    assert done.returncode == 0, done.stderr
    assert len(trimesh.load(tmp_path / "ball.glb", force="mesh").faces) == len(shape.faces)
    shape.invert()
    shape.export(tmp_path / "inside.obj")
    done = bake(tmp_path / "inside.obj", tmp_path / "inside.npz", *few)
    assert done.returncode == 2
    assert "face inward: try --flip" in done.stderr
    assert not (tmp_path / "inside.npz").exists()


def test_export_without_a_probe_says_so(tmp_path):
    done = export(tmp_path / "x.hdr", "--from", "tcp:127.0.0.1:9", "--wait", "0.5")
    assert done.returncode == 1
    assert "is lightprobed running" in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("transport", ["unix", "tcp", "ws"])
def test_poses_put_estimates_into_the_apps_world(tmp_path, transport):
    """Over every transport; the clocks are compared in the background."""
    port = free_port()
    picture = tmp_path / "a.jpg"
    picture.write_bytes(jpeg())
    extra = () if transport == "unix" else (f"--publish={transport}:127.0.0.1:{port}",)
    options = (f"--source=file:{picture}?rate=30", "--orientation=client", *extra)
    with Daemon(*options) as daemon:
        addresses = {"ws": f"ws://127.0.0.1:{port}/", "tcp": f"tcp:127.0.0.1:{port}"}
        uri = addresses.get(transport, f"unix:{daemon.socket}")
        with Client(uri, Subscription(frame="WORLD")) as client:
            turned = np.array([0, np.sin(0.5), 0, np.cos(0.5)])

            def in_world(probe: Client) -> bool:
                probe.send_pose(turned)
                latest = probe.latest()
                return latest is not None and latest.frame == "WORLD"

            assert client.wait_for(in_world, LONG_S)
            latest = client.latest()
            assert latest is not None
            assert latest.orientation == pytest.approx(turned, abs=1e-3)
            assert client.hello.orientation == "client"
            assert client.wait_for(lambda c: in_world(c) and c.clock_sigma_s < 1, LONG_S)
            with pytest.raises(ValueError, match="unit quaternion"):
                client.send_pose([0, 0, 0, 2])


def test_poses_that_are_not_wanted_are_told(uri):
    with Client(uri) as client:
        assert client.wait_for(lambda c: c.connected, LONG_S)
        client.send_pose([0, 0, 0, 1])
        assert client.wait_for(lambda c: "--orientation=client" in (c.last_error or ""), LONG_S)
        assert client.connected
