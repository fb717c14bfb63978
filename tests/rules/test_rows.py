"""Of a long table one row runs by day, and each of them once."""

from pathlib import Path

import pytest

pytest_plugins = ["pytester"]
TESTS = Path(__file__).resolve().parents[1]
TABLES = """
import pytest

@pytest.mark.nightly_rows
@pytest.mark.parametrize("b", [1, 2])
@pytest.mark.parametrize("a", [pytest.param(0, marks=pytest.mark.nightly), 1, 2])
def test_long(a, b): pass

@pytest.mark.parametrize("a", [1, 2])
def test_short(a): pass

@pytest.mark.nightly
def test_night(): pass
"""


@pytest.mark.parametrize(
    ("chosen", "names"),
    [
        ("not nightly", {"test_long[1-1]", "test_short[1]", "test_short[2]"}),
        ("nightly", {"test_long[0-1]", "test_long[0-2]", "test_long[1-2]", "test_long[2-1]",
                     "test_long[2-2]", "test_night"}),
    ],
)  # fmt: skip
def test_one_row_runs_by_day(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, chosen: str, names: set[str]
) -> None:
    monkeypatch.syspath_prepend(TESTS)
    pytester.makeini("[pytest]\nmarkers =\n    nightly:\n    nightly_rows:\n")
    pytester.makeconftest("""
        import pytest
        import rows

        @pytest.hookimpl(tryfirst=True)
        def pytest_collection_modifyitems(items):
            rows.mark(items)
    """)
    pytester.makepyfile(TABLES)
    done = pytester.inline_run("-m", chosen, "-p", "no:cacheprovider", "-p", "no:asyncio")
    passed, _, failed = done.listoutcomes()
    assert not failed
    assert {report.nodeid.split("::")[1] for report in passed} == names
