"""Whether a message of a probe holds what proto/ranges.toml allows, packed with this package."""

from __future__ import annotations

import math
from typing import Any

from google.protobuf.descriptor import FieldDescriptor
from lightprobe_proto.ranges import UNIT_TOLERANCE, Range, factor, load

_RANGES = load()


def broken(message: Any) -> str | None:
    """Say which field of a message, or of one in it, is out of its range; None: none is."""
    for field, allowed in _RANGES.get(message.DESCRIPTOR.name, {}).items():
        if not _keeps(message, field, allowed):
            return str(allowed.refusal)
    for descriptor, value in message.ListFields():
        if descriptor.type != FieldDescriptor.TYPE_MESSAGE:
            continue
        for inner in (value,) if hasattr(value, "DESCRIPTOR") else value:
            if (sentence := broken(inner)) is not None:
                return sentence
    return None


def _keeps(message: Any, field: str, allowed: Range) -> bool:
    descriptor = message.DESCRIPTOR.fields_by_name[field]
    if descriptor.has_presence and not message.HasField(field):
        return not allowed.required
    if allowed.required:
        return True
    value = getattr(message, field)
    if allowed.one_of:
        return int(value) in allowed.one_of
    if allowed.bytes:
        return len(value) == _count(message, allowed.bytes)
    if not allowed.count:
        return _is_inside(value, allowed)
    if allowed.absent and not value:
        return True
    if len(value) != _count(message, allowed.count):
        return False
    if allowed.unit and not abs(math.hypot(*value) - 1) <= UNIT_TOLERANCE:
        return False
    return all(_is_inside(one, allowed) for one in value)


def _count(message: Any, factors: tuple[int | str, ...]) -> int:
    split = (factor(one) for one in factors)
    return math.prod(plus + (getattr(message, of) if of else 0) for plus, of in split)


def _is_inside(value: float, allowed: Range) -> bool:
    if math.isnan(value):
        return bool(allowed.nan)
    return (
        math.isfinite(value)
        and (allowed.least is None or value >= allowed.least)
        and (allowed.most is None or value <= allowed.most)
        and (allowed.above is None or value > allowed.above)
    )
