"""`lightprobe doctor`: sound probes are sound, sick ones are named."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from lightprobe import daemon
from lightprobe.cli import doctor
from lightprobe.client import Client
from lightprobe.estimate import EstimateFlag

ROOT = Path(__file__).resolve().parents[2]
LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
LONG_S = 90


def examine(*arguments):
    """(exit code, findings by name)."""
    command = [LIGHTPROBE, "doctor", *map(str, arguments), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LONG_S)
    assert "Traceback" not in done.stderr
    report = json.loads(done.stdout)
    assert report["ok"] == (done.returncode == 0)
    return done.returncode, {finding["check"]: finding for finding in report["findings"]}


@pytest.fixture(scope="module", autouse=True)
def _no_devices_of_this_machine():
    """Devices that the machine may have are not what these tests are about."""
    if any(Path("/dev").glob("video*")):
        pytest.skip("this machine has cameras: their permissions would decide the exit code")


def test_a_sound_probe(tmp_path, probe):
    with probe(tmp_path) as uri:
        # The sanitizers' daemon is slow to start; give it its time.
        code, found = examine(uri, "--wait", LONG_S / 3)
        text = subprocess.run([LIGHTPROBE, "doctor", uri], capture_output=True, text=True)
    assert code == 0, found
    for check in ("python package", "daemon", "versions", "socket", "connection", "estimate",
                  "source", "load"):  # fmt: skip
        assert found[check]["verdict"] == "ok", found[check]
    assert "streaming" in found["source"]["detail"]
    assert "sim" in found["probe"]["detail"]
    assert text.returncode == 0
    assert "estimates/s" in text.stdout


def test_flags_are_told_in_words(tmp_path, probe):
    # Nobody says what the exposure is, and nobody sets it.
    with probe(tmp_path, faults="hide_exposure=1", daemon_options=["--brackets=0"]) as uri:
        code, found = examine(uri, "--wait", LONG_S / 3)
    assert code == 0
    assert found["flag EXPOSURE_UNKNOWN"]["verdict"] == "warn"
    assert "fixed exposure" in found["flag EXPOSURE_UNKNOWN"]["next_step"]


def test_a_camera_that_has_stopped(tmp_path, probe):
    stalling = probe(tmp_path, faults="stall_after=20", daemon_options=["--ttl-ms=300"])
    with stalling as uri, Client(uri) as client:
        while EstimateFlag.STALE not in client.receive(LONG_S).flags:
            pass
        assert client.wait_for(lambda c: c.health.source_state == "STALLED", LONG_S)
        code, found = examine(uri)
    assert code == 1
    assert found["estimate"]["verdict"] == "fail"
    assert found["source"]["verdict"] == "fail"
    assert "stalled" in found["source"]["detail"]


def test_a_camera_that_never_came(tmp_path):
    uri = f"unix:{tmp_path / 'probe.sock'}"
    arguments = [f"--source=sim:{tmp_path / 'nobody'}", f"--publish={uri}"]
    with daemon.Daemon(arguments, tmp_path / "log"):
        while not (tmp_path / "probe.sock").exists():
            pass
        code, found = examine(uri, "--wait", 1)
    assert code == 1
    assert found["connection"]["verdict"] == "ok"
    assert found["estimate"]["verdict"] == "fail"
    assert "waiting" in found["source"]["detail"]


def test_nobody_listens(tmp_path):
    code, found = examine(f"unix:{tmp_path / 'none.sock'}")
    assert code == 1
    assert "no such file" in found["socket"]["detail"]
    assert "--publish=unix:" in found["socket"]["next_step"]
    (tmp_path / "file").touch()
    assert "no socket" in examine(f"unix:{tmp_path / 'file'}")[1]["socket"]["detail"]
    code, found = examine("tcp:127.0.0.1:9", "--wait", 1)
    assert code == 1
    assert "is lightprobed running" in found["connection"]["detail"]
    assert examine("nonsense")[1]["address"]["verdict"] == "fail"


def test_a_daemon_that_is_named_and_not_there(tmp_path, monkeypatch):
    monkeypatch.setenv("LIGHTPROBED", str(tmp_path / "nothing"))
    code, found = examine("tcp:127.0.0.1:9", "--wait", 0.5)
    assert code == 1
    assert found["daemon"]["verdict"] == "fail"
    assert "make build" in found["daemon"]["next_step"]


@pytest.mark.parametrize(
    ("programs", "ruled", "named"),
    [
        (["systemd", "bash"], False, []),
        (["brltty"], True, ["brltty"]),  # no rule of ours keeps it off
        (["ModemManager"], False, ["ModemManager"]),
        (["ModemManager"], True, []),
        (["bash", "brltty", "ModemManager"], False, ["brltty", "ModemManager"]),
    ],
)
def test_programs_that_take_the_serial_port_are_named(tmp_path, programs, ruled, named):
    for number, name in enumerate(programs, 1):
        (tmp_path / f"proc/{number}").mkdir(parents=True)
        (tmp_path / f"proc/{number}/comm").write_text(name + "\n")
    (tmp_path / "proc/99").mkdir()  # one that ends meanwhile
    if ruled:
        rules = tmp_path / "usr/local/lib/udev/rules.d"
        rules.mkdir(parents=True)
        shutil.copy(ROOT / "packaging/udev/71-lightprobe-mcu.rules", rules)
    found = list(doctor.grabbers(tmp_path))
    assert [finding.check for finding in found] == [f"program {name}" for name in named]
    assert all(finding.verdict == "warn" and finding.next_step for finding in found)


def test_a_machine_with_a_client_alone(tmp_path, probe, monkeypatch):
    """Neither daemon nor devices are missed where the probe is another machine."""
    with probe(tmp_path) as uri:
        monkeypatch.delenv("LIGHTPROBED")
        monkeypatch.setenv("PATH", "/nowhere")
        # The daemon beside this Python is not to be found either.
        code = "import sys; sys.executable = '/nowhere/python'; from lightprobe.__main__ import *; "
        command = [sys.executable, "-c", code + "main()", "doctor", uri, "--json", "--wait", "60"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=LONG_S)
    found = {finding["check"]: finding for finding in json.loads(done.stdout)["findings"]}
    assert done.returncode == 0, found
    assert found["daemon"] == {
        "check": "daemon", "verdict": "skip", "next_step": "",
        "detail": "not installed; a client does not need one",
    }  # fmt: skip
    assert found["devices"]["verdict"] == "skip"
    assert found["connection"]["verdict"] == "ok"
    assert found["extras"]["detail"] == "cli, sim, mcu, calibrate"
