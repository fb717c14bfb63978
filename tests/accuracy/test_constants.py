"""`make constants` finds every number that it changes, and changes that one only."""

import constants
import pytest

ALL = [*constants.ACCURACY, *(one for group in constants.SEQUENCES.values() for one in group)]


@pytest.mark.parametrize("constant", ALL, ids=lambda constant: constant.name)
def test_a_constant_is_found_and_replaced(constant):
    text = (constants.ROOT / "daemon" / constant.path).read_text()
    present = constant.find(text)
    values = list(constant.others(present))
    assert values
    for value in values:
        assert float(value) != float(present)
        changed = constant.replace(text, value)
        assert constant.find(changed) == value
        assert len(changed) - len(text) == len(value) - len(present)


def test_the_page_says_what_each_does():
    page = constants.PAGE.read_text()
    for constant in ALL:
        assert page.count(f"| {constant.title} |") == 2, constant


def test_rows_of_other_constants_stay_as_they_are():
    rows = constants.written_rows("tests")
    for constant in (one for group in constants.SEQUENCES.values() for one in group):
        assert [row[0] for row in rows[constant.title]] == 2 * [constant.title]
        assert all(len(row) == 4 for row in rows[constant.title])
