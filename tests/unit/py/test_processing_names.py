"""What cameras do to their pictures has one list of names; schema and page have the same."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]


HEADER = (ROOT / "daemon/include/processing.h").read_text()


def names() -> list[str]:
    """As C has them (daemon/include/processing.h)."""
    table = re.search(r"names\[LP_PROCESSING_KINDS\] = {([^}]*)}", HEADER)
    assert table
    return re.findall(r'"([^"]+)"', table[1])


def test_names_are_in_the_order_of_the_kinds():
    kinds = re.findall(r"^\tLP_PROCESSING_(\w+),", HEADER, re.MULTILINE)
    assert [kind.lower().replace("_", "-") for kind in kinds] == names()


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
