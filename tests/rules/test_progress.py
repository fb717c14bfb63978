"""The line that says how far the tests are."""

from types import SimpleNamespace

import pytest
from progress import Progress


def report(nodeid: str, seconds: float) -> SimpleNamespace:
    return SimpleNamespace(nodeid=nodeid, duration=seconds, when="teardown")


@pytest.fixture
def progress(tmp_path) -> Progress:
    first = Progress(tmp_path / "seconds.json")
    first.pytest_runtest_logreport(report("quick", 2.0))
    first.pytest_runtest_logreport(report("slow", 60.0))
    first.pytest_sessionfinish(SimpleNamespace(config=object()))
    return Progress(tmp_path / "seconds.json")


def test_the_longest_of_the_last_run_come_first(progress):
    items = [SimpleNamespace(nodeid=name) for name in ("new", "quick", "slow")]
    progress.pytest_collection_modifyitems(items)
    assert [item.nodeid for item in items] == ["slow", "quick", "new"]


def test_time_left_is_by_the_last_run_and_by_the_pace_of_this_one(progress):
    items = [SimpleNamespace(nodeid=name) for name in ("slow", "quick")]
    progress.pytest_collection_modifyitems(items)
    assert progress.line(0.0) == "tests: 0 of 2 after 0.0 min, about 1.0 min left"
    progress.pytest_runtest_logreport(report("quick", 4.0))
    assert progress.line(4.0) == "tests: 1 of 2 after 0.1 min, about 2.0 min left"
