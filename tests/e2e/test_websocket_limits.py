"""ws: with clients that flood, that say nothing, and that read nothing."""

from __future__ import annotations

import contextlib
import socket

import pytest
from harness import LONG_S, Client, Daemon, camera, streaming, wait_for
from lightprobe.imaging import camera as lenses
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.faults import Faults
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription
from lightprobe_proto import lightprobe_pb2 as pb
from web_daemon import (
    GOOD,
    WebDaemon,
    free_port,
    handshake,
    read_all,
    receive,
    request,
    wait_closed,
)
from websockets.sync.client import connect


def load(address, path, source):
    """Bytes of a file that have come when the connection ends; 0: it was turned away at once."""
    size = 0
    with (
        contextlib.suppress(OSError),
        socket.create_connection(address, LONG_S, (source, 0)) as raw,
    ):
        raw.sendall(f"GET {path} HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n".encode())
        while data := raw.recv(1 << 20):
            size += len(data)
    return size


def test_who_loads_large_files_again_and_again_is_turned_away(tmp_path):
    """What is sent of them counts, not only that they were asked for. Others load them still."""
    folder = tmp_path / "page"
    folder.mkdir()
    with (folder / "large.js").open("wb") as file:
        file.truncate(64 << 20)
    with WebDaemon(folder=tmp_path, query=f"?root={folder}") as daemon:
        address = ("127.0.0.1", daemon.port)
        assert load(address, "/large.js", "127.0.0.1") > 64 << 20
        assert any(load(address, "/large.js", "127.0.0.1") < 64 << 20 for _ in range(64))
        assert load(address, "/large.js", "127.0.0.2") > 64 << 20
        assert daemon.alive()


def frame(opcode, data=b"", final=True):
    return bytes([opcode | final << 7, 0x80 | len(data), 0, 0, 0, 0]) + data


@pytest.mark.nightly_rows
@pytest.mark.parametrize(
    ("first", "flood"),
    [
        (b"", frame(9, bytes(125))),
        (b"", frame(9)),
        (b"", frame(10, bytes(125))),
        (b"", frame(10)),
        (frame(2, final=False), frame(0, final=False)),
    ],
    ids=["pings", "empty pings", "pongs", "empty pongs", "empty fragments"],
)
def test_frames_that_are_no_requests_are_counted(tmp_path, first, flood):
    """The library answers them by itself: what has come counts."""
    with WebDaemon(folder=tmp_path) as daemon:
        with socket.create_connection(("127.0.0.1", daemon.port), LONG_S) as raw:
            raw.sendall(handshake(b"\r\n"))
            assert b" 101 " in read_all(raw)
            raw.sendall(first)
            many = flood * ((100 << 20) // len(flood))
            with pytest.raises(ConnectionError):
                raw.sendall(many)
        daemon.wait_log("far more than an app does")
        other = socket.create_connection(("127.0.0.1", daemon.port), LONG_S, ("127.0.0.9", 0))
        with contextlib.closing(other):
            other.sendall(handshake(b"\r\n"))
            assert b" 101 " in read_all(other)


# ---------------------------------------------------------------- quotas, slow clients


def test_one_address_has_its_share(tmp_path):
    with WebDaemon(folder=tmp_path, query="?per_peer=2") as daemon:
        with daemon.open() as first, daemon.open() as second:
            receive(first, "estimate"), receive(second, "estimate")
            with daemon.open() as third:
                assert "raise ?per_peer=" in receive(third).text
                assert wait_closed(third)[0] == 1008
            receive(first, "estimate")
        # Room again, as soon as the daemon has seen that they have gone.
        wait_for(lambda: admitted(daemon), "no room for another client")


def admitted(daemon):
    with daemon.open() as web:
        return isinstance(receive(web), pb.Hello)


def test_connections_that_say_nothing_do_not_lock_others_out(tmp_path):
    with WebDaemon(folder=tmp_path) as daemon, contextlib.ExitStack() as stack:
        silent = [
            stack.enter_context(socket.create_connection(("127.0.0.1", daemon.port), LONG_S))
            for _ in range(100)
        ]
        # Of one address the newest 32 without a WebSocket stay; they end after 5 s.
        daemon.wait_log("127.0.0.1: it has too many handshakes under way")
        with daemon.open() as web:  # the oldest has made room
            receive(web, "estimate")
        with Client(daemon.local) as local:
            local.next("estimate")
        wait_for(lambda: still_open(silent) == 0, "silent connections stay open")
        with daemon.open() as web:
            receive(web, "estimate")


def still_open(connections):
    count = 0
    for connection in connections:
        connection.setblocking(False)
        try:
            count += connection.recv(1) != b""
        except BlockingIOError:
            count += 1
        except ConnectionError:
            pass
    return count


@pytest.mark.nightly
def test_a_client_that_reads_nothing_for_seconds_gets_the_newest_and_disturbs_nobody():
    with camera() as cam:
        port = free_port()
        with Daemon(f"--source=sim:{cam.path}", f"--publish=ws:127.0.0.1:{port}",
                    "--publish=tcp:127.0.0.1:0") as daemon:  # fmt: skip
            cam.accept()
            raw = socket.socket()
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
            raw.connect(("127.0.0.1", port))
            raw.sendall(handshake(b"\r\n"))
            large = request(sh_order=4, max_lights=8)  # fills the kernel's buffers sooner
            raw.sendall(bytes([0x82, 0x80 | len(large), 0, 0, 0, 0]) + large)
            with (
                streaming(cam, GOOD, rate_hz=200),
                connect(f"ws://127.0.0.1:{port}/", open_timeout=LONG_S) as awake,
            ):
                awake.send(request(sh_order=4, max_lights=8, health_period_ms=100))
                wait_for(lambda: receive(awake, "health").packets_superseded > 20,
                         "the sleeping tab loses nothing")  # fmt: skip
                before = receive(awake, "estimate").sequence
                numbers = messages_of(raw)
            assert numbers == sorted(set(numbers))
            assert max(numbers) >= before - 1, "the newest has not come"
            assert daemon.alive()


def test_an_hour_of_simulated_time_in_which_a_client_reads_nothing(released_daemon):
    """As of a tab that sleeps. The camera is silent: one estimate a second, repeated."""
    world = World(scenes.load(["room"]), Behaviour(act_s=0), 30.0)
    view = SimulatedCamera(world, lenses.load("equirect"), (320, 160))
    port, wish = free_port(), Subscription(max_lights=8, sh_order=4, health_period_ms=1000)
    silence = Faults(stall_after=30, stall_s=2 * 3600.0)
    with LiveProbe(view, [f"--publish=ws:127.0.0.1:{port}"], faults=silence) as probe:
        awake = probe.client(wish)
        raw = socket.socket()
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        raw.connect(("127.0.0.1", port))
        raw.sendall(handshake(b"\r\n"))
        probe.run(120)
        assert awake.health.clients == 2
        before_kib = awake.health.rss_kib
        probe.run(3600)
        assert awake.health.clients == 2
        assert awake.health.packets_superseded > 3000
        assert awake.health.rss_kib < before_kib + 1024
        assert len(awake.estimates) > 3600  # the one that reads has missed nothing
        numbers = messages_of(raw, lambda: probe.run(0.1))
    assert numbers == sorted(numbers)
    assert numbers[-1] == awake.estimates[-1].sequence, "the newest has not come"


def messages_of(raw, meanwhile=lambda: None):
    """Sequence numbers of the estimates that lie in a connection that wakes up now."""
    raw.settimeout(2)
    meanwhile()
    raw.settimeout(2)
    data = b""
    with contextlib.suppress(TimeoutError):
        while len(data) < 1 << 20 and (piece := raw.recv(65536)):
            data += piece
            meanwhile()
    data = data[data.index(b"\r\n\r\n") + 4 :]
    numbers = []
    while len(data) >= 4:
        size, start = data[1], 2
        if size == 126:
            size, start = int.from_bytes(data[2:4], "big"), 4
        if len(data) < start + size:  # no more of it was read
            break
        message = pb.FromProbe.FromString(data[start : start + size])
        data = data[start + size :]
        if message.WhichOneof("message") == "estimate":
            numbers.append(message.estimate.sequence)
    raw.close()
    return numbers


def test_the_daemon_ends_while_clients_are_connected(tmp_path):
    with WebDaemon(folder=tmp_path) as daemon, contextlib.ExitStack() as stack:
        for _ in range(5):
            receive(stack.enter_context(daemon.open()), "estimate")
        silent = stack.enter_context(socket.create_connection(("127.0.0.1", daemon.port), LONG_S))
        silent.sendall(b"GET / HT")
        assert daemon.stop() == 0  # the sanitizer looks for leaks
