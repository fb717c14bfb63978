"""`lightprobe hil`: its table, its report, what it leaves behind, and the command itself."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path

import pytest
from hil_wire import RigWire, greeted
from lightprobe.errors import UsageError
from lightprobe.hil import report as reports
from lightprobe.hil import run as hil
from lightprobe.hil.bench import Bench
from lightprobe.hil.check import Check, Group, Verdict
from lightprobe.mcu import link as mcu_link
from lightprobe.mcu import messages as mcu
from lightprobe.mcu.link import Raw
from rig import HOST, ROOT, Rig

MakeRig = Callable[..., Rig]
PAGE = ROOT / "docs" / "users" / "hil.md"
PARAM_SET = mcu.encode("ParamSet", param=0, value=0)[0]
PATIENCE_S = 120  # machines may be busy


# --- the table ---------------------------------------------------------------------------------


@pytest.mark.parametrize("check", hil.ALL, ids=lambda one: one.name)
def test_the_source_of_a_bound_says_so(check: Check) -> None:
    assert check.source.words in (ROOT / check.source.file).read_text()


def test_the_page_lists_the_checks_as_they_are() -> None:
    row = r"^\| `([\w-]+)` \| (.*?) \| (.*?) \| (.*?) \| (.*?) \|$"
    rows = re.findall(row, PAGE.read_text(), re.M)
    assert rows == [
        (
            one.name, "" if one.group is Group.READ else f"`--{one.group.value}`", one.asks,
            one.bound, f"[{one.source.file}](../../{one.source.file})",
        )
        for one in hil.ALL
    ]  # fmt: skip


def test_names_are_unique_and_what_a_check_needs_comes_before_it() -> None:
    names = [one.name for one in hil.ALL]
    assert len(set(names)) == len(names)
    for at, one in enumerate(hil.ALL):
        assert set(one.needs) <= set(names[:at])


def test_every_fault_of_the_firmware_has_one_check_that_judges_it() -> None:
    owned = [fault for one in hil.ALL for fault in one.faults]
    assert len(set(owned)) == len(owned)
    assert set(owned) == set(mcu.fault_names().values())


def test_an_unknown_check_is_refused_with_those_there_are() -> None:
    with pytest.raises(UsageError, match=r"wheel-hom: unknown; known are versions, identity"):
        hil.choose((), ["wheel-hom"])


# --- what it leaves behind ---------------------------------------------------------------------


def state(rig: Rig) -> tuple[str, list[int]]:
    """Everything that is stored, and all parameters."""
    rig.run(100_000)
    return rig.command("eeprom"), [rig.param_value(name) for name in mcu.param_names().values()]


def prepared(make_rig: MakeRig, **options: object) -> Rig:
    """A chip with a parameter that was changed, but not saved."""
    rig = make_rig(**options)
    rig.param("hold_max_ds", 77)
    return rig


def test_without_an_option_nothing_moves_and_nothing_is_changed(make_rig: MakeRig) -> None:
    rig = prepared(make_rig)
    rig.command("servo")
    before, wire = state(rig), RigWire(rig)
    bench = Bench(greeted(wire), 2.0)
    findings = hil.run(bench, hil.choose([Group.READ]), lambda check, finding: None)
    assert {one.verdict for one in findings.values()} == {Verdict.PASS}
    assert rig.command("servo").split()[0] == "0"  # no pulse
    assert state(rig) == before


def test_moves_put_everything_back_and_save_nothing(make_rig: MakeRig) -> None:
    rig = prepared(make_rig)
    before, wire = state(rig), RigWire(rig)
    bench = Bench(greeted(wire), 2.0)
    findings = hil.run(bench, hil.choose([Group.MOVES]), lambda check, finding: None)
    assert findings["wheel-stop"].verdict is Verdict.PASS
    assert findings["settings"].verdict is Verdict.PASS
    assert rig.get("powered") == 0
    assert state(rig) == before


def interrupted_at(wire: RigWire, name: str, number: int) -> None:
    """Ctrl-C when so many messages of a kind have been sent."""
    sent = {"times": 0}

    def repair(raw: Raw) -> Raw:
        assert isinstance(raw, bytes)
        envelope = mcu_link.cobs_decode(raw[:-1])
        message = mcu_link.unpack_envelope(envelope) if envelope else None
        if message and mcu.decode(*message).name == name:
            sent["times"] += 1
            if sent["times"] == number:
                raise KeyboardInterrupt
        return raw

    wire.repair = repair


@pytest.mark.parametrize(
    ("name", "number"), [("ParamSet", 2), ("WheelMove", 3), ("WheelAction", 1)]
)
def test_ctrl_c_puts_parameters_back_and_lets_the_servo_go(
    make_rig: MakeRig, name: str, number: int
) -> None:
    """ParamSet 2: between the change of a parameter and the way back."""
    rig = prepared(make_rig)
    before, wire = state(rig), RigWire(rig)
    bench = Bench(greeted(wire), 2.0)
    interrupted_at(wire, name, number)
    with pytest.raises(KeyboardInterrupt):
        hil.run(bench, hil.choose([Group.MOVES]), lambda check, finding: None)
    assert not bench.unrestored
    rig.run(100_000)
    assert rig.get("powered") == 0
    assert state(rig) == before


def test_what_could_not_be_put_back_is_told(make_rig: MakeRig) -> None:
    """The cable is pulled between the change of a parameter and the way back."""
    wire = RigWire(prepared(make_rig, target="host"))
    bench = Bench(greeted(wire), 2.0)
    sent = {"sets": 0}

    def repair(raw: Raw) -> Raw | None:
        assert isinstance(raw, bytes)
        envelope = mcu_link.cobs_decode(raw[:-1])
        sent["sets"] += bool(envelope) and envelope[0] == PARAM_SET
        return raw if sent["sets"] < 2 else None

    wire.repair = repair
    findings = hil.run(bench, hil.choose((), ["settings"]), lambda check, finding: None)
    assert "fell silent" in findings["settings"].measured
    report = reports.Report(hil.choose((), ["settings"]), findings, {}, {}, bench.unrestored)
    assert "not put back: hold_max_ds" in report.words


# --- the report --------------------------------------------------------------------------------


class Page(HTMLParser):
    """What a page loads from elsewhere, and what it contains."""

    def __init__(self) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.loads += [value or "" for key, value in attrs if key in ("src", "href")]


@pytest.fixture
def report(make_rig: MakeRig) -> reports.Report:
    """Of a box whose sensor 3 is dead; its wheel turns."""
    rig = make_rig(hello=False, target="host")
    rig.set(ldr3_forced=0)
    rig.command("run 1500000")
    bench = Bench(greeted(RigWire(rig)), 2.0)
    checks = hil.choose([Group.READ, Group.MOVES])
    started = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
    facts = reports.facts_of(bench, "A50285BI", started)
    findings = hil.run(bench, checks, lambda check, finding: None)
    return reports.Report(checks, findings, facts, bench.series, bench.unrestored)


def test_the_report_for_programs_has_box_checks_and_series(report: reports.Report) -> None:
    found = json.loads(reports.as_json(report))
    assert found["passed"] is False
    assert found["box"]["serial number"] == "A50285BI"
    assert found["box"]["date"] == "2026-01-02T03:04:05+00:00"
    assert found["box"]["firmware"].count(".") == 2
    verdicts = {one["name"]: one["verdict"] for one in found["checks"]}
    assert {name for name, verdict in verdicts.items() if verdict == "fail"} == {"ring-alive"}
    (dead,) = (one for one in found["checks"] if one["name"] == "ring-alive")
    assert "sensor 3" in dead["next_step"]
    assert len(found["series"]["ring_levels"][0]) == 9
    assert len(found["series"]["latency_ms"]) == 100
    angles = [measured for _, measured, _ in found["series"]["wheel"] if measured is not None]
    assert max(angles) == pytest.approx(180, abs=1)


def test_the_page_shows_all_checks_with_three_plots_and_loads_nothing(
    report: reports.Report,
) -> None:
    text = reports.as_html(report)
    page = Page()
    page.feed(text)
    assert page.loads == []
    assert page.tags.count("svg") == 3
    assert "url(" not in text
    assert "@import" not in text
    assert page.tags.count("tr") == 1 + len(report.checks)
    for one in report.checks:
        assert f"<td>{one.name}<td" in text
    assert "sensor 3: its wires" in text


# --- the command, on a pseudo terminal ---------------------------------------------------------


@pytest.fixture
def port(tmp_path: Path) -> Iterator[tuple[Path, Callable[[str], str]]]:
    """A box in real time: its serial line, and a function that commands it."""
    line = tmp_path / "tty"
    command = [str(HOST).removesuffix("-asan"), "--pty", str(line)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    ) as box:
        assert box.stdin is not None
        assert box.stdout is not None

        def tell(text: str) -> str:
            box.stdin.write(text + "\n")
            return box.stdout.readline().strip()

        tell("time")  # the line is there when it answers
        yield line, tell
        box.stdin.close()


def lightprobe(*options: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "lightprobe", "hil", *map(str, options)]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)


def test_the_command_reports_a_box_on_a_serial_line(
    port: tuple[Path, Callable[[str], str]], tmp_path: Path
) -> None:
    """Only checks that no pause of a busy machine can fail."""
    line, _ = port
    files = tmp_path / "hil.json", tmp_path / "hil.html"
    checks = ("versions", "identity", "parameters", "supply")
    options = [word for name in checks for word in ("--only", name)]
    done = lightprobe(f"serial:{line}", *options, "--json", files[0], "--html", files[1],
                      "--seconds", "1")  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 passed, 0 failed, 0 skipped" in done.stdout
    found = json.loads(files[0].read_text())
    assert [one["name"] for one in found["checks"]] == list(checks)
    assert found["box"]["port"] == f"serial:{line}"
    assert "4 passed" in files[1].read_text()


def test_the_command_fails_with_a_box_that_fails(
    port: tuple[Path, Callable[[str], str]],
) -> None:
    line, tell = port
    tell("set supply_mv 3300")
    done = lightprobe(line, "--only", "supply", "--seconds", "1")
    assert done.returncode == 1, done.stdout + done.stderr
    assert re.search(r"fail +supply +\d\.\d\d V", done.stdout)
    assert "→ too low" in done.stdout


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["serial:/nowhere/tty"], "open: No such file or directory: is it plugged in?"),
        (["usb:0"], "unknown carrier"),
        (["serial:/nowhere/tty", "--only", "colour"], "--only colour: unknown; known are"),
        (["serial:/nowhere/tty", "--html", "/nowhere/hil.html"], "/nowhere/hil.html"),
    ],
)
def test_what_cannot_be_run_is_told_apart_from_a_box_that_fails(
    options: list[str], words: str
) -> None:
    done = lightprobe(*options)
    assert done.returncode == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr


def test_somebody_who_says_nothing_is_no_box() -> None:
    master, slave = os.openpty()
    done = lightprobe(f"serial:{os.ttyname(slave)}")
    os.close(master)
    os.close(slave)
    assert done.returncode == 2
    assert "no answer" in done.stderr


def test_ctrl_c_ends_the_command_and_the_servo_is_let_go(
    port: tuple[Path, Callable[[str], str]],
) -> None:
    line, tell = port
    command = [sys.executable, "-um", "lightprobe", "hil", str(line)]
    for name in ("home", "angles", "time", "sweep", "repeat", "ends"):  # half a minute
        command += ["--only", f"wheel-{name}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        assert run.stdout is not None
        while b"wheel-home" not in run.stdout.readline():
            assert run.poll() is None
        run.send_signal(signal.SIGINT)
        assert run.wait(PATIENCE_S) == 130
        assert run.stderr is not None
        assert b"Traceback" not in run.stderr.read()
    assert float(tell("get powered")) == 0


def test_the_list_needs_no_box() -> None:
    done = lightprobe("--list")
    assert done.returncode == 0
    for one in hil.ALL:
        assert one.name in done.stdout
