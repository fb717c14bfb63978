"""Which tests run together in one process."""

from pathlib import Path

import pytest
from schedule import ByFixtures

SHARED = """
import pytest
@pytest.fixture(scope="module")
def slow(): return 1
"""


def test_only_tests_that_share_fixtures_stay_together(
    tmp_path: Path, pytestconfig: pytest.Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "test_a.py").write_text(SHARED)
    (tmp_path / "test_b.py").write_text("def test_x(): pass\n")
    monkeypatch.setattr(type(pytestconfig), "rootpath", tmp_path)
    scheduler = ByFixtures.__new__(ByFixtures)
    scheduler.config = pytestconfig
    scopes = [
        scheduler._split_scope(nodeid)
        for nodeid in ("test_a.py::x", "test_a.py::y[1]", "test_b.py::x", "test_b.py::y")
    ]
    assert scopes == ["test_a.py", "test_a.py", "test_b.py::x", "test_b.py::y"]
