# SPDX-License-Identifier: Apache-2.0
"""Which lines of the daemon the kernel tests have run: what its coverage build left behind."""

import re
import shutil
import subprocess
from pathlib import Path

REPO = Path(__file__).resolve().parents[2]
SUMMARY = re.compile(r"File '([^']+)'\nLines executed:([\d.]+)% of (\d+)")


def collect(counts: Path) -> list[tuple[str, float, int]]:
    """Return (source file, percent of lines run, lines) per file of the daemon, worst first.

    `counts` holds the guest's *.gcda files under their absolute paths.
    """
    files = []
    for data in counts.rglob("*.gcda"):
        beside = Path("/") / data.relative_to(counts)  # where the compiler left its notes
        shutil.copy(data, beside)
        files.append(beside)
    if not files:
        return []
    printed = subprocess.run(
        ["gcov", "--no-output", *files], cwd=REPO, check=True, capture_output=True, text=True
    ).stdout
    rows = {
        name: (name, float(percent), int(lines))
        for name, percent, lines in SUMMARY.findall(printed)
        if name.startswith("daemon/")
    }
    return sorted(rows.values(), key=lambda row: row[1])


def report(counts: Path, out: Path) -> None:
    """Write all files' coverage to `out`, and print what belongs to the kernel's interfaces."""
    rows = collect(counts)
    lines = [f"{percent:6.1f} %  {total:5d} lines  {name}" for name, percent, total in rows]
    out.write_text("\n".join(lines) + "\n")
    own = [row for row in rows if row[0].startswith("daemon/drivers/source/v4l2/")]
    if own:
        total = sum(lines for _, _, lines in own)
        run = sum(percent * lines / 100 for _, percent, lines in own)
        print(
            f"kernel: coverage of drivers/source/v4l2: {100 * run / total:.1f} % of {total} lines"
        )
    print(f"kernel: coverage of every file: {out}")
