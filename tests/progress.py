"""A line now and then: how many tests are done, and about how long the rest takes.

How long a test took in the last run is kept in build/cache/test_seconds.json; the long ones are
begun first, so that no processor waits for them at the end.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest

EVERY_S = 30.0
UNKNOWN_S = 1.0  # a test that has never been run here


class Progress:
    """A plugin of pytest; with pytest-xdist one per process, of which the controller prints."""

    def __init__(self, record: Path) -> None:
        self._record = record
        self._known: dict[str, float] = {}
        if record.exists():
            self._known = json.loads(record.read_text())
        self._seconds: dict[str, float] = {}
        self._collected: list[str] = []
        self._done: set[str] = set()
        self._begin_s = self._said_s = time.monotonic()
        self._workers = 1

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Begin with what takes longest; all processes must have the same order."""
        items.sort(key=lambda item: -self._known.get(item.nodeid, UNKNOWN_S))
        self._collected = [item.nodeid for item in items]

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, node: Any, ids: list[str]) -> None:
        """Learn from a worker what there is."""
        self._collected = ids
        self._workers = int(node.workerinput["workercount"])

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Count a part of a test."""
        self._seconds[report.nodeid] = self._seconds.get(report.nodeid, 0) + report.duration
        if report.when != "teardown":
            return
        self._done.add(report.nodeid)
        now_s = time.monotonic()
        if now_s - self._said_s >= EVERY_S:
            self._said_s = now_s
            print(f"\n{self.line(now_s - self._begin_s)}", flush=True)

    def line(self, elapsed_s: float) -> str:
        """Say how far it is, `elapsed_s` after the beginning."""
        left = [test for test in self._collected if test not in self._done]
        expected_s = sum(self._known.get(test, UNKNOWN_S) for test in left) / self._workers
        spent_s = sum(self._known.get(test, UNKNOWN_S) for test in self._done) / self._workers
        if spent_s > 0:  # faster or slower than last time
            expected_s *= elapsed_s / spent_s
        return (
            f"tests: {len(self._done)} of {len(self._collected)} after {elapsed_s / 60:.1f} min, "
            f"about {expected_s / 60:.1f} min left"
        )

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Keep how long each test took."""
        if hasattr(session.config, "workerinput") or not self._seconds:
            return
        self._record.parent.mkdir(parents=True, exist_ok=True)
        self._record.write_text(json.dumps(self._known | self._seconds, indent=0))
