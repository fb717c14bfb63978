# SPDX-License-Identifier: Apache-2.0
"""Make the flags of an estimate and of a light, from lightprobe.proto's enums.

flags_code.py --header OUT    C, for the daemon (include/light_estimate.h)
flags_code.py --python OUT    host_py/lightprobe/flags.py, which is committed
flags_code.py --typescript OUT    the flags in words of lightprobe/estimate.py, for the viewer

(JavaScript and C# have them from the schema's own generators.)
"""

from __future__ import annotations

import argparse
import ast
import json
import re
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
#: Enums of the schema, and of which message's `flags` they are the bits.
ENUMS = {"LightFlag": "Light", "EstimateFlag": "Estimate"}


@dataclass(frozen=True)
class Flag:
    """One bit."""

    name: str
    value: int
    means: str


def load(enum: str) -> list[Flag]:
    """Return an enum's bits; raises ValueError where the schema has another form."""
    text = (HERE / "lightprobe.proto").read_text()
    body = re.search(rf"^enum {enum} {{\n(.*?)^}}", text, re.M | re.S)
    prefix = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", enum).upper()
    if not body:
        raise ValueError(f"lightprobe.proto: enum {enum}: not found")
    flags = []
    for line in body[1].splitlines():
        match = re.fullmatch(rf"  {prefix}_(\w+) = (\d+);(?: *// (.*))?", line)
        if not match:
            raise ValueError(f"lightprobe.proto: enum {enum}: expected a flag: {line}")
        flags.append(Flag(match[1], int(match[2]), match[3] or ""))
    if [flag.value for flag in flags] != [0, *(1 << bit for bit in range(len(flags) - 1))]:
        raise ValueError(f"lightprobe.proto: enum {enum}: expected NONE = 0, then one bit each")
    return flags[1:]


def header() -> str:
    """Give the enums in C's names."""
    lines = ["/* Generated from lightprobe.proto by proto/flags_code.py. */", "#pragma once", ""]
    for enum, message in ENUMS.items():
        lines.append(f"enum lp_{message.lower()}_flag {{")
        for flag in load(enum):
            lines.append(f"\tLP_{message.upper()}_{flag.name} = {flag.value}, /* {flag.means} */")
        lines += ["};", ""]
    return "\n".join(lines)


def python() -> str:
    """Give the enums as a module."""
    lines = [
        '"""Bits of the flags of a light and of an estimate.',
        "",
        "Generated from lightprobe.proto by proto/flags_code.py.",
        '"""',
        "",
        "from enum import IntFlag",
        "",
    ]
    for enum, message in ENUMS.items():
        lines += ["", f"class {enum}(IntFlag):", f'    """Bits of {message}.flags."""', ""]
        lines += [f"    {flag.name} = {flag.value}" for flag in load(enum)]
        lines.append("")
    return "\n".join(lines)


def typescript() -> str:
    """Give the words that host_py/lightprobe/estimate.py has for flags as a module."""
    text = (HERE.parent / "host_py/lightprobe/estimate.py").read_text()
    for node in ast.parse(text).body:
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "FLAG_WORDS":
            words = json.dumps(
                ast.literal_eval(node.value or ast.Dict()), indent=2, ensure_ascii=False
            )
            return (
                "// Generated from host_py/lightprobe/estimate.py by proto/flags_code.py.\n"
                f"export const FLAG_WORDS: Record<string, string> = {words};\n"
            )
    raise ValueError("host_py/lightprobe/estimate.py: FLAG_WORDS: not found")


def main() -> None:
    """Write what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--header", type=Path)
    parser.add_argument("--python", type=Path)
    parser.add_argument("--typescript", type=Path)
    options = parser.parse_args()
    if options.header:
        options.header.write_text(header())
    if options.python:
        options.python.write_text(python())
    if options.typescript:
        options.typescript.write_text(typescript())


if __name__ == "__main__":
    main()
