"""What cameras do to their pictures has one list of names; schema and page have the same."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]


def names() -> list[str]:
    """As C has them (daemon/include/processing.h)."""
    text = (ROOT / "daemon/include/processing.h").read_text()
    return re.findall(r'\[LP_PROCESSING_\w+\] = "([^"]+)"', text)


def test_the_schema_has_the_same_names():
    text = (ROOT / "proto/lightprobe.proto").read_text()
    comment = re.search(r"as far as they tell:(.*?)\.\n", text, re.DOTALL)
    assert comment
    assert re.findall(r"[a-z-]{2,}", comment[1]) == names()


def test_the_page_explains_each():
    page = (ROOT / "docs/users/cameras.md").read_text()
    assert (
        re.findall(
            r"^\| `([a-z-]+)` \| .*\| .*\|$", page.partition("## Processing")[2], re.MULTILINE
        )[: len(names())]
        == names()
    )
