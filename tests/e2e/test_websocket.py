"""ws: and wss: with a real WebSocket client, and with clients that break every rule."""

from __future__ import annotations

import base64
import contextlib
import datetime
import json
import os
import shutil
import socket
import ssl
import subprocess
import sys
import time
import urllib.request
import zipfile
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from harness import BUILD, LONG_S, Client, Daemon, camera, jpeg, run, streaming, wait_for
from lightprobe import Client as ProbeClient
from lightprobe.errors import ProbeTimeout
from lightprobe.imaging import camera as lenses
from lightprobe.sim import scenes
from lightprobe.sim.camera import SimulatedCamera
from lightprobe.sim.faults import Faults
from lightprobe.sim.live import LiveProbe
from lightprobe.sim.world import Behaviour, World
from lightprobe.wire import Subscription
from lightprobe_proto import lightprobe_pb2 as pb
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

GOOD = jpeg()
PROTOCOL = "lightprobe.v1"
LIGHTPROBE = BUILD / "venv" / "bin" / "lightprobe"


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


class WebDaemon(Daemon):
    """A daemon on ws: and on a Unix socket, for comparison."""

    def __init__(self, *arguments, query="", folder, **popen):
        picture = folder / "a.jpg"
        picture.write_bytes(GOOD)
        self.port = free_port()
        self.local = folder / "probe"
        super().__init__(
            f"--source=file:{picture}?rate=30",
            f"--publish=ws:127.0.0.1:{self.port}{query}",
            f"--publish=unix:{self.local}?per_peer=4096",
            *arguments,
            **popen,
        )

    def wait_log(self, text):
        super().wait_log("listen: ready" if text == "listen: " else text)

    def open(self, **options):
        """A real client's connection."""
        options = {"subprotocols": [PROTOCOL], "open_timeout": LONG_S} | options
        return connect(f"ws://127.0.0.1:{self.port}/", **options)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    (folder / "index.html").write_text("<h1>light</h1>")
    (folder / "app.js").write_text("let a;")
    (folder.parent / "secret").write_text("not part of the page")
    return folder


@pytest.fixture(scope="module")
def probe(tmp_path_factory, page):
    """One daemon for all of them: whatever one test does to it, the next must not notice."""
    folder = tmp_path_factory.mktemp("probe")
    with WebDaemon(folder=folder, query=f"?root={page}&origins=https://app.example") as daemon:
        yield daemon
        assert daemon.alive()


def receive(connection, kind=None):
    """The next message (of this kind)."""
    end = time.monotonic() + LONG_S
    while time.monotonic() < end:
        data = connection.recv(LONG_S)
        assert isinstance(data, bytes)
        message = pb.FromProbe.FromString(data)
        found = message.WhichOneof("message")
        if kind in (None, found):
            return getattr(message, found)
    raise AssertionError(f"no {kind}")


def request(**wanted):
    return pb.FromClient(subscribe=pb.Subscription(**wanted)).SerializeToString()


def wait_closed(connection):
    with contextlib.suppress(ConnectionClosed):
        while True:
            connection.recv(LONG_S)
    return connection.close_code, connection.close_reason


# ---------------------------------------------------------------- what they get


def test_the_same_messages_as_binary_frames(probe):
    with probe.open() as web, Client(probe.local) as local:
        assert web.subprotocol == PROTOCOL
        hello, reference = receive(web), local.next()
        assert hello == reference
        assert hello.name == socket.gethostname()[:63]
        assert not hello.insecure_lan
        web.send(request(sh_order=4, max_lights=8, number=3))
        local.subscribe(sh_order=4, max_lights=8, number=3)
        of_web = {}
        for _ in range(60):
            estimate = receive(web, "estimate")
            of_web[estimate.sequence] = estimate
        same = [local.until(lambda e: e.sequence in of_web and e.subscription == 3)
                for _ in range(5)]  # fmt: skip
        for estimate in same:
            other = of_web[estimate.sequence]
            # Each packet has the time of capture by both clocks as they stand when it is made.
            assert abs(other.capture_time_unix_ns - estimate.capture_time_unix_ns) < 1_000_000
            other.capture_time_unix_ns = estimate.capture_time_unix_ns
            other.send_delay_us = estimate.send_delay_us
            assert other == estimate


def test_each_has_its_own_subscription(probe):
    with probe.open() as small, probe.open() as large:
        small.send(request(sh_order=0, max_lights=0, number=1))
        large.send(request(sh_order=4, max_lights=8, number=2))
        for connection, number, coefficients in ((small, 1, 3), (large, 2, 75)):
            # The first answer may come before the higher order has been computed.
            while (estimate := receive(connection, "estimate")).subscription != number or (
                len(estimate.sh.coefficients) != coefficients
            ):
                assert estimate.subscription in (0, number)


def test_a_fragmented_request_is_one(probe):
    whole = request(sh_order=3, number=9)
    with probe.open() as web:
        web.send([whole[:1], whole[1:3], whole[3:]])
        while receive(web, "estimate").subscription != 9:
            pass


def test_pings_are_answered(probe):
    with probe.open() as web:
        assert web.ping().wait(LONG_S)


def test_the_python_client(probe):
    with ProbeClient(f"ws://127.0.0.1:{probe.port}/") as client:
        first, second = client.receive(LONG_S), client.receive(LONG_S)
        assert second.sequence > first.sequence
        assert client.hello is not None
    with ProbeClient(f"http://127.0.0.1:{probe.port}/index.html") as client:  # the page's address
        client.receive(LONG_S)


def test_a_message_longer_than_any_other(tmp_path):
    """A map of polarized light, of 58 kB: in one frame."""
    with (
        WebDaemon(
            "--rotator=sim:", "--polarizer=sweep", "--publish-polarization", folder=tmp_path
        ) as probe,
        ProbeClient(f"ws://127.0.0.1:{probe.port}/") as client,
    ):
        for _ in range(3):
            assert client.polarization(LONG_S).s0.shape == (60, 120)
        assert client.last_error is None


# ---------------------------------------------------------------- files


def get(port, path, **headers):
    request = urllib.request.Request(f"http://127.0.0.1:{port}{path}", headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=LONG_S) as answer:
            return answer.status, answer.headers, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read().decode()


def test_the_page_is_served_and_may_load_nothing_else(probe):
    status, headers, text = get(probe.port, "/")
    assert (status, text) == (200, "<h1>light</h1>")
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "script-src 'self';" in policy
    assert "frame-ancestors 'none'" in policy
    assert headers["x-content-type-options"] == "nosniff"
    status, headers, text = get(probe.port, "/app.js")
    assert (status, headers["content-type"], text) == (200, "text/javascript", "let a;")


@pytest.mark.parametrize(
    "path", ["/nothing", "/../secret", "/%2e%2e/secret", "/..%2fsecret", "//etc/passwd"]
)
def test_no_other_file_is_served(probe, path):
    with socket.create_connection(("127.0.0.1", probe.port), LONG_S) as raw:
        raw.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        answer = read_all(raw)
    assert b" 200 " not in answer.partition(b"\r\n")[0]
    assert b"not part" not in answer
    assert b"root:" not in answer


def spoil_page(folder):
    """Put into a page's folder whatever is no file of it; returns the paths."""
    outside = folder.parent / "outside"
    outside.mkdir()
    (outside / "index.html").write_text("not part of the page")
    (folder / "index.html").write_text("page")
    (folder / "below").mkdir()
    (folder / "below" / "a.txt").write_text("below")
    os.mkfifo(folder / "fifo")
    os.mkfifo(folder / "below" / "fifo.js")
    (folder / "link").symlink_to(outside / "index.html")
    (folder / "linked").symlink_to(outside)
    (folder / "inside").symlink_to(folder / "below" / "a.txt")
    (folder / "null").symlink_to("/dev/null")
    (folder / "tty").symlink_to("/dev/tty")
    (folder / "loop").symlink_to(folder / "loop")
    (folder / "empty").mkdir()
    for name, make in (("piped", os.mkfifo), ("aliased", lambda p: p.symlink_to("../index.html"))):
        (folder / name).mkdir()
        make(folder / name / "index.html")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(folder / "socket"))
    with zipfile.ZipFile(folder / "a.zip", "w") as packed:
        packed.writestr("a.txt", "not part of the page")
    return ["/fifo", "/below/fifo.js", "/fifo/", "/link", "/linked/index.html", "/linked/",
            "/inside", "/null", "/tty", "/loop", "/empty/", "/piped/", "/aliased/", "/socket",
            "/a.zip/a.txt", "/index.html/below", "/" + "a" * 300,
            "/below/../../outside/index.html"]  # fmt: skip


def test_what_is_no_regular_file_below_the_root_is_not_there(tmp_path):
    """And asking for it takes no time: opening a FIFO waits until somebody writes into it."""
    folder = tmp_path / "page"
    folder.mkdir()
    paths = spoil_page(folder)
    with WebDaemon(folder=tmp_path, query=f"?root={folder}") as daemon:
        for path in paths:
            with socket.create_connection(("127.0.0.1", daemon.port), LONG_S) as raw:
                raw.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
                answer = read_all(raw)
            assert b" 404 " in answer.partition(b"\r\n")[0], (path, answer)
            assert b"not part" not in answer, path
        assert get(daemon.port, "/")[::2] == (200, "page")
        assert get(daemon.port, "/below/a.txt")[::2] == (200, "below")
        with daemon.open() as web:
            receive(web, "estimate")


def test_a_page_that_is_built_again_is_served(tmp_path):
    folder = tmp_path / "page"
    folder.mkdir()
    (folder / "index.html").write_text("old")
    with WebDaemon(folder=tmp_path, query=f"?root={folder}") as daemon:
        assert get(daemon.port, "/")[2] == "old"
        shutil.rmtree(folder)
        assert get(daemon.port, "/")[0] == 404
        folder.mkdir()
        (folder / "index.html").write_text("new")
        assert get(daemon.port, "/")[2] == "new"


def test_without_a_page_the_answer_says_how_to_have_one(tmp_path):
    with WebDaemon(folder=tmp_path) as daemon:
        status, _, text = get(daemon.port, "/")
        assert status == 404
        assert "?root=" in text
        with daemon.open() as web:
            receive(web, "estimate")


# ---------------------------------------------------------------- who may not


def handshake(extra=b"", host="127.0.0.1"):
    key = base64.b64encode(os.urandom(16))
    return (
        f"GET / HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key.decode()}\r\n"
    ).encode() + extra


def read_all(raw):
    raw.settimeout(LONG_S)
    data = b""
    with contextlib.suppress(ConnectionError):
        while piece := raw.recv(65536):
            data += piece
            if b" 101 " in data:
                break
    return data


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1"])
def test_a_page_of_another_origin_gets_nothing(probe, origin):
    with pytest.raises(InvalidStatus) as refused:
        probe.open(origin=origin)
    assert refused.value.response.status_code == 403
    assert "?origins=" in refused.value.response.body.decode()
    probe.wait_log(f"refused: a page of {origin}")


def test_own_and_allowed_origins(probe):
    for origin in (f"http://127.0.0.1:{probe.port}", "https://app.example"):
        with probe.open(origin=origin) as web:
            receive(web, "estimate")


def test_a_name_that_a_stranger_points_here_gets_nothing(probe):
    """DNS rebinding: Origin and Host agree, and both are the stranger's."""
    with socket.create_connection(("127.0.0.1", probe.port), LONG_S) as raw:
        name = f"evil.example:{probe.port}"
        raw.sendall(handshake(f"Origin: http://{name}\r\n\r\n".encode(), name))
        answer = read_all(raw)
    assert answer.startswith(b"HTTP/1.1 403 ")
    assert b"its address or its own name" in answer


@pytest.mark.parametrize("header", [b"Origin: http://", b"Host: "])
def test_what_strangers_send_obeys_the_log(probe, header):
    """No escape sequence, title or colour of theirs reaches a terminal that shows it."""
    text = b"\x1b]0;owned\x07\x1b[2J\xc2\x9b31m\xe2\x80\xaex-" + header[:4]
    key = base64.b64encode(os.urandom(16))
    rest = b"" if header == b"Host: " else b"Host: 127.0.0.1\r\n"
    with socket.create_connection(("127.0.0.1", probe.port), LONG_S) as raw:
        raw.sendall(
            b"GET / HTTP/1.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: " + key + b"\r\n" + rest + header
            + text + b"\r\n\r\n"
        )  # fmt: skip
        assert b" 403 " in read_all(raw)
    probe.wait_log("]0;owned  [2J?31m?x-" + header[:4].decode())
    assert not set(probe.log()) & {"\x1b", "\x07", "\x9b", "\u202e"}


# ---------------------------------------------------------------- nonsense


@pytest.mark.parametrize(
    ("sent", "code", "text"),
    [
        ("a text frame", -90, "requests are binary protobuf"),
        (b"\xff\xff\xff", -74, "is no lightprobe.v1.FromClient message"),
        (bytes(257), -90, "longer than a request may be"),
        (bytes(1 << 20), -90, "longer than a request may be"),
    ],
    ids=["text", "garbage", "long", "huge"],
)
def test_what_makes_no_sense_is_answered_and_ended(probe, sent, code, text):
    with probe.open() as web:
        receive(web, "estimate")
        with contextlib.suppress(ConnectionClosed):
            web.send(sent)
        error = receive(web, "error")
        assert (error.code, text in error.text) == (code, True)
        assert wait_closed(web)[0] == 1008
    with probe.open() as web:
        receive(web, "estimate")


@pytest.mark.parametrize(
    "headers",
    [
        b"".join(b"X-%d: y\r\n" % i for i in range(10_000)) + b"\r\n",
        b"X: " + b"y" * 1_000_000 + b"\r\n\r\n",
        b"Origin: http://" + b"y" * 3000 + b"\r\n\r\n",
        b"Origin: http://evil.example\r\nOrigin: http://127.0.0.1\r\n\r\n",
        b"\0\xff\r\n\r\n",
    ],
    ids=["10 000 headers", "a long header", "a long origin", "two origins", "no text"],
)
def test_headers_that_no_browser_sends(probe, headers):
    with socket.create_connection(("127.0.0.1", probe.port), LONG_S) as raw:
        with contextlib.suppress(ConnectionError):
            raw.sendall(handshake(headers))
        assert b" 101 " not in read_all(raw)
    with probe.open() as web:
        receive(web, "estimate")


@pytest.mark.parametrize(
    "frame",
    [
        b"\x82\x05hello",  # not masked
        b"\xf2\x80\0\0\0\0",  # reserved bits
        b"\x83\x80\0\0\0\0",  # unknown opcode
        b"\x82\xff\x7f\xff\xff\xff\xff\xff\xff\xff\0\0\0\0",  # 2^63 bytes are said to come
        b"\x89\xfe\x01\x00\0\0\0\0" + bytes(256),  # a ping that is too long
        os.urandom(4096),
    ],
    ids=["unmasked", "reserved", "opcode", "2^63", "ping", "random"],
)
def test_frames_that_break_the_protocol(probe, frame):
    with socket.create_connection(("127.0.0.1", probe.port), LONG_S) as raw:
        raw.sendall(handshake(b"\r\n"))
        assert b" 101 " in read_all(raw)
        raw.sendall(frame)
        time.sleep(0.05)
    with probe.open() as web:
        receive(web, "estimate")
        assert probe.alive()


def test_a_flood_of_requests_ends_with_its_connection(probe):
    with probe.open() as web:
        with contextlib.suppress(ConnectionClosed):
            for _ in range(200):
                web.send(request(sh_order=1))
        assert "more than 50 in a second" in receive(web, "error").text
        wait_closed(web)


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


# ---------------------------------------------------------------- TLS and token


def make_pair(folder, *arguments):
    done = subprocess.run(
        [LIGHTPROBE, "pair", "--dir", folder, "--json", *arguments],
        capture_output=True, text=True, timeout=LONG_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def wss(folder, port, pair):
    picture = folder / "a.jpg"
    picture.write_bytes(GOOD)
    return (f"--source=file:{picture}?rate=30", f"--publish=wss:127.0.0.1:{port}?pair={pair}")


def refusal_of(url):
    with ProbeClient(url) as client, pytest.raises(ProbeTimeout) as refused:
        client.receive(3)
    return str(refused.value)


def test_with_the_address_of_pair_the_light_comes_without_it_nothing(tmp_path):
    port, pair = free_port(), tmp_path / "pair"
    url = make_pair(pair, "--host", "127.0.0.1", "--port", str(port))["url"]
    with Daemon(*wss(tmp_path, port, pair)) as daemon:
        with ProbeClient(url) as client:
            client.receive(LONG_S)
            assert client.hello is not None
            assert not client.hello.insecure_lan
            assert "token" not in client.uri  # it stands in messages
        token = url.split("token=")[1].split("&")[0]
        assert "the token is missing or wrong" in refusal_of(url.replace(token, token[:-1] + "!"))
        assert "the token is missing or wrong" in refusal_of(url.replace(f"token={token}&", ""))
        assert token not in daemon.log()
        other = make_pair(tmp_path / "other", "--host", "127.0.0.1")["sha256"].replace(":", "")
        wrong = refusal_of(url.split("sha256=")[0] + "sha256=" + other)
        assert "is not the one of the address" in wrong
        assert "sha256=" in refusal_of(f"wss://127.0.0.1:{port}/")


def test_after_a_new_pairing_the_old_address_is_worth_nothing(tmp_path):
    port, pair = free_port(), tmp_path / "pair"
    arguments = ("--host", "127.0.0.1", "--port", str(port))
    old = make_pair(pair, *arguments)["url"]
    assert make_pair(pair, *arguments)["url"] == old  # found, not made
    new = make_pair(pair, *arguments, "--new")["url"]
    with Daemon(*wss(tmp_path, port, pair)):
        with ProbeClient(new) as client:
            client.receive(LONG_S)
        assert "is not the one of the address" in refusal_of(old)
        replayed = new.replace(new.split("token=")[1].split("&")[0],
                               old.split("token=")[1].split("&")[0])  # fmt: skip
        assert "the token is missing or wrong" in refusal_of(replayed)


def test_key_and_token_are_for_their_owner_alone(tmp_path):
    make_pair(tmp_path / "pair")
    for name in ("key.pem", "token"):
        assert (tmp_path / "pair" / name).stat().st_mode & 0o777 == 0o600


def expire(pair, in_s=-86400, begins_in_s=-9 * 86400):
    """Give the pair a certificate that expires in so many seconds: yesterday."""
    key = serialization.load_pem_private_key((pair / "key.pem").read_bytes(), None)
    name, now = x509.Name([]), datetime.datetime.now(datetime.UTC)
    end = now + datetime.timedelta(seconds=in_s)
    old = (
        x509.CertificateBuilder().subject_name(name).issuer_name(name).serial_number(1)
        .public_key(key.public_key())
        .not_valid_before(now + datetime.timedelta(seconds=begins_in_s)).not_valid_after(end)
        .add_extension(x509.SubjectAlternativeName([x509.DNSName("probe")]), False)
        .sign(key, hashes.SHA256())
    )  # fmt: skip
    (pair / "certificate.pem").write_bytes(old.public_bytes(serialization.Encoding.PEM))


def other_key(pair):
    make_pair(pair.parent / "other")
    shutil.copy(pair.parent / "other" / "key.pem", pair / "key.pem")


SPOILT = {
    "other key": (other_key, "belongs to another certificate — make it with lightprobe pair"),
    "no key": (lambda p: (p / "key.pem").unlink(), "No such file"),
    "key is a FIFO": (lambda p: ((p / "key.pem").unlink(), os.mkfifo(p / "key.pem")), "is no file"),
    "no token": (lambda p: (p / "token").write_text("\n"), "holds no token"),
    "short token": (lambda p: (p / "token").write_text("secret\n"), "holds no token"),
    "no certificate": (lambda p: (p / "certificate.pem").write_text("x"), "holds no certificate"),
}


@pytest.mark.parametrize("how", SPOILT)
def test_a_spoilt_pair_is_told_at_the_start(tmp_path, how):
    spoil, text = SPOILT[how]
    make_pair(tmp_path / "pair")
    spoil(tmp_path / "pair")
    status, _, log = run(*wss(tmp_path, free_port(), tmp_path / "pair"))
    assert status == 2
    assert text in log
    assert str(tmp_path / "pair") in log


def has_fault(client, id):
    return client.health and any(fault.id == id for fault in client.health.faults)


@pytest.mark.parametrize("when", ["not yet", "expired"])
def test_a_certificate_that_is_not_valid_now_keeps_one_publisher_waiting(tmp_path, when):
    """As on a machine without a clock of its own. The others serve, and it begins by itself."""
    port, pair, local = free_port(), tmp_path / "pair", tmp_path / "probe"
    make_pair(pair)
    expire(pair, *((86400, 8) if when == "not yet" else (-86400,)))
    url = make_pair(tmp_path / "new", "--port", str(port), "--host", "127.0.0.1")["url"]
    arguments = (*wss(tmp_path, port, pair), f"--publish=unix:{local}")
    with Daemon(*arguments) as daemon, ProbeClient(f"unix:{local}") as near:
        near.receive(LONG_S)
        wait_for(lambda: has_fault(near, "publisher-waits"), "no fault")
        assert f"{pair}/certificate.pem: the certificate" in daemon.log()
        if when == "expired":
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection(("127.0.0.1", port), LONG_S)
            for name in ("key.pem", "token", "certificate.pem"):
                shutil.copy(tmp_path / "new" / name, pair / name)
        else:
            fingerprint = make_pair(pair)["sha256"].replace(":", "")
            token = (pair / "token").read_text().strip()
            url = f"wss://127.0.0.1:{port}/#token={token}&sha256={fingerprint}"
        daemon.wait_log("certificate: SHA-256")
        with ProbeClient(url) as client:
            client.receive(LONG_S)
        wait_for(lambda: not has_fault(near, "publisher-waits"), "the fault stays")


def test_a_pair_that_is_made_anew_is_taken_without_a_restart(tmp_path):
    """Clients that are connected stay. What cannot be used changes nothing."""
    port, pair = free_port(), tmp_path / "pair"
    arguments = ("--host", "127.0.0.1", "--port", str(port))
    old = make_pair(pair, *arguments)["url"]
    with Daemon(*wss(tmp_path, port, pair)) as daemon, ProbeClient(old) as stays:
        stays.receive(LONG_S)
        good = (pair / "certificate.pem").read_bytes()
        (pair / "certificate.pem").write_text("nonsense")
        daemon.wait_log("holds no certificate")
        with ProbeClient(old) as client:
            client.receive(LONG_S)
        (pair / "certificate.pem").write_bytes(good)
        made = make_pair(pair, *arguments, "--new")
        daemon.wait_log(f"certificate: SHA-256 {made['sha256']}")
        with ProbeClient(made["url"]) as client:
            client.receive(LONG_S)
        assert "is not the one of the address" in refusal_of(old)
        stays.receive(LONG_S)
        assert stays.statistics.failures == 0


def try_token(port, token, address="127.0.0.1"):
    """The first message that a client with this token gets, from this address."""
    raw = socket.create_connection(("127.0.0.1", port), LONG_S, (address, 0))
    with connect(
        f"wss://127.0.0.1:{port}/", sock=raw, ssl=unverified(), open_timeout=LONG_S,
        subprotocols=[PROTOCOL, f"token.{token}"],
    ) as web:  # fmt: skip
        return receive(web)


def test_who_tries_tokens_has_to_wait_and_nobody_else(tmp_path):
    port, pair = free_port(), tmp_path / "pair"
    make_pair(pair)
    good = (pair / "token").read_text().strip()
    with Daemon(*wss(tmp_path, port, pair)) as daemon:
        while "wait ten seconds" not in (text := try_token(port, "a" * 32).text):
            assert "the token is missing or wrong — open the address" in text
        assert isinstance(try_token(port, good, "127.0.0.9"), pb.Hello)
        daemon.wait_log("127.0.0.1: it has sent wrong tokens; none of its tokens counts")
        wait_for(lambda: isinstance(try_token(port, good), pb.Hello), "it waits for ever")


@pytest.mark.parametrize("name", ["key.pem", "token"])
def test_a_secret_that_everybody_can_read_is_told(tmp_path, name):
    port, pair = free_port(), tmp_path / "pair"
    make_pair(pair)
    (pair / name).chmod(0o644)
    with Daemon(*wss(tmp_path, port, pair)) as daemon:
        assert f"{pair}/{name}: every user of this machine can read it — chmod 600" in daemon.log()
        assert daemon.log().count("every user") == 1


def test_ciphers_of_yesterday_are_refused(tmp_path):
    port, pair = free_port(), tmp_path / "pair"
    make_pair(pair)
    with Daemon(*wss(tmp_path, port, pair)):
        for ciphers, is_good in (("ECDHE+AESGCM", True), ("AES128-SHA:ECDHE+AES+SHA1", False)):
            context = unverified()
            context.maximum_version = ssl.TLSVersion.TLSv1_2
            context.set_ciphers(ciphers)
            with socket.create_connection(("127.0.0.1", port), LONG_S) as raw:
                if is_good:
                    assert "GCM" in context.wrap_socket(raw).cipher()[0]
                else:
                    with pytest.raises((ssl.SSLError, ConnectionError)):
                        context.wrap_socket(raw)


def test_pair_says_when_its_certificate_has_expired(tmp_path):
    make_pair(tmp_path / "pair")
    expire(tmp_path / "pair")
    done = subprocess.run([LIGHTPROBE, "pair", "--dir", tmp_path / "pair"], capture_output=True,
                          text=True, timeout=LONG_S)  # fmt: skip
    assert done.returncode == 1
    assert "expired on" in done.stderr
    assert "--new" in done.stderr


def test_a_certificate_that_ends_while_the_daemon_runs(tmp_path):
    """Health and log say so before and after; who knows the fingerprint still gets the light."""
    port, pair = free_port(), tmp_path / "pair"
    arguments = ("--host", "127.0.0.1", "--port", str(port))
    make_pair(pair, *arguments)
    expire(pair, in_s=20)
    url = make_pair(pair, "--port", str(port))["url"].replace("//probe:", "//127.0.0.1:")

    def told(client, text):
        faults = client.health.faults if client.health else ()
        return any(fault.id == "certificate-expires" and text in fault.text for fault in faults)

    with Daemon(*wss(tmp_path, port, pair)) as daemon, ProbeClient(url) as client:
        wait_for(lambda: told(client, "expires within 14 days"), "no warning")
        wait_for(lambda: told(client, "has expired: browsers refuse it"), "no fault")
        daemon.wait_log("certificate: the certificate has expired")
        client.receive(LONG_S)
        with ProbeClient(url) as late:
            late.receive(LONG_S)


def test_pair_prints_address_fingerprint_and_a_qr_code(tmp_path):
    done = subprocess.run([LIGHTPROBE, "pair", "--dir", tmp_path / "pair", "--host", "probe.local"],
                          capture_output=True, text=True, timeout=LONG_S)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "https://probe.local:7702/#token=" in done.stdout
    assert "SHA-256" in done.stdout
    assert "▀" in done.stdout


# ---------------------------------------------------------------- the network


def unverified():
    """TLS as of a browser whose user has clicked the warning away."""
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


@pytest.mark.parametrize("uri", ["tcp:0.0.0.0:7700", "ws:0.0.0.0:7701", "ws:[::]:7701"])
def test_nothing_unencrypted_beyond_this_machine(tmp_path, uri):
    (tmp_path / "a.jpg").write_bytes(GOOD)
    status, _, log = run(f"--source=file:{tmp_path}/a.jpg", f"--publish={uri}")
    assert status == 2
    assert "without encryption — publish on wss:" in log


def test_insecure_lan_is_told_to_all(tmp_path):
    (tmp_path / "a.jpg").write_bytes(GOOD)
    port = free_port()
    with Daemon(f"--source=file:{tmp_path}/a.jpg?rate=30", f"--publish=tcp:0.0.0.0:{port}",
                "--insecure-lan") as daemon:  # fmt: skip
        with ProbeClient(f"tcp:127.0.0.1:{port}") as client:
            client.receive(LONG_S)
            assert client.hello.insecure_lan
            wait_for(lambda: client.health, "no health")
            assert [fault.id for fault in client.health.faults] == ["insecure-lan"]
        assert "anyone on the network can read the light" in daemon.log()


def test_insecure_lan_alone_opens_nothing(tmp_path):
    with WebDaemon("--insecure-lan", folder=tmp_path) as daemon, daemon.open() as web:
        assert not receive(web).insecure_lan


def test_from_another_address_only_with_the_token(tmp_path):
    """In a network namespace of its own, so that an address beyond loopback exists everywhere."""
    script = Path(__file__).with_name("websocket_network.py")
    command = ["unshare", "--user", "--map-root-user", "--net", sys.executable, script, tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, timeout=2 * LONG_S)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines() == [
        "with the address of pair: an estimate",
        "without token: refused",
        "a page of another origin: 403",
        "tcp: beyond loopback: status 2",
    ]
