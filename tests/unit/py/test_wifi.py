"""`lightprobe wifi`, with a program that stands for nmcli: what it is told, and what is left."""

from __future__ import annotations

import asyncio
import json
import os
import re
import socket
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from aiohttp import web
from aiohttp.test_utils import make_mocked_request
from hypothesis import given
from hypothesis import strategies as st
from lightprobe.errors import LightprobeError, UsageError
from lightprobe.network import names, nmcli, profile
from lightprobe.network.wifi import Folders, Wifi
from lightprobe.setup.network import Networks

FAKES = Path(__file__).parents[2] / "fakes"
LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
PASSWORD = "corréct \\horse; =#[x] "
POINT = {"uuid": "11", "id": "lightprobe", "ssid": b"lightprobe-1".hex(), "psk": "x", "mode": "ap"}
NASTY = b"<b>:\\ \"'\n\x1b[31m\xff;"
EMOJI = "☕ café".encode()


def network(ssid: bytes, signal: int = 50, **more: Any) -> dict[str, Any]:
    wpa2 = {"security": "WPA2", "rsn": "pair_ccmp group_ccmp psk", "password": PASSWORD}
    return {"ssid": ssid.hex(), "signal": signal} | wpa2 | more


class Machine:
    """A machine with a radio; its folders, and what nmcli was told."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.file = folder, folder / "nmcli.json"
        self.kept, self.read = folder / "kept", folder / "read"
        self.kept.mkdir()
        self.read.mkdir()
        self.wifi = Wifi(Folders(self.kept, self.read), folder / "opened")
        self.set(radio="disconnected", air=[], saved={}, active=None)

    def set(self, **values: Any) -> None:
        known = json.loads(self.file.read_text()) if self.file.exists() else {}
        self.file.write_text(json.dumps(known | values))

    @property
    def state(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.file.read_text())
        return found

    @property
    def calls(self) -> str:
        return Path(f"{self.file}.calls").read_text()

    def files(self) -> dict[str, str]:
        return {str(one): one.read_text() for one in self.folder.glob("*/*")}

    def command(self, *words: str, given: str = "") -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [LIGHTPROBE, "wifi", *words], input=given, capture_output=True, text=True, timeout=60
        )


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Machine:
    monkeypatch.setenv("PATH", f"{FAKES}:{os.environ['PATH']}")
    monkeypatch.setenv("FAKE_NMCLI", str(tmp_path / "nmcli.json"))
    return Machine(tmp_path)


def open_access_point(machine: Machine) -> None:
    machine.set(saved={"11": POINT}, active="11")
    (machine.folder / "opened").write_text("3")


@given(st.binary(min_size=1, max_size=32))
def test_a_shown_name_is_one_line_and_leads_back(ssid: bytes) -> None:
    text = names.shown(ssid)
    assert text.isprintable()
    assert names.typed(text)[0] == ssid


@given(st.text(max_size=40))
def test_a_typed_name_is_meant_as_it_stands_at_the_least(text: str) -> None:
    assert names.typed(text)[-1] == text.encode(errors="surrogateescape") or max(text) >= "\ud800"


@given(st.lists(st.text(alphabet=st.characters(exclude_characters="\n"), max_size=9), min_size=1))
def test_lines_of_nmcli_are_read_as_they_were_escaped(values: list[str]) -> None:
    line = ":".join(value.replace("\\", "\\\\").replace(":", "\\:") for value in values)
    assert nmcli.fields(line) == values


@given(st.text(max_size=80))
def test_lines_that_nobody_would_write_are_no_fault(line: str) -> None:
    assert all(isinstance(value, str) for value in nmcli.fields(line))


@given(
    st.binary(min_size=1, max_size=32),
    st.text(st.characters(exclude_categories=("Cc", "Cs")), min_size=8, max_size=15),
)
def test_no_name_or_password_gets_out_of_its_line(ssid: bytes, password: str) -> None:
    profile.check_password(profile.WPA2, password)
    lines = profile.Profile(ssid, profile.WPA2, password, hidden=False).text().split("\n")
    assert [line.partition("=")[0] for line in lines] == [
        "[connection]", "id", "uuid", "type", "autoconnect-priority", "[wifi]", "ssid", "hidden",
        "[wifi-security]", "key-mgmt", "psk", "",
    ]  # fmt: skip
    value = re.sub(r"\\(.)", lambda part: " " if part[1] == "s" else part[1], lines[10][4:])
    assert value == password
    assert lines[6] == f"ssid={''.join(f'{byte};' for byte in ssid)}"


@given(st.text(min_size=8))
def test_a_password_that_is_refused_is_not_repeated(password: str) -> None:
    try:
        profile.check_password(profile.OPEN, password)
    except UsageError as error:
        said = str(error)
    assert password not in said


def test_what_there_is(machine: Machine) -> None:
    machine.set(air=[
        network(NASTY, 20), network(b"near", 90), network(b"near", 70), network(b"", 99),
        network(b"\0\0", 99), network(b"work", 10, security="WPA2 802.1X", rsn="802.1X"),
        network(b"old", 9, security="WEP", rsn="(none)"),
        network(b"free", 8, security="", rsn="(none)"),
        network(b"new", 7, security="WPA3", rsn="sae"),
        network(b"both", 6, security="WPA2 WPA3", rsn="psk sae"),
        network(b"owe", 5, security="OWE", rsn="owe"),
    ])  # fmt: skip
    found = [(one.name, one.signal_percent, one.security) for one in machine.wifi.look().networks]
    assert found == [
        ("near", 90, "WPA2"), (names.shown(NASTY), 20, "WPA2"), ("work", 10, "enterprise"),
        ("old", 9, "WEP"), ("free", 8, "open"), ("new", 7, "WPA3"), ("both", 6, "WPA2"),
        ("owe", 5, "OWE"),
    ]  # fmt: skip


@pytest.mark.parametrize("ssid", [NASTY, EMOJI, b"home", b"a" * 32, b"\\x41", b"\xff" * 32])
def test_a_network_is_joined_and_kept_and_forgotten(machine: Machine, ssid: bytes) -> None:
    machine.set(air=[network(ssid)])
    machine.wifi.join(ssid, PASSWORD)
    (one,) = machine.wifi.look().networks
    assert (one.ssid, one.joined, one.known) == (ssid.hex(), True, True)
    assert [(link.kind, link.name) for link in machine.wifi.look().links] == [
        ("wifi", names.shown(ssid))
    ]
    for folder in (machine.kept, machine.read):
        (file,) = folder.iterdir()
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert PASSWORD not in machine.calls
    assert "correct" not in machine.calls
    machine.wifi.forget(ssid)
    assert machine.files() == {}
    assert (machine.state["active"], machine.state["saved"]) == (None, {})
    with pytest.raises(UsageError, match="is not known"):
        machine.wifi.forget(ssid)


@pytest.mark.parametrize(
    ("ssid", "password", "said"),
    [(b"home", "wrong password", "password is wrong"), (b"away", PASSWORD, "not in reach")],
)
def test_what_cannot_be_joined_leaves_the_access_point_open(
    machine: Machine, ssid: bytes, password: str, said: str
) -> None:
    machine.set(air=[network(b"home")])
    open_access_point(machine)
    assert machine.wifi.look().own_access_point == "lightprobe-1"
    os.utime(machine.folder / "opened", (0, 0))
    with pytest.raises(LightprobeError, match=said) as failure:
        machine.wifi.join(ssid, password)
    assert "its own Wi-Fi lightprobe-1 is back" in str(failure.value)
    assert password not in str(failure.value)
    assert password not in machine.calls
    assert (machine.state["active"], list(machine.state["saved"])) == ("11", ["11"])
    assert machine.files() == {}
    # The image goes on trying known networks, as before.
    assert (machine.folder / "opened").read_text() == "3"
    assert (machine.folder / "opened").stat().st_mtime > 0


def test_a_wrong_password_does_not_replace_the_right_one(machine: Machine) -> None:
    machine.set(air=[network(b"home")])
    machine.wifi.join(b"home", PASSWORD)
    before = machine.files()
    with pytest.raises(LightprobeError, match="home is back"):
        machine.wifi.join(b"home", "another password")
    assert machine.files() == before
    assert machine.wifi.look().networks[0].joined
    machine.wifi.join(b"home", "")  # as it is known


@pytest.mark.parametrize(
    ("air", "password", "said"),
    [
        ({"security": "WPA2 802.1X", "rsn": "802.1X"}, PASSWORD, "enterprise"),
        ({"security": "WEP", "rsn": "(none)"}, "12345", "WEP protects nothing"),
        ({}, "", "needs its password"),
        ({}, "1234567", "8 to 63"),
        ({}, "1" * 65, "8 to 63"),
        ({}, "12345678\npsk=x", "in one line"),
        ({"security": "", "rsn": "(none)"}, PASSWORD, "is open"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_changes(
    machine: Machine, air: dict[str, str], password: str, said: str
) -> None:
    machine.set(air=[network(b"x", **air)])
    before = machine.state
    with pytest.raises(UsageError, match=said) as failure:
        machine.wifi.join(b"x", password)
    assert not password or password not in str(failure.value)
    assert (machine.state, machine.files()) == (before, {})


@pytest.mark.parametrize(
    ("air", "password", "key_management"),
    [
        ({"security": "", "rsn": "(none)", "password": ""}, "", ""),
        ({"security": "OWE", "rsn": "owe", "password": ""}, "", "owe"),
        ({"security": "WPA3", "rsn": "sae", "password": "short"}, "short", "sae"),
        ({"security": "WPA2 WPA3", "rsn": "psk sae"}, PASSWORD, "wpa-psk"),
        ({"security": "WPA1", "rsn": "(none)"}, PASSWORD, "wpa-psk"),
    ],
)
def test_each_kind_is_joined_as_it_needs(
    machine: Machine, air: dict[str, str], password: str, key_management: str
) -> None:
    machine.set(air=[network(b"x", **air, **{"key-mgmt": key_management})])
    machine.wifi.join(b"x", password)
    assert machine.wifi.look().networks[0].joined


def test_networks_that_others_have_saved_are_known_and_forgotten(machine: Machine) -> None:
    other = {"uuid": "22", "id": "x", "ssid": b"other".hex(), "psk": PASSWORD,
             "mode": "infrastructure", "key-mgmt": "wpa-psk"}  # fmt: skip
    machine.set(saved={"11": POINT, "22": other}, air=[network(b"other")])
    assert [(one.name, one.known) for one in machine.wifi.look().networks] == [("other", True)]
    machine.wifi.join(b"other", "")
    assert machine.state["active"] == "22"
    with pytest.raises(UsageError, match=r"lightprobe\.txt"):  # of a card's image
        machine.wifi.forget(b"other")
    Wifi(Folders(machine.read, machine.read)).forget(b"other")
    assert list(machine.state["saved"]) == ["11"]


def test_one_change_at_a_time(machine: Machine) -> None:
    machine.set(air=[network(b"home")])
    with machine.wifi._alone(), pytest.raises(LightprobeError, match="wait a minute"):
        machine.wifi.join(b"home", PASSWORD)


def test_a_network_that_cannot_be_kept_is_joined_and_that_is_said(machine: Machine) -> None:
    machine.set(air=[network(b"home")])
    machine.kept.rmdir()
    with pytest.raises(LightprobeError, match="will be forgotten at the next start"):
        machine.wifi.join(b"home", PASSWORD)
    assert machine.state["active"] == profile.uuid_of(b"home")


def no_radio(machine: Machine) -> None:
    machine.set(radio="")


def radio_off(machine: Machine) -> None:
    machine.set(radio="unavailable")


def not_running(machine: Machine) -> None:
    machine.set(runs=False)


@pytest.mark.parametrize(
    ("breaks", "said"),
    [
        (no_radio, "has no Wi-Fi"), (radio_off, "nmcli radio wifi on"),
        (not_running, "systemctl start NetworkManager"),
    ],
)  # fmt: skip
def test_a_machine_without_wifi_says_why(
    machine: Machine, breaks: Callable[[Machine], None], said: str
) -> None:
    breaks(machine)
    for call in (machine.wifi.look, lambda: machine.wifi.join(b"x", PASSWORD)):
        with pytest.raises(LightprobeError, match=said):
            call()


def test_a_machine_without_networkmanager_says_so(
    machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(machine.folder))
    done = machine.command()
    assert (done.returncode, done.stdout) == (1, "")
    assert "has no NetworkManager" in done.stderr


def test_the_command_joins_with_a_password_of_its_input(machine: Machine) -> None:
    machine.set(air=[network(NASTY), network(EMOJI, 40)])
    where = f"--networks={machine.read}"
    done = machine.command("join", where, names.shown(NASTY), given=f"{PASSWORD}\n")
    assert (done.returncode, done.stderr) == (0, "")
    assert "joined, known" in done.stdout
    assert "\x1b" not in done.stdout
    told = json.loads(machine.command(where, "--json").stdout)
    assert [one["name"] for one in told["networks"] if one["joined"]] == [names.shown(NASTY)]
    wrong = machine.command("join", where, "☕ café", given="not the password")
    assert wrong.returncode == 1
    assert wrong.stderr.count("\n") == 1
    assert "the password is wrong" in wrong.stderr
    assert "not the password" not in wrong.stderr + machine.calls
    assert machine.command("forget", where, names.shown(NASTY)).returncode == 0
    assert machine.command("forget", where, names.shown(NASTY)).returncode == 2
    assert machine.command("join", where, "x" * 33, given="12345678").returncode == 2


def asked(scheme: str, host: str) -> web.Request:
    request = make_mocked_request("GET", "/api/network", headers={"Host": host})
    return request.clone(scheme=scheme, host=host)


def test_the_page_is_told_where_it_will_be(machine: Machine) -> None:
    async def told(scheme: str, host: str) -> str:
        return str((await Networks(machine.wifi).state(asked(scheme, host)))["page"])

    there = asyncio.run(told("https", "10.42.0.1:7703"))
    assert there == f"https://{socket.gethostname().partition('.')[0]}.local:7703/setup.html"
    here = asyncio.run(told("http", "127.0.0.1:7703"))
    assert here == "http://127.0.0.1:7703/setup.html"


def test_the_page_begins_one_change_and_is_told_its_end(machine: Machine) -> None:
    machine.set(air=[network(NASTY)])

    async def change() -> list[Any]:
        page = Networks(machine.wifi)
        for wrong in ({"ssid": "x"}, {"ssid": 1}, {"name": "x", "password": []}):
            with pytest.raises(UsageError):
                page.join(wrong)
        page.join({"ssid": NASTY.hex(), "password": "not the right one"})
        with pytest.raises(LightprobeError, match="wait a minute"):
            page.forget({"ssid": NASTY.hex()})
        during = await page.state(asked("http", "127.0.0.1:1"))
        await page.end()
        first = await page.state(asked("http", "127.0.0.1:1"))
        page.join({"ssid": NASTY.hex(), "password": PASSWORD})
        await page.end()
        return [during, first, await page.state(asked("http", "127.0.0.1:1"))]

    during, first, second = asyncio.run(change())
    assert (during["works"], first["works"]) == (True, False)
    assert "the password is wrong" in first["last"]["problem"]
    assert "not the right one" not in json.dumps(first)
    assert second["last"] == {"what": "join", "name": names.shown(NASTY), "problem": ""}
    assert second["view"]["networks"][0]["joined"]
    assert PASSWORD not in json.dumps(second, ensure_ascii=False)


def test_a_page_on_a_machine_without_wifi_is_told_why(machine: Machine) -> None:
    no_radio(machine)
    told = asyncio.run(Networks(machine.wifi).state(asked("http", "127.0.0.1:1")))
    assert told["view"] is None
    assert "has no Wi-Fi" in told["why"]
