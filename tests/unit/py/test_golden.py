"""Frozen bytes of every released message decode for ever: in Python here, in C in test_golden.c."""

import golden
import pytest

EXPECTED = golden.expectations()


@pytest.mark.parametrize("name", EXPECTED)
def test_golden_bytes_decode(name: str) -> None:
    message = golden.decode(name)
    values = EXPECTED[name]
    assert message.WhichOneof("message") == golden.root(values)
    assert {path: golden.read(message, path) for path in values} == values


def test_every_frozen_file_has_expectations() -> None:
    assert {path.name for path in golden.GOLDEN.glob("*.bin")} == set(EXPECTED)


@pytest.mark.parametrize("name", EXPECTED)
def test_expectations_name_every_field(name: str) -> None:
    """A field that nobody compares could rot."""
    named = {path.split(".")[1].split("[")[0] for path in EXPECTED[name] if "." in path}
    message = getattr(golden.decode(name), golden.root(EXPECTED[name]))
    missing = {field.name for field in message.DESCRIPTOR.fields} - named
    assert {field for field in missing if f"{field}_count" not in named} == set()
