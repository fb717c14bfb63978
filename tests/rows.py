"""Which rows of a test's table run by day: the mark nightly_rows (pytest.ini)."""

from __future__ import annotations

from collections.abc import Iterable

import pytest


def mark(items: Iterable[pytest.Item]) -> None:
    """Give the mark nightly to all rows but the first, where a test has the mark nightly_rows.

    A row that has the mark nightly already is none of the day's.
    """
    seen = set()
    for item in items:
        if item.get_closest_marker("nightly_rows") and not item.get_closest_marker("nightly"):
            test = item.nodeid.split("[")[0]
            if test in seen:
                item.add_marker(pytest.mark.nightly)
            seen.add(test)
