"""Reflection maps of a live daemon, and of files: the same light as the estimate's."""

import json
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from harness import LONG_S, Daemon, jpeg
from lightprobe import Client, Subscription, geometry, reflection_map
from lightprobe.imaging import cube, image

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"


@pytest.fixture(scope="module")
def picture(tmp_path_factory):
    path = tmp_path_factory.mktemp("picture") / "a.jpg"
    path.write_bytes(jpeg())
    return path


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def brightest(found):
    """Direction of the brightest texel."""
    index = found.radiance.sum(axis=-1).argmax()
    return reflection_map.directions(found.size).reshape(-1, 3)[index]


def most_deg(size, radius_deg):
    """Farthest that a lamp's brightest texel is from its centre: within it, or half a texel off."""
    return radius_deg + np.degrees(2 / size / 2 * 2**0.5)


def difference(found, estimate):
    """Largest difference of irradiance, relative to the largest one."""
    normals = geometry.sphere_normals(1)
    lit = estimate.irradiance(normals)
    return np.abs(found.irradiance(normals) - lit).max() / lit.max()


@pytest.mark.parametrize(("transport", "size"), [("unix", 16), ("tcp", 64), ("ws", 64)])
def test_the_map_is_the_light_of_the_estimate(picture, tmp_path, transport, size):
    port = free_port()
    address, publish = {
        "unix": (f"unix:{tmp_path}/probe", f"unix:{tmp_path}/probe"),
        "tcp": (f"tcp:127.0.0.1:{port}", f"tcp:127.0.0.1:{port}"),
        "ws": (f"ws://127.0.0.1:{port}/", f"ws:127.0.0.1:{port}"),
    }[transport]
    source = f"--source=file:{picture}?rate=30"
    wish = Subscription(reflection_map_size=size, reflection_map_rate_hz=30, smoothing="RAW",
                        sh_order=4, max_lights=8)  # fmt: skip
    with (
        Daemon(source, "--reflection-map=64", f"--publish={publish}") as daemon,
        Client(address, wish) as client,
    ):
        assert client.wait_for(lambda c: c.reflection_map is not None, LONG_S), daemon.log()
        found, estimate = client.reflection_map, client.receive(LONG_S)
        assert client.hello.max_reflection_map_size == 64
        assert (found.size, found.kind) == (size, "TOTAL")
        assert found.boot_id == estimate.boot_id
        assert difference(found, estimate) < 0.02  # of the SH that the packet leaves out
        lamp = estimate.lights[0]
        most = most_deg(size, lamp.angular_radius_deg)
        assert geometry.angle_deg(brightest(found), lamp.direction) < most


def test_it_is_off_unless_the_owner_wants_it(picture, tmp_path):
    with (
        Daemon(f"--source=file:{picture}?rate=30", f"--publish=unix:{tmp_path}/probe"),
        Client(f"unix:{tmp_path}/probe", Subscription(reflection_map_size=16)) as client,
    ):
        assert client.wait_for(lambda c: c.statistics.refusals > 0, LONG_S)
        assert client.hello.max_reflection_map_size == 0
        assert "--reflection-map" in client.last_error
        for _ in range(10):
            client.receive(LONG_S)  # everything else comes
        assert client.reflection_map is None
        assert client.statistics.refusals == 1


def export(*words):
    command = [LIGHTPROBE, "export", *map(str, words), "--wait", str(LONG_S), "--json"]
    return subprocess.run(command, capture_output=True, text=True, timeout=2 * LONG_S)


def test_it_is_exported(picture, tmp_path):
    """As a cross, with the lamp where it is; in a .glb file without the lamps, which it lists."""
    cross, scene = tmp_path / "x.exr", tmp_path / "x.glb"
    with Daemon(f"--source=file:{picture}?rate=30", "--reflection-map=64") as daemon:
        address = ["--from", f"unix:{daemon.socket}", "--reflection-map"]
        done = export(cross, *address, "--layout", "cross")
        assert done.returncode == 0, done.stderr
        in_scene = export(scene, *address)
        assert in_scene.returncode == 0, in_scene.stderr
    radiance = image.read(cross).radiance
    assert radiance.shape == (192, 256, 3)
    towards = cube.cross(reflection_map.directions(64).astype(np.float32))
    brightest_of_cross = towards.reshape(-1, 3)[radiance.sum(axis=-1).argmax()]
    lamp = json.loads(done.stdout)["lights"][0]
    most = most_deg(64, lamp["angular_radius_deg"])
    assert geometry.angle_deg(brightest_of_cross, lamp["direction"]) < most
    data = scene.read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert len(document["extensions"]["KHR_lights_punctual"]["lights"]) >= 1
    (light,) = document["extensions"]["EXT_lights_image_based"]["lights"]
    assert light["specularImageSize"] == 64
    assert len(light["specularImages"]) == 3


def test_it_is_not_exported_unless_the_owner_wants_it(picture, tmp_path):
    with Daemon(f"--source=file:{picture}?rate=30") as daemon:
        address = ["--from", f"unix:{daemon.socket}", "--reflection-map"]
        done = export(tmp_path / "x.exr", *address)
    assert done.returncode != 0
    assert "start lightprobed with --reflection-map=64" in done.stderr
    assert list(tmp_path.iterdir()) == []


def estimate(*arguments):
    return subprocess.run(
        [LIGHTPROBE, "estimate", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=60,
    )


@pytest.mark.parametrize("size", [16, 32, 64])
def test_files_give_one_too(picture, tmp_path, size):
    faces = tmp_path / "room.npy"
    done = estimate(picture, "--reflection-map", faces, "--reflection-size", size, "--json")
    assert done.returncode == 0, done.stderr
    radiance = np.load(faces)
    assert (radiance.shape, radiance.dtype) == ((6, size, size, 3), np.float32)
    found = reflection_map.ReflectionMap(0, 0, 0, 0, "TOTAL", radiance)
    lamp = json.loads(done.stdout)["lights"][0]
    most = most_deg(size, lamp["angular_radius_deg"])
    assert geometry.angle_deg(brightest(found), lamp["direction"]) < most


def test_an_environment_map_of_it_is_read_by_others(picture, tmp_path):
    file = tmp_path / "room.hdr"
    done = estimate(picture, "--reflection-map", file, "--json")
    assert done.returncode == 0, done.stderr
    radiance = image.read(file).radiance
    assert radiance.shape == (128, 256, 3)
    lamp = json.loads(done.stdout)["lights"][0]
    row, column = np.unravel_index(radiance.sum(axis=-1).argmax(), radiance.shape[:2])
    towards = geometry.equirect_directions(256, 128)[row, column]
    most = most_deg(32, lamp["angular_radius_deg"])
    assert geometry.angle_deg(towards, lamp["direction"]) < most


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--reflection-map", "x.png"], ".hdr"),
        (["--reflection-map", "no-such-folder/x.hdr"], "no-such-folder"),
        (["--reflection-map", "x.hdr", "--reflection-size", "48"], "16, 32 or 64"),
    ],
)
def test_wishes_that_cannot_be(picture, tmp_path, arguments, words):
    done = subprocess.run(
        [LIGHTPROBE, "estimate", picture, *arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert words in done.stderr
    assert list(tmp_path.iterdir()) == []
