"""Which failed tests may run once more."""

import json
from pathlib import Path

import again
import pytest


@pytest.mark.parametrize(("count", "status"), [(1, 0), (2, 0), (3, 1), (40, 1)])
def test_a_second_run_is_for_one_or_two(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], count: int, status: int
) -> None:
    record = tmp_path / "v/cache/lastfailed"
    record.parent.mkdir(parents=True)
    names = {f"e2e/test_a.py::test_{k}": True for k in range(count)}
    record.write_text(json.dumps(names))
    assert again.main(tmp_path) == status
    said = capsys.readouterr().out
    assert all(name in said for name in names)
    assert f"{count} failed" in said
