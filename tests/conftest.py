"""Shared by all Python tests."""

import os
from pathlib import Path
from typing import Any

import hypothesis
import progress
import pytest
import times
from hypothesis.database import DirectoryBasedExampleDatabase

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "build"
GATE = "CI" in os.environ

# No deadlines: the machine may be busy. What a failure needs to be seen again lies under build/.
# Every run looks at other examples; a gate ($CI) at the same ones, so that it judges the change.
hypothesis.settings.register_profile(
    "lightprobe",
    deadline=None,
    max_examples=int(os.environ.get("HYPOTHESIS_EXAMPLES", "50")),
    derandomize=GATE,
    database=None if GATE else DirectoryBasedExampleDatabase(BUILD / "cache" / "hypothesis"),
)
hypothesis.settings.load_profile("lightprobe")


def pytest_configure(config: pytest.Config) -> None:
    """Say now and then how far it is, and at the end what each test cost, if $TIMES asks for it."""
    config.pluginmanager.register(progress.Progress(BUILD / "cache" / "test_seconds.json"))
    if os.environ.get("TIMES"):
        config.pluginmanager.register(times.Times())


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give the tests to several processes."""
    import schedule  # xdist may be missing where one process runs the tests

    return schedule.ByFixtures(config, log)


def daemon_path(variant: str) -> Path:
    """Path of the daemon as built in a variant; fails when `make` has not built it."""
    path = BUILD / variant / "bin" / "lightprobed"
    assert path.is_file(), f"{path} is missing: make VARIANT={variant} daemon"
    return path


@pytest.fixture(autouse=True)
def _sanitized_daemon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every test runs the daemon that has the sanitizers in it, unless it asks for another."""
    monkeypatch.setenv("LIGHTPROBED", str(BUILD / "asan" / "bin" / "lightprobed"))
    monkeypatch.setenv("LIGHTPROBE_SCENES", str(BUILD / "scenes"))


@pytest.fixture
def released_daemon(monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run the daemon as it ships: where it is the speed or the numbers that count."""
    path = daemon_path("release")
    monkeypatch.setenv("LIGHTPROBED", str(path))
    return path
