"""ws: with a real WebSocket client, and with clients that break every rule."""

from __future__ import annotations

import base64
import contextlib
import os
import shutil
import socket
import time
import urllib.request
import zipfile

import pytest
from harness import LONG_S, Client
from lightprobe import Client as ProbeClient
from web_daemon import PROTOCOL, WebDaemon, handshake, read_all, receive, request, wait_closed
from websockets.exceptions import ConnectionClosed, InvalidStatus


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


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1"])
def test_a_page_of_another_origin_gets_nothing(tmp_path, page, origin):
    """Each by a daemon of its own: a log that has told this lately tells it again much later."""
    query = f"?root={page}&origins=https://app.example"
    with WebDaemon(folder=tmp_path, query=query) as probe:
        with pytest.raises(InvalidStatus) as refused:
            probe.open(origin=origin)
        assert refused.value.response.status_code == 403
        assert "?origins=" in refused.value.response.body.decode()
        probe.wait_log(f"refused: a page of {origin}")
        with probe.open() as web:
            receive(web, "estimate")


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
def test_what_strangers_send_obeys_the_log(tmp_path, header):
    """No escape sequence, title or colour of theirs reaches a terminal that shows it.

    With a daemon of its own: the log counts refusals that come often, and does not print each.
    """
    text = b"\x1b]0;owned\x07\x1b[2J\xc2\x9b31m\xe2\x80\xaex-" + header[:4]
    key = base64.b64encode(os.urandom(16))
    rest = b"" if header == b"Host: " else b"Host: 127.0.0.1\r\n"
    with WebDaemon(folder=tmp_path) as probe:
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
