"""Golden bytes of lightprobe.v1: from one list of expected values to a Python message and to C.

`proto/golden/v1.json` maps a file of frozen bytes to {path: value}. A path is what C writes to
reach the field (`estimate.lights[0].direction[2]`); null says that an optional field is absent;
every repeated field has a `NAME_count`; "0x…" are the bytes of a field of bytes, and the path of a
message without fields is its name alone.

    golden.py header    print the expectations as C, for tests/unit/test_golden.c
    golden.py freeze    write the files that are named and do not exist yet; never changes one
"""

import json
import re
import sys
from pathlib import Path
from typing import Any

GOLDEN = Path(__file__).resolve().parents[2] / "proto" / "golden"
EXPECTED = GOLDEN / "v1.json"
STEP = re.compile(r"(\w+)(?:\[(\d+)\])?")
CLIENT = "from_client"
#: The daemon writes it and reads none: test_codec.c compares the bytes that it writes.
NOT_IN_C = "reflection_map"


def expectations() -> dict[str, dict[str, Any]]:
    """Expected values by file name."""
    return json.loads(EXPECTED.read_text())


def steps(path: str) -> list[tuple[str, int | None]]:
    """Split a path into field names and indices."""
    return [
        (name, int(index) if index else None)
        for name, index in (STEP.fullmatch(part).groups() for part in path.split("."))
    ]


def root(values: dict[str, Any]) -> str:
    """Name of the message that a file holds."""
    return next(iter(values)).split(".")[0]


def read(message: Any, path: str) -> Any:
    """Value at `path` of a decoded message; None for an optional field that is absent."""
    *parents, (name, index) = steps(path)
    if not parents:
        return bool(message.HasField(name))
    for field, position in parents:
        message = getattr(message, field)
        message = message if position is None else message[position]
    if name.endswith("_count") and name not in message.DESCRIPTOR.fields_by_name:
        return len(getattr(message, name.removesuffix("_count")))
    descriptor = message.DESCRIPTOR.fields_by_name[name]
    if descriptor.has_presence and not message.HasField(name):
        return None
    value = getattr(message, name)
    value = value if index is None else value[index]
    return f"0x{value.hex()}" if isinstance(value, bytes) else value


def write(message: Any, path: str, value: Any) -> None:
    """Set `path` of a message that is being built."""
    from google.protobuf.descriptor import FieldDescriptor

    *parents, (name, index) = steps(path)
    if not parents:
        return
    if isinstance(value, str) and value.startswith("0x"):
        value = bytes.fromhex(value[2:])
    for field, position in parents:
        message = getattr(message, field)
        if position is not None:
            while len(message) <= position:
                message.add()
            message = message[position]
    if value is None or (name.endswith("_count") and name not in message.DESCRIPTOR.fields_by_name):
        return
    if message.DESCRIPTOR.fields_by_name[name].type == FieldDescriptor.TYPE_BYTES:
        so_far = getattr(message, name)
        whole = value if index is None else so_far.ljust(index, b"\0") + bytes([value])
        setattr(message, name, whole)
    elif index is None:
        setattr(message, name, value)
    else:
        assert index == len(getattr(message, name)), path
        getattr(message, name).append(value)


def decode(name: str) -> Any:
    """Decode the frozen bytes (with their length prefix) of one file."""
    from google.protobuf.proto import parse_length_prefixed
    from lightprobe_proto import lightprobe_pb2 as pb

    kind = pb.FromClient if name.startswith(CLIENT) else pb.FromProbe
    with open(GOLDEN / name, "rb") as file:
        message = parse_length_prefixed(kind, file)
        assert file.read() == b"", name
    return message


def as_c(path: str, value: Any) -> str:
    """One expectation as a macro of test_golden.c."""
    if value is None:
        parent, _, field = path.rpartition(".")
        return f"ABSENT({parent}.has_{field})"
    if "." not in path:
        return ""
    if isinstance(value, str) and value.startswith("0x"):
        octets = "".join(f"\\x{octet:02x}" for octet in bytes.fromhex(value[2:]))
        return f'BYTES({path}, "{octets}")'
    if isinstance(value, str):
        return f"TEXT({path}, {json.dumps(value)})"
    if isinstance(value, float):
        return f"REAL({path}, {value!r})"
    return f"WHOLE({path}, {int(value)}{'ULL' if value > 2**31 else ''})"


def header() -> str:
    """All expectations as C."""
    lines = ["/* Generated from proto/golden/v1.json. */"]
    for name, values in expectations().items():
        if root(values) == NOT_IN_C:
            continue
        kind = "CLIENT" if name.startswith(CLIENT) else "PROBE"
        lines.append(f'{kind}({Path(name).stem}, "{name}", {root(values)},')
        lines += [f"\t{as_c(path, value)}" for path, value in values.items()]
        lines.append(")")
    return "\n".join(lines)


def freeze() -> None:
    """Write what is not frozen yet."""
    from google.protobuf.proto import serialize_length_prefixed
    from lightprobe_proto import lightprobe_pb2 as pb

    for name, values in expectations().items():
        if (GOLDEN / name).exists():
            continue
        message: Any = pb.FromClient() if name.startswith(CLIENT) else pb.FromProbe()
        getattr(message, root(values)).SetInParent()
        for path, value in values.items():
            write(message, path, value)
        with open(GOLDEN / name, "wb") as file:
            serialize_length_prefixed(message, file)
        print(f"golden: {name}: frozen")


if __name__ == "__main__":
    if sys.argv[1:] == ["header"]:
        print(header())
    elif sys.argv[1:] == ["freeze"]:
        freeze()
    else:
        sys.exit(__doc__)
