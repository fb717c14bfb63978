"""proto/ranges.toml: every number has a line, and the Python client keeps to it.

The same cases for the others: tests/engines/csharp, clients/js/test/ranges.test.ts.
"""

import golden
import pytest
from google.protobuf.descriptor import FieldDescriptor
from lightprobe import wire
from lightprobe_proto import lightprobe_pb2 as pb
from range_cases import PLACES, RANGES, cases, good

#: Their values of the future read as UNKNOWN.
OPEN = {"Health.source_state", "Wheel.phase"}


def messages(descriptor, found):
    """The messages that one holds, by name."""
    if descriptor.name not in found:
        found[descriptor.name] = descriptor
        for field in descriptor.fields:
            if field.type == FieldDescriptor.TYPE_MESSAGE:
                messages(field.message_type, found)
    return found


def needs_a_line(message, field):
    if field.type == FieldDescriptor.TYPE_ENUM:
        return f"{message}.{field.name}" not in OPEN
    share = field.name.endswith(("_permille", "_percent"))
    return share or field.type == FieldDescriptor.TYPE_FLOAT


def test_every_number_that_a_probe_sends_has_a_line():
    sent = messages(pb.FromProbe.DESCRIPTOR, {})
    needed = {
        f"{name}.{field.name}"
        for name, one in sent.items()
        for field in one.fields
        if needs_a_line(name, field)
    }
    there = {f"{name}.{field}" for name, fields in RANGES.items() for field in fields}
    assert needed <= there
    fields = {f"{name}.{field.name}" for name, one in sent.items() for field in one.fields}
    assert there <= fields
    assert set(PLACES) == set(RANGES)


def test_every_line_refuses_something():
    lines = {one.refusal for fields in RANGES.values() for one in fields.values()}
    assert {case.refusal for case in cases()} - {None} == lines


@pytest.mark.parametrize("file", sorted(golden.GOLDEN.glob("[!f]*.bin")), ids=lambda f: f.stem)
def test_what_is_released_is_taken_for_ever(file):
    assert len(wire.Decoder().feed(file.read_bytes())) == 1


@pytest.mark.parametrize("kind", ["estimate", "health", "reflection_map", "polarization_map"])
def test_what_the_cases_change_is_taken_as_it_is(kind):
    assert wire.decode(good(kind).SerializeToString()) is not None


@pytest.mark.parametrize("case", cases(), ids=lambda case: case.name)
def test_a_number_is_taken_or_refused_by_name(case):
    if case.refusal is None:
        assert wire.decode(case.data) is not None
        return
    with pytest.raises(wire.WireError) as told:
        wire.decode(case.data)
    assert str(told.value) == case.refusal
