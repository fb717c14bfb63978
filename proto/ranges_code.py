# SPDX-License-Identifier: Apache-2.0
"""Make the checks of ranges.toml for those who do not read it themselves.

ranges_code.py --typescript OUT    the table, for clients/js/src/ranges.ts
ranges_code.py --csharp OUT        clients/csharp/Runtime/Ranges.cs, which is committed
ranges_code.py --header OUT        C, for the daemon (app/codec.c)
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from ranges import HERE, UNIT_TOLERANCE, Range, factor, load


# ---------------------------------------------------------------- TypeScript


def camel(name: str) -> str:
    """Give snake_case as JavaScript has it."""
    return re.sub(r"_(\w)", lambda match: match[1].upper(), name)


def typescript() -> str:
    """Give the table as a module, in JavaScript's names."""

    def factors(count: tuple[int | str, ...]) -> list[Any]:
        split = (factor(one) for one in count)
        return [{"plus": plus, "of": camel(of)} if of else plus for plus, of in split]

    def row(field: str, one: Range) -> dict[str, Any]:
        told = {"field": camel(field), "least": one.least, "most": one.most, "above": one.above,
                "count": factors(one.count or one.bytes) or None, "unit": one.unit or None,
                "absent": one.absent or None, "nan": one.nan or None,
                "oneOf": one.one_of or None, "required": one.required or None,
                "refusal": one.refusal}  # fmt: skip
        return {key: value for key, value in told.items() if value is not None}

    rows = {
        f"lightprobe.v1.{message}": [row(field, one) for field, one in fields.items()]
        for message, fields in load().items()
    }
    table = json.dumps(rows, indent=1, ensure_ascii=False)
    return (
        "// Generated from proto/ranges.toml by proto/ranges.py.\n"
        'import type { Range } from "../ranges.js";\n\n'
        f"export const UNIT_TOLERANCE = {UNIT_TOLERANCE};\n"
        f"export const RANGES: Record<string, Range[]> = {table};\n"
    )


# ---------------------------------------------------------------- the schema


def schema() -> dict[str, Any]:
    """Give the descriptors of the messages by name."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet

    with tempfile.NamedTemporaryFile() as file:
        command = ["protoc", f"-I{HERE}", f"-o{file.name}", "lightprobe.proto"]
        subprocess.run(command, check=True)
        (found,) = FileDescriptorSet.FromString(Path(file.name).read_bytes()).file
    return {one.name: one for one in found.message_type}


def checked(messages: dict[str, Any], name: str, done: list[str]) -> list[str]:
    """Give the messages in one that have ranges, or hold some that have: the inner ones first."""
    for field in messages[name].field:
        if (
            field.type == field.TYPE_MESSAGE
            and (inner := field.type_name.split(".")[-1]) not in done
        ):
            checked(messages, inner, done)
    if name in load() or any(f.type_name.split(".")[-1] in done for f in messages[name].field):
        done.append(name)
    return done


def is_list(field: Any) -> bool:
    """Whether a field is repeated."""
    return bool(field.label == field.LABEL_REPEATED)


# ---------------------------------------------------------------- C#

CSHARP_HEAD = """// SPDX-License-Identifier: Apache-2.0
// Generated from proto/ranges.toml by proto/ranges_code.py: do not edit.
using Lightprobe.Messages;

namespace Lightprobe
{
    /// <summary>What is wrong with a message by proto/ranges.toml, in a sentence that names the field; null: nothing.</summary>
    internal static class Ranges
    {
        /// <summary>How far the length of a unit vector may be from 1.</summary>
        internal const double UnitTolerance = %s;

"""


def pascal(name: str) -> str:
    """Give snake_case as C# has it."""
    return "".join(part.capitalize() for part in name.split("_"))


def csharp_test(field: str, one: Range) -> str:
    """Give the condition under which a field keeps to its line."""
    name = f"m.{pascal(field)}"
    if one.required:
        return f"{name} != null"
    if one.one_of:
        return " || ".join(f"(uint){name} == {value}" for value in one.one_of)
    split = [factor(factors) for factors in one.count or one.bytes]
    count = " * ".join(f"(m.{pascal(of)} + {plus}L)" if of else str(plus) for plus, of in split)
    if one.bytes:
        return f"{name}.Length == {count}"
    least = "double.MinValue" if one.least is None else one.least
    most = "double.MaxValue" if one.most is None else one.most
    above = "double.NegativeInfinity" if one.above is None else one.above
    bounds = f"{least}, {most}, {above}"
    if not one.count:
        return f"RangeCheck.IsInside({name}, {bounds})"
    flags = ", ".join(str(flag).lower() for flag in (one.unit, one.absent, one.nan))
    return f"RangeCheck.Keeps({name}, {count}, {bounds}, {flags})"


def csharp_message(message: Any, known: list[str]) -> list[str]:
    """Give the check of one message: its own fields, then the messages in it."""
    lines = [f"        internal static string Broken({message.name} m)", "        {"]
    for field, one in load().get(message.name, {}).items():
        refusal = json.dumps(one.refusal, ensure_ascii=False)
        lines += [
            f"            if (!({csharp_test(field, one)}))",
            f"                return {refusal};",
        ]
    for field in message.field:
        if field.type_name.split(".")[-1] not in known or field.type != field.TYPE_MESSAGE:
            continue
        name = pascal(field.name)
        if is_list(field):
            lines.append(
                f"            foreach (var one in m.{name}) if (Broken(one) is string told) return told;"
            )
        else:
            lines.append(
                f"            if (m.{name} != null && Broken(m.{name}) is string of{name}) return of{name};"
            )
    return [*lines, "            return null;", "        }", ""]


def csharp() -> str:
    """Give the whole file."""
    messages = schema()
    known = checked(messages, "FromProbe", [])
    lines = [line for name in known for line in csharp_message(messages[name], known)]
    return CSHARP_HEAD % UNIT_TOLERANCE + "\n".join(lines).rstrip() + "\n    }\n}\n"


def main() -> None:
    """Write what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    makers = {"typescript": typescript, "csharp": csharp}
    for name in makers:
        parser.add_argument(f"--{name}", type=Path)
    for name, path in vars(parser.parse_args()).items():
        if path:
            path.write_text(makers[name](), encoding="utf-8")


if __name__ == "__main__":
    main()
