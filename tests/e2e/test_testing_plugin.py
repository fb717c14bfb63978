"""`lightprobe.testing` as a pytest plug-in: a project of a user's, in a process of its own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from harness import LONG_S
from lightprobe.sim.box import Box

pytestmark = pytest.mark.many_frames

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "host_py" / "examples" / "my_app"
PAGE = ROOT / "docs" / "users" / "testing.md"
CONFTEST = 'pytest_plugins = ["lightprobe.testing.plugin"]\n'
TESTS = """
import pytest
from lightprobe.testing import Options

@pytest.fixture
def probe_options():
    return Options(size_px=(320, 160), rate_hz=10.0)

def test_healthy(probe):
    probe.wait_settled(within_s=8)
    assert probe.health.ring.samples > 0

def test_broken(probe, box):
    box.fault("wheel-stuck")

def test_wrong(probe):
    probe.wait_settled()
    probe.wait_fault("WHEEL_SLIP", within_s=1)
"""


def pytest_of(folder: Path, *arguments: str) -> tuple[int, str]:
    """Exit status of a user's pytest, and what it prints."""
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-rsf", *arguments],
        cwd=folder, capture_output=True, text=True, timeout=10 * LONG_S,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
    )  # fmt: skip
    return done.returncode, done.stdout + done.stderr


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A folder with tests of a user."""
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "test_mine.py").write_text(TESTS)
    return tmp_path


def test_the_report_of_a_failure_has_the_log_of_the_daemon(project: Path) -> None:
    status, out = pytest_of(project)
    assert status == 1
    assert "1 failed, 2 passed" in out
    assert "NotSeen: probe: light: no fault WHEEL_SLIP in 1 s" in out
    section = out.split("- lightprobed, at ")[1]
    assert "hello: firmware" in section


def test_a_real_box_is_used_in_real_time_and_never_broken(project: Path, tmp_path: Path) -> None:
    """Here a simulated one on a port of its own, which the plug-in cannot know."""
    port = tmp_path / "ttyUSB7"
    with Box("host", port) as box:
        start_s = time.monotonic()
        status, out = pytest_of(project, f"--lightprobe-port={port}")
        assert time.monotonic() - start_s > 1
        moves = box.get("wheel_deg")
    assert status == 1
    assert "1 failed, 1 passed, 1 skipped" in out
    assert f"box: {port}: wheel-stuck: a real box cannot do this" in out
    assert moves == pytest.approx(0, abs=5)  # homed


def test_a_port_where_nothing_is_fails_with_the_next_step(project: Path) -> None:
    status, out = pytest_of(project, "--lightprobe-port=/dev/nowhere", "-k", "healthy")
    assert status == 1
    assert "mcu-waiting" in out
    assert "/dev/nowhere" in out


def test_the_example_passes_and_notices_what_breaks() -> None:
    status, out = pytest_of(EXAMPLE)
    assert status == 0, out
    status, out = pytest_of(EXAMPLE, "--lightprobe-fault=wheel-stuck", "-k", "healthy")
    assert status == 1
    assert "INDEX_ALWAYS" in out
    assert "does the wheel turn?" in out
    status, out = pytest_of(EXAMPLE, "--lightprobe-fault=camera-late", "-k", "on_time")
    assert status == 1
    assert "camera-clock" in out


def test_the_first_example_of_the_page_runs_as_printed(tmp_path: Path) -> None:
    example, conftest = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S)[:2]
    (tmp_path / "test_page.py").write_text(example)
    (tmp_path / "conftest.py").write_text(conftest)
    status, out = pytest_of(tmp_path)
    assert status == 0, out
    assert "2 passed" in out


def test_a_fault_that_nobody_knows_is_refused(project: Path) -> None:
    status, out = pytest_of(project, "--lightprobe-fault=wheel-stick")
    assert status == 4
    assert "'wheel-stuck'" in out


def test_without_the_programs_it_says_what_is_missing(project: Path, monkeypatch) -> None:
    monkeypatch.setenv("LIGHTPROBE_FIRMWARE", "/nowhere")
    status, out = pytest_of(project, "-k", "healthy")
    assert status == 1
    assert "firmware host: no lightprobe-mcu-host in /nowhere: build it with" in out


def test_the_package_needs_no_pytest_itself() -> None:
    code = "import sys; sys.modules['pytest'] = None; import lightprobe, lightprobe.cli.main"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=LONG_S)
