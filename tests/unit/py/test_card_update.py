"""Updates of a card: which half starts next, what the owner is told, and files that are sent."""

from __future__ import annotations

import http.client
import itertools
import json
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe.errors import LightprobeError
from lightprobe.setup import card, tasks
from lightprobe.setup.upload import Upload
from typer.testing import CliRunner

IMAGE = Path(__file__).resolve().parents[3] / "packaging/image"
sys.path.insert(0, str(IMAGE / "files/usr/lib/lightprobe/image"))

import update  # noqa: E402


def loader(boot: Path, running: str, ran: list[list[str]] | None = None) -> update.Loader:
    """The halves of a card whose first partition is a folder."""
    said = ran if ran is not None else []
    return update.Loader(
        boot, boot, f"quiet rauc.slot={running}", lambda words: said.append([*words]) or ""
    )


def started(boot: Path) -> list[str]:
    """What the boot loader's script does with the files: the halves, in the order it tries them."""
    said = (boot / "half.env").read_bytes().replace(b"\r\n", b"\n")
    kept = "b" if b"\nhalf=b\n" in b"\n" + said else "a"
    order = [kept, update.other(kept)]
    if (boot / "try").exists():
        (boot / "try").unlink()
        order.reverse()
    return order


@pytest.fixture
def boot(tmp_path: Path) -> Path:
    """As `make image` writes it."""
    (tmp_path / "half.env").write_text("half=a\n")
    return tmp_path


def test_an_update_starts_once_and_is_kept_when_it_is_confirmed(boot: Path) -> None:
    rauc = loader(boot, "a")
    assert update.answer(rauc, ["get-primary"]) == "a"
    assert update.answer(rauc, ["set-state", "b", "bad"]) == ""  # before it is written
    assert update.answer(rauc, ["get-state", "b"]) == "bad"
    assert update.answer(rauc, ["set-primary", "b"]) == ""
    assert update.answer(rauc, ["get-primary"]) == "b"
    assert update.answer(rauc, ["get-state", "b"]) == "good"
    assert started(boot)[0] == "b"
    trial = loader(boot, "b")
    assert (trial.kept, trial.trial) == ("a", None)
    assert update.answer(trial, ["set-state", "b", "good"]) == ""
    assert started(boot)[0] == "b"
    assert (boot / "half.env").read_bytes() == b"half=b\n"


def test_a_trial_that_is_not_confirmed_is_over(boot: Path) -> None:
    loader(boot, "a").start_next("b")
    assert started(boot) == ["b", "a"]
    assert started(boot) == ["a", "b"]


def test_the_half_that_is_kept_cannot_be_spoilt(boot: Path) -> None:
    with pytest.raises(OSError, match="there is no other"):
        update.answer(loader(boot, "a"), ["set-state", "a", "bad"])
    # What does not run has not shown that it is well.
    assert update.answer(loader(boot, "a"), ["set-state", "b", "good"]) == ""
    assert started(boot)[0] == "a"


ASKED = [
    *(["set-primary", half] for half in update.HALVES),
    *(["set-state", half, state] for half in update.HALVES for state in ("good", "bad")),
    ["restart"],
]


@given(asked=st.lists(st.sampled_from(ASKED), max_size=12))
def test_the_kept_half_is_one_that_has_run(
    asked: list[list[str]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    boot = Path(tmp_path_factory.mktemp("boot"))
    (boot / "half.env").write_text("half=a\n")
    running, have_run = "a", {"a"}
    for words in asked:
        if words == ["restart"]:
            running = started(boot)[0]
            have_run.add(running)
            continue
        one = loader(boot, running)
        before = one.kept
        try:
            update.answer(one, words)
        except OSError:
            assert words == ["set-state", before, "bad"]
        assert one.kept in have_run
        assert one.kept == before or words == ["set-state", running, "good"]


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        (b"", "a"), (b"half=c\n", "a"), (b"\xff" * 512, "a"), (b"half=a", "a"),
        (b"half=b\r\n", "b"), (b"# mine\r\nhalf=b\r\n", "b"), (b"half=b \n", "a"),
        (b"half=a\n# kept half\n", "a"),
    ],
)  # fmt: skip
def test_a_file_that_somebody_has_edited_or_damaged(boot: Path, text: bytes, kept: str) -> None:
    (boot / "half.env").write_bytes(text)
    assert loader(boot, "a").kept == kept
    new = loader(boot, update.other(kept))
    new.set_good(new.running)
    assert (new.kept, started(boot)[0]) == (new.running, new.running)
    assert (boot / "half.env").read_bytes() == f"half={new.running}\n".encode()
    (boot / "half.env").unlink()
    assert loader(boot, "a").kept == "a"


@pytest.mark.parametrize(
    "words", [[], ["get-state", "c"], ["set-state", "a", "ugly"], ["set-primary"], ["erase", "a"]]
)
def test_what_is_not_asked_is_refused(boot: Path, words: list[str]) -> None:
    assert update.answer(loader(boot, "a"), words) is None


class Clock:
    """Simulated time."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 1000.0
        monkeypatch.setattr(update.time, "monotonic", lambda: self.now_s)
        monkeypatch.setattr(update.time, "sleep", self.sleep)

    def sleep(self, seconds: float) -> None:
        """Go on."""
        self.now_s += seconds


@pytest.mark.parametrize(
    ("well", "kept_after_s"),
    [
        (lambda s: True, 20.0),
        (lambda s: s > 100, 120.0),  # a slow start
        (lambda s: s % 15 < 10, None),  # it comes and goes
        (lambda s: s < 15, None),  # it dies
        (lambda s: s > 290, None),  # too late
    ],
)
def test_a_trial_is_kept_when_it_is_well_for_a_while(
    boot: Path, monkeypatch: pytest.MonkeyPatch, well, kept_after_s: float | None
) -> None:
    clock, ran = Clock(monkeypatch), []
    one = loader(boot, "b")

    def run(words: list[str]) -> str:
        ran.append(words)
        if words[0] == "rauc":  # which asks this program
            one.set_good("b")
        return ""

    one.run = run
    monkeypatch.setattr(one, "well", lambda: well(clock.now_s - 1000.0))
    assert one.confirm() == (kept_after_s is not None)
    assert (one.kept == "b") == (kept_after_s is not None)
    if kept_after_s is not None:
        assert clock.now_s - 1000.0 == pytest.approx(kept_after_s, abs=update.POLL_S)
    else:
        assert clock.now_s - 1000.0 <= update.PATIENCE_S + update.POLL_S


def test_a_trial_that_cannot_be_kept_is_tried_again_and_then_over(
    boot: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, tries = Clock(monkeypatch), []
    one = loader(boot, "b")

    def run(words: list[str]) -> str:
        if words[0] != "rauc":
            return ""
        tries.append(words)
        if len(tries) < 3:
            raise subprocess.TimeoutExpired(words, 120)
        one.set_good("b")
        return ""

    one.run = run
    monkeypatch.setattr(one, "well", lambda: True)
    assert one.confirm()
    assert len(tries) == 3

    def refused(words: list[str]) -> str:
        raise OSError("the card cannot be written")

    one.run = refused
    (boot / "half.env").write_text("half=a\n")
    before_s = clock.now_s
    assert not one.confirm()
    assert clock.now_s - before_s <= update.PATIENCE_S + update.POLL_S


def test_only_a_trial_is_judged() -> None:
    unit = (IMAGE / "files/etc/systemd/system/lightprobe-confirm.service").read_text()
    assert "\nConditionKernelCommandLine=lightprobe.trial\n" in unit
    assert "\nFailureAction=reboot\n" in unit
    assert "setenv trial lightprobe.trial" in (IMAGE / "boot.cmd").read_text()


def test_a_half_is_well_when_what_ran_before_runs_and_the_page_answers(
    boot: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    down: set[str] = set()
    networks = "lo\neth0\n"

    def run(words: list[str]) -> str:
        """As systemctl: with several names it is content with one that runs."""
        if words[0] == "nmcli":
            return networks
        assert words[:2] == ["systemctl", "is-active"]
        if down >= set(words[2:]):
            raise OSError("inactive")
        return "active\n"

    one = loader(boot, "b")
    one.run = run
    monkeypatch.setattr(update.urllib.request, "urlopen", lambda *_, **__: None)
    assert one.well()
    for unit in ("lightprobed", "lightprobe-setup", "NetworkManager"):
        down = {unit}
        assert not one.well(), unit
    down = set()
    networks = "lo\n"
    assert not one.well()
    networks = "wlan0\n"
    for failure in (OSError("refused"), http.client.BadStatusLine("x")):

        def refused(*_: object, failure: Exception = failure, **__: object) -> None:
            raise failure

        monkeypatch.setattr(update.urllib.request, "urlopen", refused)
        assert not one.well()


def test_what_did_not_run_before_the_update_is_not_asked_for(
    boot: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(words: list[str]) -> str:
        if words == ["systemctl", "is-active", "lightprobed"]:  # its configuration is wrong
            raise OSError("failed")
        return "eth0\n"

    one = loader(boot, "a")
    one.run = run
    monkeypatch.setattr(update.urllib.request, "urlopen", lambda *_, **__: None)
    assert not one.well()
    one.start_next("b")
    trial = loader(boot, "b")
    trial.run = run
    assert trial.well()


# ------------------------------------------------------------------ the command

RAUC = """#!/bin/sh
case $1 in
install)
	echo installing
	printf '  0%% Installing\\n 40%% Copying image to rootfs.1\\n'
	[ -s "$2" ] && { printf '100%% Installing done.\\nidle\\n'; exit 0; }
	printf 'LastError: %s\\nInstalling `/x` failed\\n' "$(cat {folder}/error)"
	exit 1 ;;
status) cat {folder}/status ;;
esac
"""
STATUS = {
    "compatible": "lightprobe-pi4", "booted": "a", "boot_primary": "rootfs.1",
    "slots": [
        {"rootfs.1": {"bootname": "b", "boot_status": "good"}},
        {"rootfs.0": {"bootname": "a", "boot_status": "good"}},
    ],
}  # fmt: skip


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine that runs from a card, as far as the command sees it."""
    (tmp_path / "rauc").write_text(RAUC.replace("{folder}", str(tmp_path)))
    (tmp_path / "rauc").chmod(0o755)
    (tmp_path / "version").write_text("202611301200-abc\n")
    (tmp_path / "status").write_text(json.dumps(STATUS))
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    monkeypatch.setattr(card, "VERSION", tmp_path / "version")
    return tmp_path


def run(*words: str) -> tuple[int, str]:
    """Exit status and words of `lightprobe`."""
    from lightprobe.cli.main import app

    done = CliRunner().invoke(app, ["update", *words])
    return done.exit_code, done.output + (str(done.exception) if done.exception else "")


def test_the_command_says_what_runs(machine: Path) -> None:
    status, said = run()
    assert status == 0
    assert "version 202611301200-abc, half a" in said
    assert "at the next start: half b" in said
    assert json.loads(run("--json")[1])["starts_next"] == "b"
    slots = [{"rootfs.0": {"bootname": "a", "boot_status": "bad"}}]
    (machine / "status").write_text(json.dumps(STATUS | {"slots": slots}))
    assert "a trial" in run()[1]


def test_an_update_is_written_with_its_progress(machine: Path) -> None:
    (machine / "new.raucb").write_text("x")
    status, said = run(str(machine / "new.raucb"))
    assert status == 0, said
    assert " 40 %  Copying image to rootfs.1" in said
    assert "kept if it runs well" in said


@pytest.mark.parametrize(
    ("rauc", "meant"),
    [
        ("signature verification failed: self-signed certificate", "not signed with the key"),
        (
            "Compatible mismatch: Expected 'lightprobe-pi4' but bundle manifest has 'x'",
            "for another machine",
        ),
        (
            "Invalid bundle format: Signature size (55085) exceeds bundle size",
            "no update, or only a part",
        ),
        ("Input/output error", "starts as before"),
    ],
)
def test_a_refusal_names_file_reason_and_next_step(machine: Path, rauc: str, meant: str) -> None:
    (machine / "bad.raucb").write_text("")
    (machine / "error").write_text(rauc)
    status, said = run(str(machine / "bad.raucb"))
    assert status == 1
    assert "update: bad.raucb: " in said
    assert meant.lower() in said.lower()
    assert rauc in said


def test_image_and_set_up_page_mean_the_same_trial() -> None:
    assert update.TRIAL == card.TRIAL


def test_where_there_is_no_card_nothing_is_offered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(card, "VERSION", tmp_path / "none")
    assert "was not started from a card" in run()[1]
    (tmp_path / "x.raucb").write_text("x")
    assert "was not started from a card" in run(str(tmp_path / "x.raucb"))[1]
    assert not [task for task in tasks.offered() if task.of_card]


# ------------------------------------------------------------------ files that are sent


def test_a_task_needs_its_file(machine: Path) -> None:
    task = tasks.named("update")
    folders = {"UPLOAD": machine / "upload"}
    given_fields = {"file": "C:\\fakepath\\new.raucb"}
    with pytest.raises(LightprobeError, match="no file was sent"):
        tasks.words(task, given_fields, folders, machine)
    (machine / "upload").write_text("x")
    assert tasks.words(task, given_fields, folders, machine) == [
        "update", str(machine / "upload"),
    ]  # fmt: skip
    long = {"file": "ü" * 1000 + "\n"}  # its name elsewhere is no matter
    assert tasks.words(task, long, folders, machine)


def test_what_an_earlier_run_left_goes(tmp_path: Path) -> None:
    for name in ("upload", ".upload.part"):
        (tmp_path / name).write_text("x")
    Upload(tmp_path).remove()
    assert not list(itertools.chain(tmp_path.glob("*"), tmp_path.glob(".*")))
