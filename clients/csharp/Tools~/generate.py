"""Write Runtime/Messages.cs, the messages of proto/lightprobe.proto in C#.

Unity's users have no protoc, so the result is committed; `make check` tells when it is old.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from html import escape
from pathlib import Path

from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    EnumDescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)

ROOT = Path(__file__).resolve().parents[3]
OUT = ROOT / "clients/csharp/Runtime/Messages.cs"
Comments = dict[tuple[int, ...], str]

#: C# type, and the method of reader and writer.
_SCALARS = {
    FieldDescriptorProto.TYPE_UINT32: ("uint", "UInt32"),
    FieldDescriptorProto.TYPE_INT32: ("int", "Int32"),
    FieldDescriptorProto.TYPE_UINT64: ("ulong", "UInt64"),
    FieldDescriptorProto.TYPE_FIXED32: ("uint", "FixedUInt32"),
    FieldDescriptorProto.TYPE_FIXED64: ("ulong", "FixedUInt64"),
    FieldDescriptorProto.TYPE_SFIXED64: ("long", "FixedInt64"),
    FieldDescriptorProto.TYPE_BOOL: ("bool", "Bool"),
    FieldDescriptorProto.TYPE_FLOAT: ("float", "Float"),
    FieldDescriptorProto.TYPE_STRING: ("string", "String"),
    FieldDescriptorProto.TYPE_BYTES: ("byte[]", "Bytes"),
}
_FLAGS = ("LightFlag", "EstimateFlag")
_HEAD = """// SPDX-License-Identifier: Apache-2.0
// Generated from proto/lightprobe.proto by clients/csharp/Tools~/generate.py: do not edit.
using System;
using System.Collections.Generic;

namespace Lightprobe.Messages
{
"""


def pascal(name: str) -> str:
    """Give snake_case or UPPER_CASE as PascalCase."""
    return "".join(part.capitalize() for part in name.lower().split("_"))


def described() -> tuple[FileDescriptorProto, Comments]:
    """Read the schema, and the comment of each of its parts by its path."""
    with tempfile.NamedTemporaryFile() as file:
        command = ["protoc", f"-I{ROOT / 'proto'}", "--include_source_info", f"-o{file.name}"]
        subprocess.run([*command, "lightprobe.proto"], check=True)
        (schema,) = FileDescriptorSet.FromString(Path(file.name).read_bytes()).file
    comments = {
        tuple(place.path): (place.leading_comments + place.trailing_comments)
        for place in schema.source_code_info.location
    }
    return schema, comments


def type_name(full: str) -> str:
    """Give `.lightprobe.v1.SphericalHarmonics.Kind` as `SphericalHarmonicsKind`."""
    return "".join(full.split(".")[3:])


def summary(comments: Comments, path: tuple[int, ...], indent: str) -> list[str]:
    """Give the comment of a part as C# has it."""
    text = " ".join(comments.get(path, "").split())
    return [f"{indent}/// <summary>{escape(text, quote=False)}</summary>"] if text else []


def enum(
    name: str, one: EnumDescriptorProto, comments: Comments, path: tuple[int, ...]
) -> list[str]:
    """Give an enum; the prefix of its values goes."""
    lines = summary(comments, path, "    ")
    if name in _FLAGS:
        lines.append("    [Flags]")
    lines += [f"    public enum {name} : uint", "    {"]
    for number, value in enumerate(one.value):
        lines += summary(comments, (*path, 2, number), "        ")
        short = pascal(value.name).removeprefix(name).removeprefix(pascal(one.name))
        lines.append(f"        {short} = {value.number},")
    return [*lines, "    }", ""]


def field_type(field: FieldDescriptorProto) -> str:
    """Give the C# type of a field."""
    if field.type in (FieldDescriptorProto.TYPE_MESSAGE, FieldDescriptorProto.TYPE_ENUM):
        name = type_name(field.type_name)
    else:
        name = _SCALARS[field.type][0]
    if field.label == FieldDescriptorProto.LABEL_REPEATED:
        return f"List<{name}>"
    return f"{name}?" if field.proto3_optional and not is_class(field) else name


def is_class(field: FieldDescriptorProto) -> bool:
    """Whether absent is null in C#."""
    return field.type == FieldDescriptorProto.TYPE_MESSAGE


def default(field: FieldDescriptorProto) -> str:
    """Give what a field holds before it is read."""
    if field.label == FieldDescriptorProto.LABEL_REPEATED:
        return f" = new {field_type(field)}()"
    if field.type == FieldDescriptorProto.TYPE_STRING:
        return ' = ""'
    return " = new byte[0]" if field.type == FieldDescriptorProto.TYPE_BYTES else ""


def reading(message: str, field: FieldDescriptorProto) -> str:
    """Give the statement that reads a field."""
    name, text = pascal(field.name), f'"{message}.{field.name}"'
    repeated = field.label == FieldDescriptorProto.LABEL_REPEATED
    if is_class(field) and repeated:
        return (
            f"m.{name}.Add({type_name(field.type_name)}.Read(r.Repeated({text}, m.{name}.Count)));"
        )
    if is_class(field):
        read = f"{type_name(field.type_name)}.Read(r.Message({text}))"
        # Of a oneof, the last one on the wire is valid: a new message forgets those before it.
        is_choice = field.HasField("oneof_index") and not field.proto3_optional
        return f"m = new {message} {{ {name} = {read} }};" if is_choice else f"m.{name} = {read};"
    if repeated and field.type == FieldDescriptorProto.TYPE_STRING:
        return f"r.Strings({text}, m.{name});"
    if repeated:
        return f"r.Floats({text}, m.{name});"
    if field.type == FieldDescriptorProto.TYPE_ENUM:
        return f"m.{name} = ({type_name(field.type_name)})r.UInt32({text});"
    return f"m.{name} = r.{_SCALARS[field.type][1]}({text});"


def writing(field: FieldDescriptorProto) -> str:
    """Give the statement that writes a field."""
    name, number = pascal(field.name), field.number
    if is_class(field):
        return f"if ({name} != null) w.Message({number}, {name}.Write(new WireWriter()));"
    if field.label == FieldDescriptorProto.LABEL_REPEATED:
        return f"w.Floats({number}, {name});"
    if field.type == FieldDescriptorProto.TYPE_ENUM:
        return f"w.UInt32({number}, (uint){name});"
    method = _SCALARS[field.type][1]
    if field.proto3_optional:
        return f"if ({name}.HasValue) w.{method}({number}, {name}.Value, true);"
    return f"w.{method}({number}, {name});"


def message(
    one: DescriptorProto, comments: Comments, path: tuple[int, ...], is_sent: bool, is_read: bool
) -> list[str]:
    """Give a message: its fields, how clients read it, and how they write it."""
    lines = summary(comments, path, "    ")
    lines += [f"    public sealed class {one.name}", "    {"]
    for number, field in enumerate(one.field):
        lines += summary(comments, (*path, 2, number), "        ")
        kind = field_type(field)
        keep = "readonly " if field.label == FieldDescriptorProto.LABEL_REPEATED else ""
        lines.append(f"        public {keep}{kind} {pascal(field.name)}{default(field)};")
    if is_read:
        lines += ["", f"        internal static {one.name} Read(WireReader r)", "        {"]
        lines += [
            f"            var m = new {one.name}();",
            "            while (r.Next(out int field))",
        ]
        lines += ["                switch (field)", "                {"]
        lines += [
            f"                    case {f.number}: {reading(one.name, f)} break;" for f in one.field
        ]
        lines += ["                    default: r.Skip(); break;", "                }"]
        lines += ["            return m;", "        }"]
    if is_sent:
        lines += ["", "        internal WireWriter Write(WireWriter w)", "        {"]
        lines += [f"            {writing(field)}" for field in one.field]
        lines += ["            return w;", "        }"]
    return [*lines, "    }", ""]


def within(schema: FileDescriptorProto, root: str) -> set[str]:
    """Give a message and all that it holds."""
    by_name = {one.name: one for one in schema.message_type}
    found, open_ = set(), [root]
    while open_:
        name = open_.pop()
        found.add(name)
        open_ += [type_name(f.type_name) for f in by_name[name].field if is_class(f)]
    return found


def generated() -> str:
    """Give the whole file."""
    schema, comments = described()
    to_probe, from_probe = within(schema, "FromClient"), within(schema, "FromProbe")
    lines: list[str] = []
    for number, one in enumerate(schema.enum_type):
        lines += enum(one.name, one, comments, (5, number))
    for number, parent in enumerate(schema.message_type):
        for inner, one in enumerate(parent.enum_type):
            lines += enum(parent.name + one.name, one, comments, (4, number, 4, inner))
        directions = (parent.name in to_probe, parent.name in from_probe)
        lines += message(parent, comments, (4, number), *directions)
    return _HEAD + "\n".join(lines).rstrip() + "\n}\n"


if __name__ == "__main__":
    OUT.write_text(generated())
    sys.stdout.write(f"generate: {OUT.relative_to(ROOT)}\n")
