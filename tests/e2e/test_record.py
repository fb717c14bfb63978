"""`lightprobe record` and `replay`: what a client gets from a recording is what the probe sent."""

import asyncio
import contextlib
import errno
import json
import resource
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from harness import LONG_S, Client, Daemon, jpeg, wait_for
from lightprobe import AsyncClient, ProbeError, Subscription, recording
from lightprobe import Client as ProbeClient
from lightprobe.imaging import image
from lightprobe.server import cut
from lightprobe_proto import lightprobe_pb2 as pb
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from web_daemon import free_port
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"


def command(*words, **popen):
    return subprocess.run(
        [LIGHTPROBE, *map(str, words)], capture_output=True, text=True, timeout=LONG_S, **popen
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording of a daemon, and the daemon's boot."""
    folder = tmp_path_factory.mktemp("record")
    (folder / "a.jpg").write_bytes(jpeg())
    file = folder / "room.mcap"
    with Daemon(f"--source=file:{folder}/a.jpg?rate=30") as daemon:
        done = command("record", file, "--from", f"unix:{daemon.socket}", "--seconds", 2, "--json")
        assert done.returncode == 0, done.stderr
        with daemon.client() as client:
            boot = client.next("hello").boot_id
    summary = json.loads(done.stdout)
    assert summary["messages"] > 10
    return file, boot


@contextlib.contextmanager
def replayed(file, *options):
    """Replay on ports of its own; gives those of TCP and of WebSocket."""
    tcp, web = free_port(), free_port()
    process = subprocess.Popen(
        [LIGHTPROBE, "replay", file, "--publish", f"tcp:127.0.0.1:{tcp}",
         "--publish", f"ws:127.0.0.1:{web}", *options], stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    said = []
    try:
        while not any(f":{web}" in line for line in said):
            said.append(process.stderr.readline())
            assert said[-1], said
        yield tcp, web, said
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=LONG_S)


def test_a_recording_holds_the_schema_and_all_messages(recorded):
    file, boot = recorded
    with open(file, "rb") as stream:
        reader = make_reader(stream)
        messages = [pb.FromProbe.FromString(m.data) for _, _, m in reader.iter_messages()]
        (schema,) = reader.get_summary().schemas.values()
    assert (schema.name, schema.encoding) == ("lightprobe.v1.FromProbe", "protobuf")
    assert messages[0].hello.boot_id == boot
    numbers = [m.estimate.sequence for m in messages if m.WhichOneof("message") == "estimate"]
    assert numbers == sorted(numbers)
    assert all(m.estimate.boot_id == boot for m in messages if m.HasField("estimate"))
    assert any(m.WhichOneof("message") == "health" for m in messages)


def test_replay_is_a_probe(recorded):
    file, _ = recorded
    notes = []
    kept = [one.message.estimate for one in recording.read(file, notes)
            if one.message.HasField("estimate") and one.message.estimate.subscription]  # fmt: skip
    assert notes == []
    with replayed(file) as (tcp, web, _):
        for uri in (f"tcp:127.0.0.1:{tcp}", f"ws://127.0.0.1:{web}/"):
            with ProbeClient(uri, Subscription(sh_order=4, max_lights=8)) as client:
                estimate = client.receive(LONG_S)
                while len(estimate.sh.coefficients) < 25:  # the recording's first answers order 2
                    estimate = client.receive(LONG_S)
                assert client.hello.name == "room"
                assert client.age_ms() < 1000 * LONG_S
            assert any(np.allclose(estimate.sh.coefficients.ravel(), one.sh.coefficients)
                       for one in kept if len(one.sh.coefficients) == 75)  # fmt: skip


def test_two_clients_with_different_wishes(recorded):
    file, _ = recorded
    with (
        replayed(file) as (tcp, _, _),
        Client(("127.0.0.1", tcp)) as small,
        Client(("127.0.0.1", tcp)) as large,
    ):
        small.subscribe(sh_order=0, max_lights=0, kind=pb.SphericalHarmonics.TOTAL, number=1)
        large.subscribe(sh_order=4, max_lights=8, number=2)
        one = small.until(lambda e: e.subscription == 1)
        assert (len(one.sh.coefficients), len(one.lights)) == (3, 0)
        assert one.sh.kind == pb.SphericalHarmonics.TOTAL
        large.until(lambda e: e.subscription == 2 and len(e.sh.coefficients) == 75)


def test_what_is_cut_keeps_the_light():
    """Fewer lamps: the rest is in the SH. The total is the same."""
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(3, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    whole = pb.Estimate(sh=pb.SphericalHarmonics(kind=1, order=4, coefficients=rng.normal(size=75)))
    for number, direction in enumerate(directions):
        whole.lights.add(id=number + 1, direction=direction, irradiance=[3, 2, 1])
    total = cut(whole, pb.Subscription(kind=2, sh_order=4, max_lights=8)).sh.coefficients
    whole.lights[1].flags = 4  # an area light, which most clients do not want
    whole.key.CopyFrom(pb.Light(direction=[0, 1, 0], irradiance=[1, 2, 3]))
    total = cut(whole, pb.Subscription(kind=2, sh_order=4, max_lights=8)).sh.coefficients
    for key, areas, number in ((False, False, 2), (True, False, 2), (True, True, 3)):
        wish = pb.Subscription(sh_order=4, max_lights=8, key_light=key, area_lights=areas)
        part = cut(whole, wish)
        assert (part.HasField("key"), len(part.lights)) == (key, number)
        again = cut(part, pb.Subscription(kind=2, sh_order=4, max_lights=8)).sh.coefficients
        np.testing.assert_allclose(again, total, atol=1e-5)
    whole.lights[1].flags = 0
    whole.ClearField("key")
    total = cut(whole, pb.Subscription(kind=2, sh_order=4, max_lights=8)).sh.coefficients
    for most in range(4):
        part = cut(whole, pb.Subscription(sh_order=4, max_lights=most, number=7))
        assert (len(part.lights), part.subscription) == (most, 7)
        again = cut(part, pb.Subscription(kind=2, sh_order=4, max_lights=8)).sh.coefficients
        np.testing.assert_allclose(again, total, atol=1e-5)


def test_a_room_is_worth_less_to_sh_of_a_lower_order():
    whole = pb.Estimate(sh=pb.SphericalHarmonics(kind=1, order=4, coefficients=75 * [1]))
    room = pb.Room(walls_m=6 * [2], walls_sigma_m=6 * [0], orientation=[0, 0, 0, 1],
                   error_permille_per_m=10)  # fmt: skip
    whole.room.CopyFrom(room)
    for order, permille in ((4, 10), (2, 33), (0, 100)):
        part = cut(whole, pb.Subscription(sh_order=order))
        assert part.room.error_permille_per_m == permille
        assert part.room.walls_m == room.walls_m
    whole.room.error_permille_per_m = 200
    assert cut(whole, pb.Subscription(sh_order=1)).room.error_permille_per_m == 200
    whole.ClearField("room")
    assert not cut(whole, pb.Subscription(sh_order=1)).HasField("room")


def test_a_recording_cut_in_the_middle_is_used_as_far_as_it_goes(recorded, tmp_path):
    file, _ = recorded
    data = file.read_bytes()
    short = tmp_path / "short.mcap"
    for length in range(len(data) // 2, len(data), len(data) // 7):
        short.write_bytes(data[:length])
        messages, notes = [], []
        with contextlib.suppress(recording.LightprobeError):  # nothing whole is left
            messages = list(recording.read(short, notes))
        assert len(notes) == 1
        assert f"is cut off after {len(messages)} messages" in notes[0]
        assert "()" not in notes[0]
    short.write_bytes(data[: len(data) * 2 // 3])
    done = command("replay", short, "--once", "--speed", 100, "--publish",
                   f"tcp:127.0.0.1:{free_port()}")  # fmt: skip
    assert "Traceback" not in done.stderr
    assert done.returncode in (0, 1)


@pytest.fixture(scope="module")
def with_maps(tmp_path_factory):
    """A recording with reflection maps of 32 texels."""
    folder = tmp_path_factory.mktemp("maps")
    picture = np.full((64, 128, 3), 0.2, np.float32)
    picture[15:18, 94:98] = [400, 300, 200]  # 45° up, 90° to the right
    image.write_pfm(str(folder / "room.pfm"), picture)
    file = folder / "room.mcap"
    with Daemon(f"--source=file:{folder}/room.pfm?rate=30", "--reflection-map=64") as daemon:
        done = command("record", file, "--from", f"unix:{daemon.socket}", "--seconds", 3,
                       "--reflection-map", 32)  # fmt: skip
    assert done.returncode == 0, done.stderr
    return file


@pytest.mark.parametrize(
    ("kind", "lights", "size"), [("AMBIENT", 4, 32), ("AMBIENT", 0, 64), ("TOTAL", 4, 16)]
)
def test_reflection_maps_are_replayed_with_the_lamps_that_a_client_wants_in_them(
    with_maps, kind, lights, size
):
    """E(map) is E of the same light by SH and lamps, at normals all around."""
    wish = Subscription(
        sh_order=4, max_lights=lights, reflection_map_size=size, reflection_map_kind=kind,
        reflection_map_rate_hz=30,
    )  # fmt: skip
    with replayed(with_maps) as (tcp, _, _), ProbeClient(f"tcp:127.0.0.1:{tcp}", wish) as client:
        assert client.wait_for(lambda c: c.reflection_map and c.latest(), LONG_S)
        found, estimate = client.reflection_map, client.latest()
        assert client.hello.max_reflection_map_size == 32
    assert (found.size, found.kind) == (min(size, 32), kind)
    assert len(estimate.lights) == min(lights, 1)
    normals = np.eye(3)[[0, 1, 2, 0, 1, 2]] * [[1], [1], [1], [-1], [-1], [-1]]
    wanted = estimate.irradiance(normals)
    if kind == "AMBIENT":
        for light in estimate.lights:
            wanted = wanted - np.maximum(normals @ light.direction, 0)[:, None] * light.irradiance
    # Order 4 leaves out 2 % of a lamp's light; of 16 texels each is 6° wide.
    np.testing.assert_allclose(found.irradiance(normals), wanted, atol=0.05 * wanted.max())


def test_a_probe_without_reflection_maps_is_told(recorded, tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg())
    file = tmp_path / "x.mcap"
    with Daemon(f"--source=file:{tmp_path}/a.jpg?rate=30") as daemon:
        done = command("record", file, "--from", f"unix:{daemon.socket}", "--reflection-map", 16)
    assert done.returncode == 1
    assert "start lightprobed with --reflection-map=16" in done.stderr
    assert not file.exists()
    done = command("record", file, "--reflection-map", 17)
    assert "expected 0, 16, 32, 64" in done.stderr


@pytest.mark.parametrize(
    ("data", "text"), [(b"", "is no MCAP file"), (b"GIF89a" + bytes(99), "is no MCAP file")]
)
def test_what_is_no_recording_is_told(tmp_path, data, text):
    (tmp_path / "x.mcap").write_bytes(data)
    done = command("replay", tmp_path / "x.mcap")
    assert done.returncode == 1
    assert text in done.stderr
    assert "lightprobe record" in done.stderr


def test_a_recording_is_not_overwritten(recorded):
    file, _ = recorded
    before = file.read_bytes()
    done = command("record", file)
    assert done.returncode == 1
    assert "exists" in done.stderr
    assert file.read_bytes() == before


def test_without_a_probe_no_file_is_left(tmp_path):
    file = tmp_path / "nothing.mcap"
    done = command("record", file, "--from", f"tcp:127.0.0.1:{free_port()}")
    assert done.returncode == 1
    assert "nobody listens there" in done.stderr
    assert not file.exists()


def test_a_recorder_that_is_killed_leaves_what_it_had(tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg())
    file = tmp_path / "killed.mcap"
    with Daemon(f"--source=file:{tmp_path}/a.jpg?rate=100") as daemon:
        recorder = subprocess.Popen([LIGHTPROBE, "record", file, "--from",
                                     f"unix:{daemon.socket}"])  # fmt: skip
        try:
            wait_for(lambda: file.exists() and file.stat().st_size > 20_000, "nothing is written")
        finally:
            recorder.kill()
            recorder.wait()
    notes = []
    assert len(list(recording.read(file, notes))) > 20


def test_replay_stays_on_this_machine_and_refuses_other_pages(recorded):
    file, _ = recorded
    done = command("replay", file, "--publish", "tcp:0.0.0.0:7700")
    assert done.returncode == 1
    assert "this machine only" in done.stderr
    with replayed(file) as (_, web, _):
        with pytest.raises(InvalidStatus):
            connect(f"ws://127.0.0.1:{web}/", origin="https://evil.example")
        with connect(f"ws://127.0.0.1:{web}/", origin="http://127.0.0.1:7701",
                     subprotocols=["lightprobe.v1"]) as own:  # fmt: skip
            own.recv(LONG_S)


def test_a_full_disk_ends_the_recording_with_an_error_and_leaves_what_it_holds(tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg())
    file = tmp_path / "room.mcap"

    def little_room():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # as where it is not heeded: EFBIG
        resource.setrlimit(resource.RLIMIT_FSIZE, (8_000, 8_000))

    with Daemon(f"--source=file:{tmp_path}/a.jpg?rate=30") as daemon:
        done = command(
            "record", file, "--from", f"unix:{daemon.socket}", "--seconds", 600,
            preexec_fn=little_room,
        )  # fmt: skip
    assert done.returncode == 1
    assert f"{file}: write: File too large" in done.stderr
    assert "Traceback" not in done.stderr
    assert len(list(recording.read(file, []))) > 10


@pytest.mark.parametrize("raised", [OSError(errno.ENOSPC, "full"), ValueError("mine"),
                                    TimeoutError("mine"), ProbeError("mine")])  # fmt: skip
def test_what_a_callback_raises_reaches_its_owner_and_is_no_failure_of_the_network(
    recorded, raised
):
    def keep(payload):
        raise raised

    async def receive(uri):
        async with AsyncClient(uri, on_payload=keep) as client:
            with pytest.raises(type(raised)) as caught:
                await client.receive(LONG_S)
            assert client.statistics.failures == 0
        return caught.value

    with replayed(recorded[0]) as (tcp, _, _):
        assert asyncio.run(receive(f"tcp:127.0.0.1:{tcp}")) is raised


def test_a_request_that_is_no_subscription_leaves_the_wish_of_a_client_of_replay(recorded):
    with (
        replayed(recorded[0]) as (_, web, _),
        connect(f"ws://127.0.0.1:{web}/", subprotocols=["lightprobe.v1"]) as socket,
    ):
        wish = pb.FromClient()
        wish.subscribe.number = 7
        socket.send(wish.SerializeToString())
        for other in (pb.FromClient(ping=pb.Ping(time_ns=1)), pb.FromClient(),
                      pb.FromClient(take_stills=pb.TakeStills())):  # fmt: skip
            socket.send(other.SerializeToString())
        numbers = []
        while numbers[-30:] != [7] * 30 and len(numbers) < 200:
            message = pb.FromProbe.FromString(socket.recv(LONG_S))
            if message.HasField("estimate"):
                numbers.append(message.estimate.subscription)
    assert numbers[-30:] == [7] * 30


def test_ctrl_c_ends_replay_without_a_traceback_whoever_is_connected(recorded):
    port = free_port()
    process = subprocess.Popen(
        [LIGHTPROBE, "replay", recorded[0], "--publish", f"tcp:127.0.0.1:{port}"],
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert f":{port}" in process.stderr.readline()
    with Client(("127.0.0.1", port)) as client, ProbeClient(f"tcp:127.0.0.1:{port}") as other:
        client.next("hello")
        other.receive(LONG_S)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=LONG_S)
    assert said == ""


@pytest.mark.parametrize("compression", ["ZSTD", "LZ4", "NONE"])
def test_a_small_file_that_unpacks_to_much_is_refused_in_little_memory(tmp_path, compression):
    file = tmp_path / "bomb.mcap"
    with open(file, "wb") as stream:
        writer = Writer(stream, 1 << 30, compression=CompressionType[compression])
        writer.start(library="test")
        schema = writer.register_schema(recording.SCHEMA, "protobuf", b"")
        channel = writer.register_channel(recording.TOPIC, "protobuf", schema)
        for number in range(3):
            writer.add_message(channel, number, bytes(64 << 20), number, number)
        writer.finish()
    program = (
        "import resource, sys\n"
        "from lightprobe import recording\n"
        "from pathlib import Path\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "notes = []\n"
        "try:\n"
        "    list(recording.read(Path(sys.argv[1]), notes))\n"
        "except Exception as error:\n"
        "    notes.append(str(error))\n"
        "print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024, notes)\n"
    )
    done = subprocess.run([sys.executable, "-c", program, file], capture_output=True, text=True,
                          timeout=LONG_S, check=True)  # fmt: skip
    more_mib, said = done.stdout.split(" ", 1)
    assert int(more_mib) < 80, done.stdout
    assert "more than 16 MiB" in said or "limit" in said
