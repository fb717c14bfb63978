"""What the tests cost: a table by room and by file, of the longest tests too.

`make test TIMES=1` prints it. Seconds of a processor count a test's own process and the programs
that it has started and waited for; they change little with what else the machine does.
"""

from __future__ import annotations

import resource
from collections import defaultdict
from collections.abc import Generator, Iterable
from dataclasses import dataclass
from typing import Any

import pytest

SHOWN = 40  # files, and tests
_PROPERTY = "processor_s"


@dataclass
class Cost:
    """Of a test, or a group of tests."""

    tests: int = 0
    wall_s: float = 0.0
    own_s: float = 0.0  # processor seconds of the test's process
    programs_s: float = 0.0  # and those of programs that it has started

    def add(self, other: Cost) -> None:
        """Add what other tests cost."""
        self.tests += other.tests
        self.wall_s += other.wall_s
        self.own_s += other.own_s
        self.programs_s += other.programs_s

    @property
    def processor_s(self) -> float:
        """Seconds of a processor."""
        return self.own_s + self.programs_s


class Times:
    """A plugin of pytest; with pytest-xdist one per process, of which the controller prints."""

    def __init__(self) -> None:
        self._costs: dict[str, Cost] = defaultdict(Cost)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, Any, Any]:
        """Keep what the processors have done until the test."""
        self._before = _used_s()
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """Write into each report what the processors have done since the last one."""
        now = _used_s()
        spent = [b - a for a, b in zip(self._before, now, strict=True)]
        self._before = now
        report = yield
        report.user_properties = [(_PROPERTY, spent)]
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Count a part of a test."""
        own_s, programs_s = dict(report.user_properties).get(_PROPERTY, (0.0, 0.0))
        last = int(report.when == "teardown")
        self._costs[report.nodeid].add(Cost(last, report.duration, own_s, programs_s))

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print the tables."""
        terminalreporter.section("what the tests cost")
        for line in table(self._costs):
            terminalreporter.write_line(line)


def table(costs: dict[str, Cost]) -> Iterable[str]:
    """Lines: all, each room, the most expensive files and tests."""
    for title, end in (("room", "/"), ("file", "::"), ("test", None)):
        groups: dict[str, Cost] = defaultdict(Cost)
        for test, cost in costs.items():
            groups[test.split(end)[0] if end else test].add(cost)
        yield f"{'processor s':>12}{'its programs':>14}{'wall s':>10}{'tests':>7}  {title}"
        order = sorted(groups.items(), key=lambda one: -one[1].processor_s)
        for name, cost in order[:SHOWN]:
            yield _line(name, cost)
        if title == "room":
            total = Cost()
            for cost in groups.values():
                total.add(cost)
            yield _line("all", total)


def _line(name: str, cost: Cost) -> str:
    return (
        f"{cost.processor_s:12.1f}{cost.programs_s:14.1f}{cost.wall_s:10.1f}{cost.tests:7}  {name}"
    )


def _used_s() -> tuple[float, float]:
    """Seconds of a processor that this process and its ended children have used."""
    own, programs = (
        resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return own.ru_utime + own.ru_stime, programs.ru_utime + programs.ru_stime
