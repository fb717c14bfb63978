# SPDX-License-Identifier: Apache-2.0
"""Extremes of each part: what the unit tests `*_extremes` print, as a table.

`python tests/extremes/parts.py` runs them (`make VARIANT=asan unit-tests` builds them) and prints
the table; `--page` writes it into docs/users/accuracy.md.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs"))

from generated import put  # noqa: E402

HEAD = ("part", "input", "error", "found", "bound")


def figures(program: Path) -> list[list[str]]:
    """Run a test and give its rows; SystemExit when it fails."""
    ran = subprocess.run([program], capture_output=True, text=True, check=False)
    if ran.returncode:
        raise SystemExit(f"{program.name}: failed:\n{ran.stdout}{ran.stderr}")
    return [line.split("|")[1:] for line in ran.stdout.splitlines() if line.startswith("figure|")]


def main() -> None:
    """Print the table, or write it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--page", action="store_true", help="write docs/users/accuracy.md")
    page = parser.parse_args().page
    sources = sorted((ROOT / "tests/unit").glob("test_*_extremes.c"))
    programs = [ROOT / "build/asan/tests" / source.stem for source in sources]
    subprocess.run(
        ["make", "-s", "VARIANT=asan", "unit-tests",
         "ONLY=" + " ".join(str(source.relative_to(ROOT)) for source in sources)],
        cwd=ROOT, check=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    rows = [list(HEAD), ["---"] * len(HEAD)]
    rows += [row for program in programs for row in figures(program)]
    text = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    if page:
        put(ROOT / "docs/users/accuracy.md", {"extremes-parts": text})
    else:
        print(text)


if __name__ == "__main__":
    main()
