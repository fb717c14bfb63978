# SPDX-License-Identifier: Apache-2.0
"""Writes the tables of hw/README.md again, between their marks; --check changes nothing.

The table of masses needs the rendered parts (`make hw`); --check leaves it out.
"""

from __future__ import annotations

import argparse
import re
import sys

import bom
import circuit
import mass
import supply
import tolerance
from dimensions import HW, dimensions


def tables() -> dict[str, str]:
    """Name of the mark -> Markdown."""
    parts, rails = bom.load()
    dim = dimensions()
    return {
        "bom": bom.bom_table(parts),
        "power": bom.power_table(parts, rails),
        "drive": bom.drive_table(),
        "pins": circuit.pin_table(),
        "switch": supply.table(),
        "wheel": tolerance.wheel_table(dim),
        "direction": tolerance.direction_table(dim),
        "view": tolerance.view_table(dim),
    }


def rendered_tables() -> dict[str, str]:
    """Those that need the rendered parts."""
    return {"mass": mass.table()}


def renewed(text: str, tables: dict[str, str]) -> str:
    """The file with its tables as they are now; raises ValueError for a table without its place."""
    for name, table in tables.items():
        begin, end = rf"<!-- {name}: make hw-docs -->", f"<!-- end {name} -->"
        block = f"{begin}\n{table}\n{end}"
        pattern = re.compile(f"{begin}\n.*?{end}", re.DOTALL)
        text, count = pattern.subn(block.replace("\\", r"\\"), text)
        if count != 1:
            raise ValueError(f"hw/README.md: {count} places for the table {name}")
    return text


def main() -> None:
    """Writes or checks."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help="change nothing; status 1 when a table is old",
    )
    arguments = parser.parse_args()
    path = HW / "README.md"
    text = path.read_text()
    new = renewed(text, tables() | ({} if arguments.check else rendered_tables()))
    if arguments.check and new != text:
        sys.exit("hw/README.md: tables are old: make hw-docs")
    if new != text:
        path.write_text(new)


if __name__ == "__main__":
    main()
