"""The table of what the tests cost."""

from times import Cost, table


def test_rooms_files_and_tests_are_sums_of_what_their_tests_cost():
    costs = {
        "unit/py/test_a.py::one[x/y]": Cost(1, 3.0, 1.0, 0.5),
        "unit/py/test_a.py::two": Cost(1, 2.0, 0.5, 0.0),
        "e2e/test_b.py::three": Cost(1, 9.0, 1.0, 7.0),
    }
    lines = {line.split()[-1]: line.split()[:-1] for line in table(costs)}
    assert lines["e2e"] == ["8.0", "7.0", "9.0", "1"]
    assert lines["unit"] == lines["unit/py/test_a.py"] == ["2.0", "0.5", "5.0", "2"]
    assert lines["unit/py/test_a.py::one[x/y]"] == ["1.5", "0.5", "3.0", "1"]
    assert lines["all"] == ["10.0", "7.5", "14.0", "3"]
