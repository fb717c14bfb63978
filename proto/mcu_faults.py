# SPDX-License-Identifier: Apache-2.0
"""What is made of proto/mcu_faults.toml: a C header, and the tables of docs/faults.md."""

from __future__ import annotations

import argparse
import sys
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).resolve().parent
DOCS = HERE.parent / "docs/maintainers/faults.md"
#: Below it a fault releases the servo.
WHEEL_END = 16
BEGIN, END = "<!-- mcu-faults: make faults-docs -->\n", "<!-- end mcu-faults -->\n"


@dataclass(frozen=True)
class Fault:
    """One fault; the fields are explained in the table."""

    name: str
    number: int
    means: str
    next_step: str
    detail: str
    cleared_by: str
    tests: list[str]
    note: str = field(default="")


def load() -> list[Fault]:
    """Return the faults by number; raises TypeError for a key, ValueError for a value."""
    table = tomllib.loads((HERE / "mcu_faults.toml").read_text())
    faults = sorted((Fault(name, **row) for name, row in table.items()), key=lambda f: f.number)
    if len({fault.number for fault in faults}) < len(faults):
        raise ValueError("mcu_faults.toml: a number is there twice")
    for fault in faults:
        if not 0 < fault.number < 32 or fault.cleared_by not in ("daemon", "person"):
            raise ValueError(f"mcu_faults.toml: {fault.name}: number or cleared_by")
        if fault.number < WHEEL_END and fault.cleared_by != "daemon":
            raise ValueError(f"mcu_faults.toml: {fault.name}: the daemon homes the wheel again")
    return faults


def header(faults: list[Fault]) -> str:
    """Return the C header: two X macros."""
    numbers = "".join(f" \\\n\tX({fault.name}, {fault.number})" for fault in faults)
    rows = "".join(
        f' \\\n\tX({f.number}, "{f.name}", {str(f.cleared_by == "daemon").lower()}, '
        f'"{f.means}: {f.next_step}")'
        for f in faults
    )
    return (
        "/* Made by proto/mcu_faults.py from proto/mcu_faults.toml. */\n"
        f"#define MCU_FAULTS_WHEEL_END {WHEEL_END}\n\n"
        f"/* X(NAME, number) */\n#define MCU_FAULTS(X){numbers}\n\n"
        '/* X(number, "NAME", whether the daemon clears it, "what it means: what to do") */\n'
        f"#define MCU_FAULT_ROWS(X){rows}\n"
    )


def table(faults: list[Fault]) -> str:
    """Return Markdown."""
    lines = [
        "| fault | detail | what was seen | what to do | test |",
        "|---|---|---|---|---|",
    ]
    for f in faults:
        seen = f"{f.means} ({f.note})" if f.note else f.means
        tests = ", ".join(f"`{test}`" for test in f.tests)
        lines.append(f"| `{f.name}` | {f.detail} | {seen} | {f.next_step} | {tests} |")
    return "\n".join(lines) + "\n"


def docs(faults: list[Fault], text: str) -> str:
    """Return docs/faults.md with its tables made anew."""
    wheel = [f for f in faults if f.number < WHEEL_END]
    retried = [f for f in faults if f.number >= WHEEL_END and f.cleared_by == "daemon"]
    kept = [f for f in faults if f.cleared_by == "person"]
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    if not after:
        raise ValueError(f"{DOCS.name}: the lines {BEGIN.strip()} and {END.strip()} are missing")
    return (
        f"{before}{BEGIN}Those that release the servo at once:\n\n{table(wheel)}\n"
        f"Those that pass by themselves; the daemon tells them, and clears them:\n\n{table(retried)}\n"
        "Those that somebody must see. They stay, over the daemon's life and in its health, until a\n"
        f"person clears them with `lightprobe mcu clear`:\n\n{table(kept)}{END}{after}"
    )


def main() -> int:
    """Write what is asked for; with --check, say whether docs/faults.md is as the table says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--header", type=Path, metavar="FILE", help="write the C header")
    parser.add_argument("--docs", action="store_true", help="write the tables of docs/faults.md")
    parser.add_argument("--check", action="store_true", help="compare them; 1 when they differ")
    arguments = parser.parse_args()
    faults = load()
    if arguments.header:
        arguments.header.write_text(header(faults))
    text = DOCS.read_text() if arguments.docs or arguments.check else ""
    if arguments.docs:
        DOCS.write_text(docs(faults, text))
    if arguments.check and docs(faults, text) != text:
        print("docs/faults.md: not as proto/mcu_faults.toml says: make faults-docs", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
