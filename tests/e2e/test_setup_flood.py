"""Small servers of `lightprobe`, while somebody on the network holds or opens many connections."""

from __future__ import annotations

import contextlib
import http.client
import resource
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from lightprobe.cli import pair_hand_out
from lightprobe.places import Place, Places, peer_of
from lightprobe.setup import door

from .test_pair_hand_out import opened
from .test_setup import Page, serving

#: More than the files that the page's process may have open (1024 by default), or its places.
HELD = 1500
#: The owner's next page, on a machine that does other work; who is kept out waits for ever.
WITHIN_S = 30.0
#: By so much a machine that does other work may be late.
_BUSY_S = 20.0
OPENS_ALL_THE_TIME = """
import socket, sys
port, source = int(sys.argv[1]), sys.argv[2]
held = []
while True:
    one = socket.socket()
    one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\\x01\\0\\0\\0\\0\\0\\0\\0")
    try:
        one.bind((source, 0))
        one.connect(("127.0.0.1", port))
    except OSError:
        continue
    held.append(one)
    if len(held) == 1000:
        held.pop(0).close()
"""


@pytest.fixture(autouse=True)
def many_files() -> Iterator[None]:
    """This process holds the other ends; the page's process has what is usual."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(8192, before[1]), before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, before)


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Page]:
    """The page as the network has it, in a process that may have 1024 files open."""
    with contextlib.ExitStack() as stack:
        with usual_files():
            one = stack.enter_context(serving(tmp_path, "example:", "--network"))
        yield one


@contextlib.contextmanager
def usual_files() -> Iterator[None]:
    """Children that are started now may have so many files open."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (1024, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def ask(page: Page, source: str = "127.0.0.1") -> tuple[int, float]:
    """Status of an owner's request on a new connection, and the seconds it took. It tries again."""
    context = ssl.create_default_context(cafile=page.folder / "pair/certificate.pem")
    context.check_hostname = False
    began_s = time.monotonic()
    while True:
        connection = http.client.HTTPSConnection(
            "127.0.0.1", page.port, timeout=WITHIN_S, context=context, source_address=(source, 0)
        )
        try:
            connection.request(
                "GET", "/api/state", headers={"Authorization": f"Bearer {page.token}"}
            )
            return connection.getresponse().status, time.monotonic() - began_s
        except OSError:
            if time.monotonic() - began_s > WITHIN_S:
                raise
            time.sleep(0.05)
        finally:
            connection.close()


@contextlib.contextmanager
def held(port: int, source: str, say: bytes) -> Iterator[list[socket.socket]]:
    """So many connections that say this and then nothing."""
    with contextlib.ExitStack() as stack:
        ends = []
        for _ in range(HELD):
            end = stack.enter_context(socket.create_connection(
                ("127.0.0.1", port), timeout=10, source_address=(source, 0)
            ))  # fmt: skip
            with contextlib.suppress(OSError):
                end.sendall(say)
            ends.append(end)
        yield ends


@contextlib.contextmanager
def opening(port: int, source: str) -> Iterator[None]:
    """Somebody who opens connections as fast as a program can, and holds 1000."""
    process = subprocess.Popen([sys.executable, "-c", OPENS_ALL_THE_TIME, str(port), source])
    try:
        time.sleep(1)
        yield
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize("say", [b"", b"\x16\x03\x01"], ids=["nothing", "half a handshake"])
@pytest.mark.parametrize("source", ["127.0.0.1", "127.0.0.2"], ids=["own address", "another"])
def test_the_owner_gets_in_while_somebody_holds_connections(
    page: Page, source: str, say: bytes
) -> None:
    with held(page.port, source, say):
        for _ in range(3):
            status, took_s = ask(page)
            assert (status, took_s < WITHIN_S) == (200, True)


def test_the_owner_gets_in_while_somebody_opens_connections(page: Page) -> None:
    with opening(page.port, "127.0.0.2"), opening(page.port, "127.0.0.3"):
        for _ in range(3):
            status, took_s = ask(page)
            assert (status, took_s < WITHIN_S) == (200, True)


def test_a_connection_of_the_owner_stays_while_others_have_to_go(page: Page) -> None:
    context = ssl.create_default_context(cafile=page.folder / "pair/certificate.pem")
    context.check_hostname = False
    connection = http.client.HTTPSConnection("127.0.0.1", page.port, timeout=30, context=context)
    headers = {"Authorization": f"Bearer {page.token}"}
    connection.request("GET", "/api/state", headers=headers)
    assert connection.getresponse().read()
    own = connection.sock
    with held(page.port, "127.0.0.1", b""):
        connection.request("GET", "/api/state", headers=headers)
        assert connection.getresponse().status == 200
        assert connection.sock is own
    connection.close()


def test_who_shows_no_token_has_to_go(page: Page) -> None:
    """In its handshake, after it, and within a request whose end never comes."""
    context = ssl._create_unverified_context()

    def connected() -> socket.socket:
        return socket.create_connection(
            ("127.0.0.1", page.port), timeout=door.UNPROVEN_S + 2 * _BUSY_S
        )

    with connected() as silent, connected() as shaken, connected() as slow:
        began_s = time.monotonic()
        ends = [silent, context.wrap_socket(shaken), context.wrap_socket(slow)]
        ends[2].sendall(b"GET /setup.html HTTP/1.1\r\nHost: x\r\nX: ")
        took_s = []
        for end in ends:
            with contextlib.suppress(OSError):
                while end.recv(100):
                    pass
            took_s.append(time.monotonic() - began_s)
            end.close()
    assert took_s[0] < door.HANDSHAKE_S + _BUSY_S
    assert max(took_s) < door.UNPROVEN_S + _BUSY_S


@contextlib.contextmanager
def handing_out(folder: Path) -> Iterator[int]:
    """The port of a door that hands out an address, and answers."""
    with opened(folder) as server:
        threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True).start()
        yield server.socket.getsockname()[1]
        server.shutdown()


def test_an_address_is_handed_out_while_somebody_holds_connections(tmp_path: Path) -> None:
    with handing_out(tmp_path) as port, contextlib.ExitStack() as stack:
        for _ in range(60):
            stack.enter_context(
                socket.create_connection(("127.0.0.1", port), source_address=("127.0.0.2", 0))
            )
        time.sleep(0.5)
        connection = http.client.HTTPSConnection(
            "127.0.0.1", port, timeout=5, context=ssl._create_unverified_context()
        )
        connection.request("POST", "/")
        assert b"token=1" in connection.getresponse().read()
        connection.close()


def test_who_speaks_slowly_is_not_heard_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pair_hand_out, "_PATIENCE_S", 2.0)
    with handing_out(tmp_path) as port:
        raw = socket.create_connection(("127.0.0.1", port))
        with ssl._create_unverified_context().wrap_socket(raw) as slow:
            end_s = time.monotonic() + 30
            with contextlib.suppress(OSError):
                while time.monotonic() < end_s:  # less than 2 s between two bytes
                    slow.sendall(b"G")
                    time.sleep(0.5)
            assert time.monotonic() < end_s


def test_who_has_most_makes_room() -> None:
    gone: list[str] = []
    places = Places(most=6, most_of_peer=4, most_proven=1)

    def enter(peer: str, name: str) -> Place:
        return places.enter(peer, lambda: gone.append(name))

    entered = [enter("a", f"a{i}") for i in range(6)]
    assert gone == ["a0", "a1"]  # it has its fill
    enter("b", "b0")
    enter("c", "c0")
    assert (gone, places.taken) == (["a0", "a1"], 6)
    enter("d", "d0")
    assert gone == ["a0", "a1", "a2"]  # all places are taken
    places.prove(entered[3])
    places.prove(entered[0])  # it has gone already
    for i in range(9):
        enter("e", f"e{i}")
    assert "a3" not in gone
    places.prove(enter("f", "f0"))  # the older proven one makes room
    assert "a3" in gone
    last = enter("g", "g0")
    assert places.taken == 7
    places.exit(last)
    places.exit(last)
    assert places.taken == 6


def test_what_one_peer_is() -> None:
    assert peer_of("::ffff:192.0.2.7") == peer_of("192.0.2.7") == "192.0.2.7"
    assert peer_of("2001:db8:1:2:3::4") == peer_of("2001:db8:1:2::9")
    assert peer_of("2001:db8:1:2::") != peer_of("2001:db8:1:3::")
    assert peer_of("fe80::1%eth0") == peer_of("fe80::2")
