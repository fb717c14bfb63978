# SPDX-License-Identifier: Apache-2.0
"""Write the generated parts of the two fault pages: `make faults-docs`.

Each fact has one source:

- docs/maintainers/faults.md, by hand: what goes wrong, what the user sees, which test shows it;
- proto/mcu_faults.toml: the microcontroller's faults;
- lightprobe.estimate.FLAG_WORDS: the flags of an estimate.

docs/generated.py puts the parts into the pages.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from generated import replace
from lightprobe.estimate import FLAG_WORDS, EstimateFlag

ROOT = Path(__file__).resolve().parents[1]
USERS = ROOT / "docs/users/faults.md"
MAINTAINERS = ROOT / "docs/maintainers/faults.md"

sys.path.insert(0, str(ROOT / "proto"))
import mcu_faults  # noqa: E402

#: Header of the tables that users see without their last column.
SHARED = ["fault", "what the user sees", "test"]


def cells(row: str) -> list[str]:
    """Return the cells of one row of a Markdown table; `\\|` does not end a cell."""
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", row.strip())[1:-1]]


def table(header: list[str], rows: list[list[str]]) -> str:
    """Return a Markdown table; ValueError when a row has another number of cells."""
    for row in rows:
        if len(row) != len(header):
            raise ValueError(f"a row of {len(row)} cells below {header}: {row}")
    lines = [header, ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def user_tables(page: str) -> str:
    """Return the sections of the maintainers' page that have a shared table, without tests."""
    parts = []
    for section in re.split(r"^## ", page, flags=re.M)[1:]:
        title = section.partition("\n")[0]
        for block in re.findall(r"(?:^\|.*\n)+", section, flags=re.M):
            header, _, *rows = map(cells, block.splitlines())
            if header == SHARED:
                shown = table(["what goes wrong", "what you see"], [row[:-1] for row in rows])
                parts.append(f"### {title}\n\n{shown.replace('](../users/', '](')}")
    return "\n".join(parts)


def flags() -> str:
    """Return the table of an estimate's flags."""
    names = [name for name in EstimateFlag.__members__ if name != "NONE"]
    return table(["flag", "meaning"], [[f"`{name}`", FLAG_WORDS[name]] for name in names])


def mcu_user_tables(faults: list[mcu_faults.Fault]) -> str:
    """Return the microcontroller's faults in three groups, by what happens to them."""
    header = ["fault", "`detail`", "what was seen", "what to do"]

    def group(words: str, members: list[mcu_faults.Fault]) -> str:
        rows = [
            [f"`{f.name}`", f.detail, f"{f.means} ({f.note})" if f.note else f.means, f.next_step]
            for f in members
        ]
        return f"{words}\n\n{table(header, rows)}"

    wheel = [f for f in faults if f.number < mcu_faults.WHEEL_END]
    others = [f for f in faults if f.number >= mcu_faults.WHEEL_END]
    return "\n".join(
        (
            group("These faults switch the servo off at once:", wheel),
            group(
                "These faults pass by themselves. The daemon reports and clears them:",
                [f for f in others if f.cleared_by == "daemon"],
            ),
            group(
                "These faults stay, also when the daemon restarts, until a person clears them\n"
                "with `lightprobe mcu clear`:",
                [f for f in others if f.cleared_by == "person"],
            ),
        )
    )


def mcu_tests(faults: list[mcu_faults.Fault]) -> str:
    """Return which test shows which fault of the microcontroller."""
    rows = [[f"`{f.name}`", ", ".join(f"`{test}`" for test in f.tests)] for f in faults]
    return table(["fault", "test"], rows)


def pages() -> dict[Path, str]:
    """Return both pages as they should be; ValueError names what cannot be made, SystemExit
    a part that is not marked."""
    faults = mcu_faults.load()
    maintainers = replace(MAINTAINERS.read_text(), "mcu-tests", mcu_tests(faults))
    users = USERS.read_text()
    for name, text in (
        ("flags", flags()),
        ("mcu", mcu_user_tables(faults)),
        ("tables", user_tables(maintainers)),
    ):
        users = replace(users, name, text)
    return {MAINTAINERS: maintainers, USERS: users}


def main() -> int:
    """Write both pages; with --check, change nothing and say which one is old."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="only compare; 1 when a page is old")
    only_check = parser.parse_args().check
    old = [(path, text) for path, text in pages().items() if path.read_text() != text]
    for path, text in old:
        name = path.relative_to(ROOT)
        if only_check:
            print(f"{name}: its generated parts are old: run `make faults-docs`", file=sys.stderr)
        else:
            path.write_text(text)
            print(f"{name}: written")
    return 1 if only_check and old else 0


if __name__ == "__main__":
    sys.exit(main())
