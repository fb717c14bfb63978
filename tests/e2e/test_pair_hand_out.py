"""`lightprobe pair --hand-out`: the address for the first client that asks, and for nobody else."""

import http.client
import json
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from lightprobe.cli import pair, pair_hand_out

LIGHTPROBE = Path(sys.executable).with_name("lightprobe")
with socket.create_server(("", 0)) as free:
    PORT = free.getsockname()[1]
JSON = {"Accept": "application/json"}


def ask(method: str, headers: dict[str, str] | None = None) -> tuple[int, str]:
    """Status and text of an answer."""
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    tls.check_hostname, tls.verify_mode = False, ssl.CERT_NONE
    connection = http.client.HTTPSConnection("127.0.0.1", PORT, timeout=20, context=tls)
    connection.request(method, "/", headers=headers or {})
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    return answer.status, text


class Door:
    """The command."""

    def __init__(self, folder: Path, seconds: float) -> None:
        self.folder = folder
        self.process = subprocess.Popen(
            [LIGHTPROBE, "pair", "--dir", folder, "--hand-out", str(seconds),
             "--hand-out-port", str(PORT)], text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        assert self.process.stdout is not None
        self.first = self.process.stdout.readline()
        while self.process.poll() is None:
            with socket.socket() as tried:
                if tried.connect_ex(("127.0.0.1", PORT)) == 0:
                    return
            time.sleep(0.05)

    def end(self) -> tuple[int, str, str]:
        """Status, and what it said after its first line."""
        said, problem = self.process.communicate(timeout=60)
        return self.process.returncode, said, problem


@pytest.fixture
def door(tmp_path: Path) -> Iterator[Door]:
    opened = Door(tmp_path / "pair", 60)
    yield opened
    opened.process.kill()
    opened.process.communicate()


def test_the_first_that_asks_gets_it_and_the_door_is_closed(door: Door) -> None:
    assert f":{PORT} gets the address" in door.first
    status, page = ask("GET")
    assert (status, "token" in page) == (200, False), "a page that is looked at takes nothing"
    assert ask("POST", {"Origin": "https://elsewhere.example"})[0] == 403
    # One that never speaks, and one that speaks no TLS, hold nobody up.
    with socket.create_connection(("127.0.0.1", PORT)) as silent:
        with socket.create_connection(("127.0.0.1", PORT)) as plain:
            plain.sendall(b"GET / HTTP/1.0\r\n\r\n")
        status, text = ask("POST", JSON)
        silent.close()
    assert status == 200
    assert json.loads(text)["url"] == pair.read(door.folder).url(7702)
    assert door.end() == (0, "pair: a client has it\n", "")
    with socket.socket() as tried:
        assert tried.connect_ex(("127.0.0.1", PORT)) != 0


def test_a_browser_gets_a_link(door: Door) -> None:
    browser = {"Origin": f"https://127.0.0.1:{PORT}", "Accept": "text/html,*/*;q=0.8"}
    status, page = ask("POST", browser)
    assert status == 200
    assert pair.read(door.folder).token in page
    assert 'href="https://' in page


def test_nobody_asks(tmp_path: Path) -> None:
    assert Door(tmp_path / "pair", 1).end() == (0, "pair: nobody asked in 1 s\n", "")


def test_a_port_that_is_taken_is_said(door: Door, tmp_path: Path) -> None:
    status, _, problem = Door(tmp_path / "other", 5).end()
    assert status == 1
    assert problem == f"lightprobe: pair: port {PORT}: Address already in use: name another port\n"
    assert ask("GET")[0] == 200


@contextmanager
def opened(folder: Path) -> Iterator[pair_hand_out._Server]:
    """A door in this process, which hands out https://x/#token=1."""
    pair.ensure(folder, ["127.0.0.1"])
    offer = pair_hand_out.Offer(
        "https://x/#token=1", folder / pair.CERTIFICATE, folder / pair.KEY, 5, 0
    )
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(offer.certificate, offer.key)
    with pair_hand_out._Server(offer, tls) as server:
        yield server


def test_the_second_is_told_that_it_was_not_first(tmp_path: Path) -> None:
    with opened(tmp_path) as server:
        assert server.take() == "https://x/#token=1"
        assert server.take() is None
