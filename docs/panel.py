# SPDX-License-Identifier: Apache-2.0
"""Write the tables of docs/users/panel.md from those that the program reads: `make panel-docs`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from faults import table
from generated import replace
from lightprobe.panel.actions import ACTIONS
from lightprobe.panel.button import ZONES
from lightprobe.panel.patterns import DARK, FAST, LIT, SLOW, STATES

PAGE = Path(__file__).resolve().parent / "users/panel.md"


def states() -> str:
    """Return what the LED shows, the first that holds above."""
    rows = [[m.pattern.looks, m.means, m.next_step] for m in STATES.values()]
    return table(["the LED", "means", "next"], rows)


def holds() -> str:
    """Return what the button does, by how long it is held."""
    looks = {pattern: pattern.looks for pattern in (LIT, DARK, SLOW, FAST)}
    ends = [*(f"{zone.from_s:g} s" for zone in ZONES[1:]), "…"]
    rows = [
        [f"{zone.from_s:g} to {end}" if end != "…" else f"{zone.from_s:g} s and longer",
         looks[zone.pattern], ACTIONS[zone.action].title if zone.action else "nothing"]
        for zone, end in zip(ZONES, ends, strict=True)
    ]  # fmt: skip
    return table(["held for", "the LED meanwhile", "let go now:"], rows)


def main() -> int:
    """Write the page; with --check, change nothing and say whether it is old."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="only compare; 1 when it is old")
    only_check = parser.parse_args().check
    text = PAGE.read_text()
    new = replace(replace(text, "states", states()), "holds", holds())
    if new == text:
        return 0
    if only_check:
        print("docs/users/panel.md: its tables are old: run `make panel-docs`", file=sys.stderr)
        return 1
    PAGE.write_text(new)
    return 0


if __name__ == "__main__":
    sys.exit(main())
