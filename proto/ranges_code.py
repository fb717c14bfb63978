# SPDX-License-Identifier: Apache-2.0
"""Make the checks of ranges.toml for those who do not read it themselves.

ranges_code.py --typescript OUT    the table, for clients/js/src/ranges.ts
ranges_code.py --csharp OUT        clients/csharp/Runtime/Ranges.cs, which is committed
ranges_code.py --header OUT        C, for the daemon (serve/codec/codec.c)
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
        "// Generated from proto/ranges.toml by proto/ranges_code.py.\n"
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
    /// <summary>What proto/ranges.toml forbids in a message; null: nothing.</summary>
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
            lines.append(f"            foreach (var one in m.{name})")
            lines.append("                if (Broken(one) is string told) return told;")
        else:
            lines.append(
                f"            if (m.{name} != null && Broken(m.{name}) is string of{name})"
            )
            lines.append(f"                return of{name};")
    return [*lines, "            return null;", "        }", ""]


def csharp() -> str:
    """Give the whole file."""
    messages = schema()
    known = checked(messages, "FromProbe", [])
    lines = [line for name in known for line in csharp_message(messages[name], known)]
    return CSHARP_HEAD % UNIT_TOLERANCE + "\n".join(lines).rstrip() + "\n    }\n}\n"


# ---------------------------------------------------------------- C

C_HEAD = """/* SPDX-License-Identifier: Apache-2.0 */
/* Generated from proto/ranges.toml by proto/ranges_code.py. */
#ifndef LP_WIRE_RANGES_H
#define LP_WIRE_RANGES_H

#include <math.h>
#include <stdbool.h>

#include "proto/lightprobe.pb.h"

static inline bool lp_range_holds(double value, double least, double most, double above)
{
	return isfinite(value) && value >= least && value <= most && value > above;
}

static inline bool lp_range_is_unit(const float *values, size_t count)
{
	double square = 0;

	for (size_t i = 0; i < count; i++)
		square += (double)values[i] * (double)values[i];
	return fabs(sqrt(square) - 1) <= %s;
}
"""


def without_c_field() -> set[str]:
    """Give MESSAGE.field of what lightprobe.options leaves to a callback: C cannot count it."""
    text = (HERE / "lightprobe.options").read_text()
    return set(re.findall(r"^lightprobe\.v1\.(\S+) +type:FT_CALLBACK", text, re.MULTILINE))


def c_bounds(one: Range) -> str:
    """Give the three bounds of a number."""
    least = "-INFINITY" if one.least is None else one.least
    most = "INFINITY" if one.most is None else one.most
    above = "-INFINITY" if one.above is None else one.above
    return f"{least}, {most}, {above}"


def c_field(field: Any, one: Range) -> list[str]:
    """Give what is done about a field that does not keep to its line.

    What may be absent is left out, a number that may be NaN becomes NaN; else the message is not
    sent.
    """
    name, refuse = f"m->{field.name}", f"return {json.dumps(one.refusal, ensure_ascii=False)};"
    split = [factor(each) for each in one.count or one.bytes]
    count = " * ".join(f"(m->{of} + {plus}U)" if of else f"{plus}U" for plus, of in split)
    if one.required:
        return [f"if (!m->has_{field.name})", f"\t{refuse}"]
    if one.one_of:
        wrong = " && ".join(f"(unsigned){name} != {value}" for value in one.one_of)
        return [f"if ({wrong})", f"\t{refuse}"]
    if one.bytes:
        return [f"if ({name}.size != {count})", f"\t{refuse}"]
    if not one.count and field.proto3_optional:
        holds = f"lp_range_holds({name}, {c_bounds(one)})"
        return [f"m->has_{field.name} = m->has_{field.name} && {holds};"]
    if not one.count:
        return [f"if (!lp_range_holds({name}, {c_bounds(one)}))", f"\t{refuse}"]
    may = f"m->{field.name}_count && " * one.absent
    lines = [f"if ({may}m->{field.name}_count != {count})", f"\t{refuse}"]
    lines += [f"for (pb_size_t i = 0; i < m->{field.name}_count; i++)"]
    lines += [f"\tif (!lp_range_holds({name}[i], {c_bounds(one)}))"]
    lines += [f"\t\t{name}[i] = NAN;" if one.nan else f"\t\t{refuse}"]
    if one.unit:
        lines += [f"if ({may}!lp_range_is_unit({name}, m->{field.name}_count))", f"\t{refuse}"]
    return lines


def c_message(message: Any, known: list[str], skipped: set[str]) -> list[str]:
    """Give the function of one message."""
    table = load().get(message.name, {})
    lines = [
        "",
        f"static inline const char *lp_keep_{message.name}(lightprobe_v1_{message.name} *m)",
    ]
    lines += ["{"]
    parts = [
        f for f in message.field if f.type == f.TYPE_MESSAGE and f.type_name.split(".")[-1] in known
    ]
    if parts:
        lines += ["\tconst char *told = NULL;", ""]
    for field in message.field:
        if field.name in table and f"{message.name}.{field.name}" not in skipped:
            lines += [f"\t{line}" for line in c_field(field, table[field.name])]
    for field in parts:
        keep, name = f"lp_keep_{field.type_name.split('.')[-1]}", field.name
        if is_list(field):
            lines.append(f"\tfor (pb_size_t i = 0; !told && i < m->{name}_count; i++)")
            lines.append(f"\t\ttold = {keep}(&m->{name}[i]);")
        else:
            lines += [f"\tif (!told && m->has_{name})", f"\t\ttold = {keep}(&m->{name});"]
    return [*lines, f"\treturn {'told' if parts else 'NULL'};", "}"]


def header() -> str:
    """Give C that brings messages into their ranges, or says why they cannot be sent."""
    messages, skipped = schema(), without_c_field()
    known = [name for name in checked(messages, "FromProbe", []) if name != "FromProbe"]
    lines = [line for name in known for line in c_message(messages[name], known, skipped)]
    return C_HEAD % UNIT_TOLERANCE + "\n".join(lines) + "\n\n#endif\n"


def main() -> None:
    """Write what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    makers = {"typescript": typescript, "csharp": csharp, "header": header}
    for name in makers:
        parser.add_argument(f"--{name}", type=Path)
    for name, path in vars(parser.parse_args()).items():
        if path:
            path.write_text(makers[name](), encoding="utf-8")


if __name__ == "__main__":
    main()
