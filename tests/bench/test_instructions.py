"""The hot path takes no more instructions than on record (tests/bench/instructions.json)."""

import platform

import instructions
import pytest


def marked(case):
    """Give a case of instructions.CASES; two run in `make test-nightly` alone."""
    marks = [pytest.mark.nightly] if case[1] in ("exposures_2", "fast") else []
    return pytest.param(case, marks=marks, id=" ".join(case))


@pytest.mark.long
@pytest.mark.parametrize("case", [marked(case) for case in instructions.CASES])
def test_counts_are_those_on_record(case):
    """After a change for the better or with good reason: `make instructions`, and commit it."""
    recorded = instructions.recorded()
    if recorded is None:
        pytest.skip(f"no counts on record for {platform.machine()}")
    name = " ".join(case)
    new = instructions.measure(*case)
    assert new[instructions.WHOLE] >= new["lp_jpeg_read"] > 1e6
    changed = instructions.differences({name: recorded[name]}, {name: new})
    assert not changed, [f"{what}: {a} -> {b} ({b / a - 1:+.1%})" for what, a, b in changed]


def test_differences_are_seen():
    old = {"a": {"f": 1000, "g": 1000}}
    assert instructions.differences(old, {"a": {"f": 1049, "g": 951}}) == []
    assert instructions.differences(old, {"a": {"f": 1051, "g": 1000}}) == [("a f", 1000, 1051)]
    assert instructions.differences(old, {"a": {"f": 1000}}) == [("a g", 1000, 0)]
