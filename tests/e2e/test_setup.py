"""`lightprobe setup`: its server, with a real daemon and simulated camera, as the page asks it."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import json
import os
import signal
import socket
import ssl
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from aiohttp import web
from lightprobe.client import Client
from lightprobe.network.wifi import Folders, Wifi
from lightprobe.setup import card, settings, tasks
from lightprobe.setup import web as setup_web
from lightprobe.setup.job import Job
from lightprobe.setup.web import Setup

from .test_simulator import LIGHTPROBE, simulator

CONFIG = """# my probe
name = before ; the one in the hall
source = {source}
publish = unix:{folder}/probe
# ring = mcu:serial:/dev/lightprobe-mcu
"""


@dataclass
class Page:
    """What a browser that has the owner's token can ask."""

    port: int
    token: str
    folder: Path

    @property
    def config(self) -> Path:
        """The daemon's configuration."""
        return self.folder / "lightprobed.conf"

    def ask(
        self, method: str, path: str, body: Any = None, **headers: str
    ) -> tuple[int, dict[str, Any]]:
        """Status and answer."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        headers = {"Authorization": f"Bearer {self.token}"} | headers
        text = body if isinstance(body, str | bytes) or body is None else json.dumps(body)
        connection.request(method, f"/api/{path}", text, headers)
        answer = connection.getresponse()
        data = answer.read()
        connection.close()
        return answer.status, json.loads(data)

    def name(self) -> str:
        """What the daemon calls itself."""
        with Client(f"unix:{self.folder}/probe") as client:
            assert client.wait_for(lambda one: one.hello is not None, 20)
            assert client.hello is not None
            return client.hello.name

    def finish(self) -> dict[str, Any]:
        """How the task has ended, with all that it said."""
        lines: list[str] = []
        said = 0
        for _ in range(300):
            status, told = self.ask("GET", f"job?after={said}")
            assert status == 200
            lines += told["lines"]
            said = told["said"]
            if told["status"] is not None:
                return told | {"lines": lines}
        raise AssertionError(lines)


@contextlib.contextmanager
def serving(folder: Path, source: str, *more: str) -> Iterator[Page]:
    """The command, with a configuration of its own."""
    config = folder / "lightprobed.conf"
    config.write_text(CONFIG.format(source=source, folder=folder))
    page = folder / "page"
    page.mkdir()
    (page / "setup.html").write_text("<title>lightprobe: set up</title>")
    command = [
        LIGHTPROBE, "setup", "--config", config, "--port", "0", "--dir", folder / "pair",
        "--page", page, *more,
    ]  # fmt: skip
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
    try:
        assert process.stdout is not None
        lines = iter(process.stdout.readline, "")
        address = next(line.strip() for line in lines if line.startswith("http"))
        port = int(address.split(":")[2].partition("/")[0])
        yield Page(port, address.partition("#owner=")[2], folder)
    finally:
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 0


@pytest.fixture
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A probe that looks at nothing in particular."""
    with serving(Path(tmp_path_factory.mktemp("s")), "example:") as one:
        yield one


def test_who_is_not_the_owner_gets_nothing(page: Page) -> None:
    for headers, wanted in (
        ({"Authorization": ""}, 401), ({"Authorization": f"Bearer {page.token[:-1]}"}, 401),
        ({"Authorization": "Bearer ünknown".encode("latin-1").decode("latin-1")}, 401),
        ({"Origin": "https://elsewhere.example"}, 403), ({"Origin": "null"}, 403),
    ):  # fmt: skip
        for method, path in (("GET", "state"), ("PUT", "settings"), ("POST", "job")):
            status, answer = page.ask(method, path, {"text": ""}, **headers)
            assert status == wanted, (headers, path)
            assert set(answer) == {"problem"}
    own = f"http://127.0.0.1:{page.port}"
    assert page.ask("GET", "state", Origin=own)[0] == 200
    assert page.config.read_text() == CONFIG.format(source="example:", folder=page.folder)
    assert (page.folder / "pair/owner").stat().st_mode & 0o777 == 0o600


def test_a_setting_is_changed_and_nothing_else(page: Page) -> None:
    status, state = page.ask("GET", "state")
    assert status == 200
    assert state["settings"]["name"] == ["before"]
    assert state["runs"]
    assert page.name() == "before"
    assert page.ask("PUT", "settings", {"set": {"name": ["after"], "preset": ["fast"]}})[0] == 200
    assert page.name() == "after"
    expected = CONFIG.format(source="example:", folder=page.folder).replace(
        "name = before ; the one in the hall", "name = after"
    )
    assert page.config.read_text() == expected + "preset = fast\n"
    assert page.config.with_name("lightprobed.conf.old").read_text().count("before") == 1


def test_what_the_daemon_refuses_changes_nothing(page: Page) -> None:
    before = page.config.read_text()
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for change, status, words in (
            ({"set": {"preset": ["fastest"]}}, 422, "fast"),
            ({"set": {"no-such-thing": ["1"]}}, 422, "no-such-thing"),
            ({"set": {"name": ["two\nsource = file:/etc/shadow"]}}, 422, "one line"),
            ({"set": {"name": ["a ; b"]}}, 422, "comment"),
            ({"set": {"name": "text"}}, 400, "lists"),
            ({"set": {"Name": ["x"]}}, 422, "no name of a setting"),
            ({"text": "source = example:\nnonsense\n"}, 422, "lightprobed.conf"),
            # It may be written so; only its start shows that the port is taken.
            ({"set": {"publish": [f"tcp:127.0.0.1:{port}"]}}, 409, "the former settings are back"),
            ("no JSON", 400, "JSON"), ([], 400, "object"),
        ):  # fmt: skip
            found, answer = page.ask("PUT", "settings", change)
            assert (found, words in answer["problem"]) == (status, True), (change, answer)
            assert page.config.read_text() == before
    assert page.name() == "before"
    assert sorted(one.name for one in page.folder.glob(".*")) == []


def test_a_task_of_the_command_line_runs_and_is_told(page: Page) -> None:
    wanted = {"task": "doctor", "fields": {"probe": f"unix:{page.folder}/probe"}}
    assert page.ask("POST", "job", wanted)[0] == 200
    assert page.ask("POST", "job", wanted)[0] == 409  # one at a time
    assert page.ask("PUT", "settings", {"set": {"name": ["x"]}})[0] == 409
    assert page.ask("POST", "job/answer", {})[0] == 409  # it asks nothing
    told = page.finish()
    assert any("connection" in line for line in told["lines"])
    assert page.name() == "before"


@pytest.mark.parametrize(
    "wanted",
    [
        {"task": "rm"}, {"task": None}, {"task": "doctor", "fields": []},
        {"task": "doctor", "fields": {"probe": "--help"}},
        {"task": "exposure", "fields": {"source": "example:", "output": "../../x"}},
        {"task": "exposure", "fields": {"source": "a\nb", "output": "x"}},
        {"task": "scale", "fields": {"probe": "tcp:x:1", "lux": "many", "facing": "up"}},
        {"task": "scale", "fields": {"probe": "tcp:x:1", "lux": "1", "facing": "in"}},
    ],
)  # fmt: skip
def test_a_task_takes_only_what_it_asks_for(page: Page, wanted: dict[str, Any]) -> None:
    status, answer = page.ask("POST", "job", wanted)
    assert status in (400, 422)
    assert answer["problem"].startswith("setup: ")
    assert page.ask("GET", "job")[0] == 404


class NoDaemon:
    """A daemon that does as it is told, and nothing else."""

    runs = True

    def start(self) -> None:
        """Nothing."""

    def stop(self) -> None:
        """Nothing."""

    def log(self) -> list[str]:
        """Nothing."""
        return []


@pytest.fixture
def card_page(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Page]:
    """The page of a machine that runs from a card, as far as its files tell."""
    folder = Path(tmp_path_factory.mktemp("s"))
    for name in ("version", "rauc"):
        (folder / name).write_text("1\n")
    (folder / "rauc").chmod(0o755)
    (folder / "lightprobed.conf").write_text("source = example:\n")
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    monkeypatch.setattr(card, "VERSION", folder / "version")
    monkeypatch.setattr(card, "TRIAL", folder / "trial")
    token = "t" * 32
    wifi = Wifi(Folders(folder, folder))
    setup = Setup(token, folder / "lightprobed.conf", NoDaemon(), folder, folder, wifi)
    listening = socket.create_server(("127.0.0.1", 0))
    port = listening.getsockname()[1]
    loop = asyncio.new_event_loop()
    runner = web.AppRunner(setup.application())
    loop.run_until_complete(runner.setup())
    loop.run_until_complete(web.SockSite(runner, listening).start())
    work = threading.Thread(target=loop.run_forever)
    work.start()
    yield Page(port, token, folder)
    asyncio.run_coroutine_threadsafe(runner.cleanup(), loop).result(30)
    loop.call_soon_threadsafe(loop.stop)
    work.join(30)


def test_a_file_is_taken_whole_or_not_at_all(card_page: Page) -> None:
    page = card_page
    kept = page.folder / "upload"
    assert page.ask("PUT", "upload", b"x" * 3_000_000)[0] == 200
    assert kept.read_bytes() == b"x" * 3_000_000
    assert kept.stat().st_mode & 0o777 == 0o600
    assert page.ask("PUT", "upload", b"y", Authorization="Bearer wrong")[0] == 401
    assert kept.stat().st_size == 3_000_000
    assert page.ask("PUT", "upload", b"")[0] == 422
    huge = {"Content-Length": str(1 << 60)}
    assert "there is room for" in page.ask("PUT", "upload", b"", **huge)[1]["problem"]
    # A part of it: the sender goes.
    with socket.create_connection(("127.0.0.1", page.port)) as sender:
        head = f"PUT /api/upload HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {page.token}\r\n"
        sender.sendall(f"{head}Content-Length: 1000\r\n\r\n".encode() + b"z" * 10)
        end = time.monotonic() + 20
        while not (page.folder / ".upload.part").exists():
            assert time.monotonic() < end
            time.sleep(0.01)
        assert page.ask("PUT", "upload", b"y")[0] == 409  # one at a time
        assert not kept.exists()
    while page.ask("PUT", "upload", b"y")[0] != 200:
        assert time.monotonic() < end
    assert kept.read_bytes() == b"y"
    assert not [*page.folder.glob(".upload*")]


def test_a_file_that_no_task_takes_goes(card_page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(setup_web, "_UNUSED_S", 0.5)
    assert card_page.ask("PUT", "upload", b"x")[0] == 200
    end = time.monotonic() + 20
    while (card_page.folder / "upload").exists():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_while_an_update_is_on_trial_nothing_is_begun(card_page: Page) -> None:
    (card_page.folder / "trial").touch()
    status, answer = card_page.ask("POST", "job", {"task": "find-cameras", "fields": {}})
    assert (status, "being tried: wait" in answer["problem"]) == (409, True)


def test_a_machine_that_is_no_card_takes_no_file(page: Page) -> None:
    status, answer = page.ask("PUT", "upload", b"x")
    assert (status, answer["problem"]) == (
        422, "setup: upload: no task of this machine takes a file",
    )  # fmt: skip
    assert page.ask("POST", "job", {"task": "update", "fields": {"file": "x"}})[0] == 422


def test_a_calibration_takes_the_camera_and_gives_it_back(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    folder = Path(tmp_path_factory.mktemp("s"))
    with simulator(folder, "--rate", "8") as (path, _), serving(folder, f"sim:{path}") as page:
        assert page.name() == "before"
        fields = {"source": f"sim:{path}", "output": "mine"}
        assert page.ask("POST", "job", {"task": "exposure", "fields": fields})[0] == 200
        told = page.finish()
        assert told["status"] == 0, told["lines"]
        assert told["written"] == str(folder / "mine.camera")
        assert page.name() == "before"  # the daemon has the camera again
        assert page.ask("PUT", "settings", {"set": {"camera": [told["written"]]}})[0] == 200
        assert page.ask("GET", "state")[1]["runs"]


def test_a_task_is_stopped_and_its_steps_are_answered(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    folder = Path(tmp_path_factory.mktemp("s"))
    with simulator(folder, "--rate", "8") as (path, _), serving(folder, f"sim:{path}") as page:
        fields = {"source": f"sim:{path}", "output": "mine"}
        assert page.ask("POST", "job", {"task": "check-camera", "fields": fields})[0] == 200
        lines: list[str] = []
        deadline = time.monotonic() + 60
        while not any("press Enter" in line for line in lines) and time.monotonic() < deadline:
            lines += page.ask("GET", f"job?after={len(lines)}")[1]["lines"]
        assert page.ask("GET", "state")[1]["runs"] is False
        before = len(lines)
        assert page.ask("POST", "job/answer", {"skip": True})[0] == 200
        while len(lines) == before and time.monotonic() < deadline:
            lines += page.ask("GET", f"job?after={len(lines)}")[1]["lines"]
        assert any("press Enter" in line for line in lines[before:])  # the next step
        assert page.ask("POST", "job/stop")[0] == 200
        assert page.finish()["status"] not in (None, 0)
        assert not (folder / "mine.camera").exists()
        assert page.name() == "before"
        assert page.ask("GET", "job/files/..%2Flightprobed.conf")[0] == 404


def test_the_network_is_served_encrypted_and_a_new_token_ends_the_old(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    folder = Path(tmp_path_factory.mktemp("s"))
    with serving(folder, "example:", "--network") as page:
        former = page.token
        context = ssl.create_default_context(cafile=folder / "pair/certificate.pem")
        context.check_hostname = False
        connection = http.client.HTTPSConnection(
            "127.0.0.1", page.port, timeout=30, context=context
        )
        connection.request("GET", "/api/state", headers={"Authorization": f"Bearer {former}"})
        assert connection.getresponse().status == 200
        connection.close()
        with pytest.raises(ConnectionError):  # nothing is said in clear
            page.ask("GET", "state")
    (folder / "page/setup.html").unlink()
    (folder / "page").rmdir()
    with serving(folder, "example:", "--new") as page:
        assert page.token != former
        assert page.ask("GET", "state", Authorization=f"Bearer {former}")[0] == 401


def test_an_empty_token_is_none(tmp_path_factory: pytest.TempPathFactory) -> None:
    """What a power cut may leave of the file must not open the page to all."""
    folder = Path(tmp_path_factory.mktemp("s"))
    (folder / "pair").mkdir()
    (folder / "pair/owner").touch()
    with serving(folder, "example:") as page:
        assert len(page.token) >= 32
        assert page.ask("GET", "state", Authorization="Bearer ")[0] == 401


def test_the_former_settings_are_kept_beside_the_new_ones(page: Page) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        publish = [f"tcp:127.0.0.1:{taken.getsockname()[1]}"]
        assert page.ask("PUT", "settings", {"set": {"publish": publish}})[0] == 409
    old = page.config.with_name("lightprobed.conf.old").read_text()
    assert old == page.config.read_text() == CONFIG.format(source="example:", folder=page.folder)


def test_a_step_is_answered_once_and_only_when_it_asks(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    folder = Path(tmp_path_factory.mktemp("s"))
    with simulator(folder, "--rate", "8") as (path, _), serving(folder, f"sim:{path}") as page:
        fields = {"source": f"sim:{path}", "output": "mine"}
        assert page.ask("POST", "job", {"task": "check-camera", "fields": fields})[0] == 200
        deadline = time.monotonic() + 60
        while not page.ask("GET", "job?after=0")[1]["waits"]:
            assert time.monotonic() < deadline
        assert page.ask("POST", "job/answer", {})[0] == 200
        assert page.ask("POST", "job/answer", {})[0] == 409
        assert page.ask("POST", "job/stop")[0] == 200
        assert page.finish()["status"] != 0


def test_a_question_waits_for_one_answer() -> None:
    job = Job(tasks.named("check-camera"), None)
    job.say("a lamp is hidden, then press")
    job.say("Enter (s and Enter: leave it out).")
    assert job.waits
    job._answered = job.said
    assert not job.waits
    job.say("measured")  # behind a question that was answered
    assert not job.waits
    job.say("the lens is covered, then press Enter.")
    assert job.waits
    job.end(0)
    assert not job.waits


def test_a_task_that_is_stopped_before_it_begins_does_not_begin(page: Page) -> None:
    job = Job(tasks.named("doctor"), None)

    async def stopped() -> None:
        await job.stop()
        await job.run(["--version"])

    asyncio.run(stopped())
    assert (job.status, list(job.lines)) == (1, [])
    other = Job(tasks.named("doctor"), None)

    async def stopped_while_it_begins() -> None:
        begun = asyncio.create_task(other.run(["doctor", "--wait", "60", "tcp:127.0.0.1:1"]))
        await asyncio.sleep(0)
        await other.stop()
        await asyncio.wait_for(begun, 30)

    asyncio.run(stopped_while_it_begins())
    assert other.status not in (None, 0)
    assert page.ask("POST", "job/stop")[0] == 404


@pytest.mark.parametrize("body", ["[" * 5000 + "]" * 5000, '{"text": "\\ud800"}', "\xff"])
def test_bodies_that_are_none_are_no_fault(page: Page, body: str) -> None:
    status, answer = page.ask("PUT", "settings", body.encode("latin-1"))
    assert status in (400, 422), answer


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_line_ends_and_owner_of_a_configuration_stay(tmp_path: Path, end: str) -> None:
    file = tmp_path / "x.conf"
    file.write_bytes(f"\ufeff# form\x0cfeed = x{end}name = a{end}".encode())
    file.chmod(0o640)
    os.chown(file, 1234, 1234)
    text = settings.read(file)
    assert settings.values(text) == {"name": ["a"]}
    settings.write(file, settings.changed(text, {"name": ["b"], "ring": ["mcu:x"]}))
    assert file.read_bytes() == f"# form\x0cfeed = x{end}name = b{end}ring = mcu:x{end}".encode()
    found = file.stat()
    assert (found.st_mode & 0o777, found.st_uid, found.st_gid) == (0o640, 1234, 1234)


def test_a_configuration_keeps_what_it_does_not_change() -> None:
    text = "# top\nsource = a\nsource = b\n# ring = mcu:x\npreset = fast\n"
    assert settings.changed(text, {"source": ["c"]}) == text.replace(
        "source = a\nsource = b", "source = c"
    )
    assert settings.changed(text, {"ring": ["mcu:y"]}).splitlines()[4] == "ring = mcu:y"
    assert settings.changed(text, {"preset": []}) == text.replace("preset = fast\n", "")
    assert settings.values(text) == {"source": ["a", "b"], "preset": ["fast"]}
    assert settings.values("name = a;b ; c\n") == {"name": ["a;b"]}
