# SPDX-License-Identifier: Apache-2.0
"""Read proto/mcu_faults.toml, and make the C header of firmware and daemon from it.

The tables of the fault pages are made by docs/faults.py.
"""

from __future__ import annotations

import argparse
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).resolve().parent
#: Below it a fault releases the servo.
WHEEL_END = 16


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


def main() -> None:
    """Write the header."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--header", type=Path, metavar="FILE", required=True, help="file to write")
    parser.parse_args().header.write_text(header(load()))


if __name__ == "__main__":
    main()
