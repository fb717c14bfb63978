"""Shared by all Python tests."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hypothesis
import progress
import pytest
import rows
import times
from hypothesis.database import DirectoryBasedExampleDatabase

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "build"
GATE = "CI" in os.environ

# What runs in the background of a shell, or under nohup, starts with these ignored, and so would
# every program that a test starts and then ends by them.
for number, handler in (
    (signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL),
):  # fmt: skip
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)

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


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Before `-m` chooses: which rows of long tables wait for the night."""
    rows.mark(items)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give the tests to several processes."""
    import schedule  # xdist may be missing where one process runs the tests

    return schedule.ByFixtures(config, log)


def daemon_path(variant: str) -> Path:
    """Path of the daemon as built in a variant: `make VARIANT=variant daemon`."""
    return BUILD / variant / "bin" / "lightprobed"


@pytest.fixture(autouse=True, scope="module")
def _daemon_of_the_file(request: pytest.FixtureRequest) -> Iterator[None]:
    """Run the daemon with the sanitizers, or as it ships where the file has the mark many_frames.

    With the sanitizers it is five times as slow. $SANITIZED takes them for all files.
    """
    many_frames = request.node.get_closest_marker("many_frames") and "SANITIZED" not in os.environ
    with pytest.MonkeyPatch.context() as environment:
        # It need not be there: rules run before anything is built.
        environment.setenv("LIGHTPROBED", str(daemon_path("release" if many_frames else "asan")))
        environment.setenv("LIGHTPROBE_SCENES", str(BUILD / "scenes"))
        yield


@pytest.fixture
def released_daemon(monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run the daemon as it ships: where its speed counts."""
    path = daemon_path("release")
    assert path.is_file(), f"{path} is missing: make daemon"
    monkeypatch.setenv("LIGHTPROBED", str(path))
    return path
