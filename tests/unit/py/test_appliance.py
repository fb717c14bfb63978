"""What a probe's card does at each start (packaging/image): names, networks, access."""

import configparser
import json
import os
import stat
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe.network import profile, wifi
from lightprobe.network.profile import Profile
from lightprobe.panel import actions

IMAGE = Path(__file__).parents[3] / "packaging/image"
sys.path.insert(0, str(IMAGE / "files/usr/lib/lightprobe/image"))

import appliance  # noqa: E402
import owner_settings  # noqa: E402


class Programs:
    """Answers for the programs that the appliance runs, and what was run."""

    def __init__(self, fails: Sequence[str] = (), active: str = "", stations: str = "") -> None:
        self.fails, self.active, self.stations = fails, active, stations
        self.ran: list[list[str]] = []

    def __call__(self, words: Sequence[str]) -> str:
        self.ran.append(list(words))
        if words[0] in self.fails:
            raise OSError(f"{words[0]}: refused")
        if words[:2] == ["lightprobe", "pair"]:
            Path(words[words.index("--dir") + 1]).mkdir(exist_ok=True)
            return json.dumps({"url": "https://10.42.0.1:7702/#token=t&sha256=ab"})
        if words[:1] == ["findmnt"]:
            return "/dev/mmcblk0p3\n"
        if words[:1] == ["lsblk"]:
            return "mmcblk0\n"
        if words[0] == "nmcli" and "show" in words:
            return self.active
        if words[0] == "iw" and "dump" in words:
            return self.stations
        return ""


def card(tmp_path: Path, programs: Programs, settings: str | None = "") -> appliance.Appliance:
    """An appliance whose folders are here."""
    for name in ("boot", "state", "factory", "profiles"):
        (tmp_path / name).mkdir(exist_ok=True)
    if settings is not None:
        (tmp_path / "boot/lightprobe.txt").write_text(settings)
    (tmp_path / "factory/lightprobed.conf").write_text("source = v4l2:\n")
    return appliance.Appliance(
        boot=tmp_path / "boot", state=tmp_path / "state", factory=tmp_path / "factory",
        profiles=tmp_path / "profiles", run=programs,
    )  # fmt: skip


def keyfile(path: Path) -> configparser.ConfigParser:
    found = configparser.ConfigParser(interpolation=None, delimiters=("=",))
    found.read(path)
    return found


def test_the_file_on_the_card_is_right_as_it_is(tmp_path):
    shipped = IMAGE / "lightprobe.txt"
    found = owner_settings.read_settings(shipped.read_text())
    assert (found.values, found.problems) == ({}, [])
    lines = [line for line in shipped.read_text().splitlines() if line[:1] not in ("", "#")]
    names = [line.split("=")[0].strip() for line in lines]
    assert names == list(owner_settings.FORMS)


def test_a_first_start_makes_name_networks_and_access(tmp_path):
    programs = Programs()
    assert card(tmp_path, programs).start() == []
    name = (tmp_path / "state/name").read_text().strip()
    assert name.startswith("lightprobe-")
    assert (tmp_path / "state/lightprobed.conf").read_text() == "source = v4l2:\n"
    access = (tmp_path / "boot/access.txt").read_text()
    secret = (tmp_path / "state/access-point-password").read_text().strip()
    owner = (tmp_path / "state/pair/owner").read_text().strip()
    assert secret in access
    assert f"https://{name}.local:7703/setup.html#owner={owner}" in access
    assert f"https://{name}.local:7702/#token=t&sha256=ab" in access
    point = keyfile(tmp_path / "profiles/lightprobe.nmconnection")
    assert point["wifi"]["mode"] == "ap"
    assert point["wifi-security"]["psk"] == secret
    ssid = bytes(int(one) for one in point["wifi"]["ssid"].split(";") if one)
    assert ssid.decode() == name
    assert not (tmp_path / "profiles/home.nmconnection").exists()
    for path in (tmp_path / "profiles").iterdir():  # NetworkManager ignores others
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert ["hostname", name] in programs.ran


def test_a_second_start_changes_nothing_and_does_not_write_the_card(tmp_path):
    card(tmp_path, Programs()).start()
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    again = Programs()
    assert card(tmp_path, again).start() == []
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert not any("remount,rw" in words for words in again.ran)


@pytest.mark.parametrize("torn", ["", "How to reach", "\0" * 600, "\udcff"])
def test_access_that_was_torn_is_written_again(tmp_path, torn):
    card(tmp_path, Programs()).start()
    file = tmp_path / "boot/access.txt"
    whole = file.read_text()
    file.write_bytes(torn.encode(errors="surrogateescape"))
    assert card(tmp_path, Programs()).start() == []
    assert file.read_text() == whole


@pytest.mark.parametrize("coding", ["utf-8-sig", "cp1252"])
def test_the_known_wifi(tmp_path, coding):
    text = "country = DE\r\nwifi-name = Café  Müller\r\nwifi-password =  a b=c;#d \r\n"
    programs = Programs()
    one = card(tmp_path, programs)
    (tmp_path / "boot/lightprobe.txt").write_bytes(text.encode(coding))
    assert one.start() == []
    home = keyfile(tmp_path / "profiles/home.nmconnection")
    ssid = bytes(int(one) for one in home["wifi"]["ssid"].split(";") if one)
    assert ssid.decode() == "Café  Müller"
    assert home["wifi-security"]["psk"] == "a b=c;#d"
    assert ["iw", "reg", "set", "DE"] in programs.ran


def test_another_number_makes_all_access_anew(tmp_path):
    def secrets():
        return {
            name: (tmp_path / "state" / name).read_text()
            for name in ("access-point-password", "pair/owner")
        }

    card(tmp_path, Programs(), "access-number = 1\n").start()
    first = secrets()
    card(tmp_path, Programs(), "access-number = 1\n").start()
    assert secrets() == first
    card(tmp_path, Programs(), "access-number = 2\n").start()
    assert not set(secrets().values()) & set(first.values())
    assert secrets()["pair/owner"].strip() in (tmp_path / "boot/access.txt").read_text()


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("name = my probe", "name is left out"),
        ("name = -x", "name is left out"),
        ("country = Germany", "country is left out"),
        ("wifi-name = home", "its name and its password"),
        ("wifi-password = 1234567\nwifi-name = home", "8 to 63"),
        ("wifi-password = 12345678\nwifi-name = " + "ü" * 17, "32 bytes"),
        ("wifi-password = 12345678\nwifi-name = M\ufffdller", "32 bytes"),
        ("access-point-password = short", "8 to 63"),
        ("wifi = x", "not a setting"),
        ("hello", "not a setting"),
    ],
)
def test_what_is_wrong_is_said_and_left_out(tmp_path, line, said):
    problems = card(tmp_path, Programs(), line + "\n").start()
    assert any(said in one for one in problems), problems
    assert said in (tmp_path / "boot/access.txt").read_text()
    assert not (tmp_path / "profiles/home.nmconnection").exists()
    assert (tmp_path / "profiles/lightprobe.nmconnection").exists()


@given(st.text())
def test_no_text_stops_it_or_gets_out_of_its_line(text):
    found = owner_settings.read_settings(text)
    made = appliance.profiles("lightprobe-1", found, "abcdefgh")
    for one in made.values():
        sections = [line for line in one.splitlines() if line.startswith("[")]
        assert len(sections) == len(set(sections))
    assert all(
        owner_settings.FORMS[name][0].fullmatch(value) for name, value in found.values.items()
    )


@pytest.mark.parametrize("program", ["lightprobe", "mount", "hostname", "iw", "findmnt"])
def test_a_program_that_fails_is_said_and_the_rest_is_done(tmp_path, program):
    problems = card(tmp_path, Programs(fails=[program]), "country = US\n").start()
    assert any(f"{program}: refused" in one for one in problems)
    assert (tmp_path / "profiles/lightprobe.nmconnection").exists()


def test_without_the_first_partition_the_probe_has_its_name_and_access_point(tmp_path):
    problems = card(tmp_path, Programs(), None).start()
    assert any("lightprobe.txt cannot be read" in one for one in problems)
    assert (tmp_path / "profiles/lightprobe.nmconnection").exists()


def test_a_certificate_that_is_damaged_or_for_another_name_is_made_anew(tmp_path):
    class Refuses(Programs):
        def __call__(self, words: Sequence[str]) -> str:
            if words[:2] == ["lightprobe", "pair"] and "--new" not in words:
                self.ran.append(list(words))
                raise OSError("lightprobe: expired")
            return super().__call__(words)

    programs = Refuses()
    assert card(tmp_path, programs).start() == []
    assert any("--new" in words for words in programs.ran)


def test_settings_that_were_changed_are_kept(tmp_path):
    one = card(tmp_path, Programs())
    (tmp_path / "state/lightprobed.conf").write_text("source = osc:x\n")
    one.start()
    assert (tmp_path / "state/lightprobed.conf").read_text() == "source = osc:x\n"


@pytest.mark.parametrize("writes", range(1, 4))
def test_a_file_is_the_old_or_the_new_one(tmp_path, monkeypatch, writes):
    """The power fails at the first, second or third call of the system that counts."""
    file = tmp_path / "access.txt"
    file.write_text("old")
    left = [writes]

    def counted(call):
        def counts(*args, **named):
            left[0] -= 1
            if left[0] == 0:
                raise KeyboardInterrupt
            return call(*args, **named)

        return counts

    monkeypatch.setattr(os, "fsync", counted(os.fsync))
    monkeypatch.setattr(os, "replace", counted(os.replace))
    with pytest.raises(KeyboardInterrupt):
        appliance.write_whole(file, "new")
    assert file.read_text() in ("old", "new")
    assert (file.read_text() == "new") == (writes == 3)


UP_HOME = ["nmcli", "--wait", "60", "connection", "up", "home"]
UP = ["nmcli", "--wait", "60", "connection", "up", "lightprobe"]
DOWN = ["nmcli", "connection", "down", "lightprobe"]
JOINED = "Station 02:00:00:00:00:01 (on wlan0)\n"


@pytest.mark.parametrize(
    ("active", "stations", "known", "open_s", "does"),
    [
        ("lo:lo\n", "", False, None, UP),
        ("", "", True, None, UP),
        ("Wired connection 1:eth0\nlo:lo\n", "", True, None, None),
        ("home:wlan0\n", "", True, None, None),
        ("lightprobe:wlan0\nlo:lo\n", "", True, 10, None),
        ("lightprobe:wlan0\nlo:lo\n", "", True, 400, UP_HOME),
        ("lightprobe:wlan0\nlo:lo\n", JOINED, True, 400, None),
        ("lightprobe:wlan0\n", "", False, 400, None),
        ("lightprobe:wlan0\nWired connection 1:eth0\n", "", False, 10, DOWN),
        ("lightprobe:wlan0\nWired connection 1:eth0\n", JOINED, False, 10, None),
        # The button has opened it.
        ("lightprobe:wlan0\nWired connection 1:eth0\n", "", True, None, None),
        ("lightprobe:wlan0\n", "", True, None, None),
    ],
)
def test_the_access_point_is_open_where_there_is_no_other_network(
    tmp_path, monkeypatch, active, stations, known, open_s, does
):
    programs = Programs(active=active, stations=stations)
    one = card(tmp_path, programs)
    opened = tmp_path / "opened"
    monkeypatch.setattr(appliance, "OPENED", opened)
    if known:
        (tmp_path / "profiles/home.nmconnection").write_text("")
    if open_s is not None:
        opened.touch()
        os.utime(opened, (time.time() - open_s,) * 2)
    one.look_for_network()
    asked = [words for words in programs.ran if "show" not in words and "dump" not in words]
    assert asked == ([does] if does else [])


def test_the_button_and_the_image_mean_the_same_access_point():
    assert appliance.ACCESS_POINT == actions.ACCESS_POINT


def test_without_the_known_wifi_the_access_point_opens_again(tmp_path, monkeypatch):
    class Away(Programs):
        def __call__(self, words: Sequence[str]) -> str:
            if list(words) == UP_HOME:
                self.ran.append(list(words))
                raise OSError("no such network")
            return super().__call__(words)

    programs = Away(active="lightprobe:wlan0\n")
    one = card(tmp_path, programs)
    monkeypatch.setattr(appliance, "OPENED", tmp_path / "opened")
    (tmp_path / "profiles/home.nmconnection").write_text("")
    (tmp_path / "opened").touch()
    os.utime(tmp_path / "opened", (0, 0))
    one.look_for_network()
    assert [words for words in programs.ran if words[0] == "nmcli" and "up" in words] == [
        UP_HOME,
        UP,
    ]


def test_a_certificate_that_was_renewed_restarts_what_uses_it(tmp_path):
    class Renews(Programs):
        made = "old"

        def __call__(self, words: Sequence[str]) -> str:
            said = super().__call__(words)
            if words[:2] == ["lightprobe", "pair"]:
                folder = Path(words[words.index("--dir") + 1])
                (folder / "certificate.pem").write_text(self.made)
            return said

    programs = Renews()
    one = card(tmp_path, programs)
    one.start()
    (tmp_path / "boot/access.txt").write_text("with what went wrong at the start\n")
    one.renew()
    assert not any(words[0] == "systemctl" for words in programs.ran)
    assert "at the start" in (tmp_path / "boot/access.txt").read_text()
    programs.made = "new"
    one.renew()
    assert ["systemctl", "restart", "lightprobed", "lightprobe-setup"] in programs.ran


def test_the_clock_begins_with_the_last_synchronisation(tmp_path, monkeypatch):
    set_to = []
    monkeypatch.setattr(time, "clock_settime", lambda _clock, to: set_to.append(to))
    clock = tmp_path / "clock"
    clock.touch()
    monkeypatch.setattr(appliance, "CLOCKS", (clock, tmp_path / "none"))
    os.utime(clock, (time.time() + 1000,) * 2)
    card(tmp_path, Programs()).keep_clock()
    os.utime(clock, (time.time() - 1000,) * 2)
    card(tmp_path, Programs()).keep_clock()
    assert len(set_to) == 1


def test_a_file_system_grows_also_where_the_partition_has_grown_before(tmp_path):
    programs = Programs()
    card(tmp_path, programs).grow()  # sfdisk tells of no free space
    assert ["resize2fs", "/dev/mmcblk0p3"] in programs.ran


JOINED_NETWORK = Profile(b"caf\xe9 <b>\n", profile.WPA2, "12345678", hidden=False)


def join(folder: Path, one: Profile = JOINED_NETWORK) -> str:
    """As `lightprobe wifi join` keeps it; gives its connection's UUID."""
    folder.mkdir(exist_ok=True)
    profile.write(profile.file_of(folder, one.ssid), one.text())
    return profile.uuid_of(one.ssid)


def test_a_network_that_was_joined_outlives_a_restart(tmp_path):
    assert card(tmp_path, Programs()).start() == []
    assert stat.S_IMODE((tmp_path / "state/networks").stat().st_mode) == 0o700
    join(tmp_path / "state/networks")
    assert card(tmp_path, Programs()).start() == []
    file = profile.file_of(tmp_path / "profiles", JOINED_NETWORK.ssid)
    assert file.read_text() == JOINED_NETWORK.text()
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


def test_a_damaged_network_is_said_and_the_others_are_there(tmp_path):
    (tmp_path / "state").mkdir()
    join(tmp_path / "state/networks")
    damaged = profile.file_of(tmp_path / "state/networks", b"other")
    damaged.write_bytes(b"\0\xff" * 40)
    problems = card(tmp_path, Programs()).start()
    assert problems == [f"{damaged}: is damaged: join that network again"]
    assert profile.file_of(tmp_path / "profiles", JOINED_NETWORK.ssid).exists()
    assert not profile.file_of(tmp_path / "profiles", b"other").exists()


def test_command_and_image_mean_the_same_folders():
    assert appliance.STATE / appliance.NETWORKS == wifi.KEPT
    assert appliance.PROFILES == wifi.IN_MEMORY
    assert appliance.OPENED == wifi.OPENED


def test_each_known_network_has_its_turn(tmp_path, monkeypatch):
    class Away(Programs):
        def __call__(self, words: Sequence[str]) -> str:
            said = super().__call__(words)
            if "up" in words and list(words) != UP:
                raise OSError("no such network")
            return said

    monkeypatch.setattr(appliance, "OPENED", tmp_path / "opened")
    monkeypatch.setattr(time, "sleep", lambda _s: None)
    programs = Away(active="lightprobe:wlan0\n")
    one = card(tmp_path, programs)
    (tmp_path / "profiles/home.nmconnection").write_text("[connection]\nid=home\n")
    uuid = join(tmp_path / "profiles")
    (tmp_path / "opened").touch()
    for _ in range(3):
        os.utime(tmp_path / "opened", (0, 0))
        one.look_for_network()
        one.look_for_network()  # too early
    tried = [words[5:] for words in programs.ran if "up" in words and list(words) != UP]
    assert tried == [["home"], ["uuid", uuid], ["home"]]
    assert (tmp_path / "opened").read_text() == "3"


def test_a_network_that_came_up_by_itself_is_left_alone(tmp_path, monkeypatch):
    class Another(Programs):
        def __call__(self, words: Sequence[str]) -> str:
            said = super().__call__(words)
            if "up" in words:
                self.active = "wifi x\\:y:wlan0\n"
                raise OSError("no such network")
            return said

    monkeypatch.setattr(appliance, "OPENED", tmp_path / "opened")
    monkeypatch.setattr(time, "sleep", lambda _s: None)
    programs = Another(active="lightprobe:wlan0\n")
    one = card(tmp_path, programs)
    (tmp_path / "profiles/home.nmconnection").touch()
    join(tmp_path / "profiles")
    (tmp_path / "opened").touch()
    os.utime(tmp_path / "opened", (0, 0))
    one.look_for_network()
    assert UP not in programs.ran
