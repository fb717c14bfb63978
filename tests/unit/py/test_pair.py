"""What `lightprobe pair` tells: a command that serves the address, and an address that is found."""

import pytest
from lightprobe import installation
from lightprobe.cli import pair


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A folder as `make install` leaves it, with this Python in it."""
    prefix = tmp_path / "usr"
    for name in ("lib/lightprobe/web/index.html", "share/lightprobe/drop-ins/wss.conf"):
        (prefix / name).parent.mkdir(parents=True)
        (prefix / name).touch()
    python = prefix / "lib/lightprobe/venv/bin/python"
    monkeypatch.setattr(installation.sys, "executable", str(python))
    return prefix


def test_the_command_for_the_service_serves_the_viewer(installed):
    command = pair.next_command(pair._SERVICE_FOLDER, 7702)
    assert f"{installed}/share/lightprobe/drop-ins/wss.conf" in command
    credentials = "/run/credentials/lightprobed.service"
    line = f"publish = wss:0.0.0.0:7702?pair={credentials}&root={installed}/lib/lightprobe/web"
    assert f'echo "{line}" >>/etc/lightprobe/lightprobed.conf' in command
    assert command.endswith("systemctl restart lightprobed'")


def test_the_command_for_a_user_serves_the_viewer(installed, tmp_path):
    command = pair.next_command(tmp_path / "mine", 7703)
    web = installed / "lib/lightprobe/web"
    assert f" --publish='wss:0.0.0.0:7703?pair={tmp_path}/mine&root={web}'" in command


def test_a_name_that_nothing_announces_is_not_shown(tmp_path, monkeypatch):
    hosts = ["probe.local", "192.168.1.20"]
    monkeypatch.setattr(pair, "_ANNOUNCER", tmp_path / "socket")
    assert pair.shown_host(hosts) == "192.168.1.20"
    (tmp_path / "socket").touch()
    assert pair.shown_host(hosts) == "probe.local"
    assert pair.shown_host(["10.0.0.1", "probe.local"]) == "10.0.0.1"
