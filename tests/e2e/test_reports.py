"""Pictures as people have them: the right light, or a refusal that says why, from every preset."""

import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[1] / "files"
sys.path.insert(0, str(FOLDER))
import files  # noqa: E402


@pytest.mark.usefixtures("released_daemon")
@pytest.mark.parametrize("file", files.FILES, ids=[file.name for file in files.FILES])
def test_the_right_light_or_a_refusal(file):
    found = [files.fault(file, answer) for answer in files.answers(file)]
    assert found
    assert not any(found), [fault for fault in found if fault]


def test_the_page_lists_them_all():
    """After a change: `build/venv/bin/python tests/files/files.py`."""
    page = (FOLDER.parents[1] / "docs/users/accuracy.md").read_text()
    part = page.partition("<!-- generated: files -->")[2].partition("<!-- end -->")[0]
    listed = [line.split(" | ")[0].lstrip("| ") for line in part.splitlines()[2:]]
    assert listed[1:] == [file.name for file in files.FILES]
