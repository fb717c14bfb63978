"""How large the daemon's rooms are: files, lines, functions and named numbers of each.

Of the working tree, or of a revision beside it:

    build/venv/bin/python tests/rules/rooms.py
    build/venv/bin/python tests/rules/rooms.py --before HEAD~20 --json
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SUFFIXES = (".c", ".h", ".cpp", ".hpp")
#: A number with a name: a macro, or a constant of an arithmetic type.
NUMBER = r"[-+(]*(?:\d|\.\d)"
NAMED = re.compile(
    rf"^#define +\w+ +{NUMBER}|^\s*(?:static )?const(?:expr)? (?:\w+ )+\w+ = {NUMBER}", re.M
)
#: A member of a constant table that is given a number.
MEMBER = re.compile(rf"(?<![\w)\]])\.\w+ = {NUMBER}")
#: A body that begins at the margin after a list of parameters: a function.
FUNCTION = re.compile(r"\)(?: noexcept)?\n\{\n")


@dataclass
class Room:
    """What a room holds."""

    files: int = 0
    lines: int = 0
    functions: int = 0
    numbers: int = 0

    def add(self, text: str) -> None:
        """Count one more file."""
        self.files += 1
        self.lines += text.count("\n")
        self.functions += len(FUNCTION.findall(text))
        self.numbers += len(NAMED.findall(text)) + len(MEMBER.findall(text))


def sources(revision: str | None) -> Iterator[tuple[str, str]]:
    """Path and text of each source of the daemon, of a revision or of the working tree."""
    if revision is None:
        for path in sorted((ROOT / "daemon").rglob("*")):
            if path.suffix in SUFFIXES:
                yield str(path.relative_to(ROOT)), path.read_text()
        return
    for name in git("ls-tree", "-r", "--name-only", revision, "daemon").split():
        if name.endswith(SUFFIXES):
            yield name, git("show", f"{revision}:{name}")


def git(*words: str) -> str:
    """What git prints."""
    return subprocess.run(
        ["git", *words], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout


def rooms(files: Iterator[tuple[str, str]]) -> dict[str, Room]:
    """Rooms by name, and the sum of those that estimate."""
    found: dict[str, Room] = {}
    for name, text in files:
        folders = name.split("/")[1:-1]
        room = folders[0]
        for depth in range(len(folders)):
            found.setdefault("/".join(folders[: depth + 1]), Room()).add(text)
        if room in ("light", "vision", "estimate"):
            found.setdefault("light + vision + estimate", Room()).add(text)
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", metavar="REVISION", help="a revision to compare with")
    parser.add_argument("--json", action="store_true", help="for scripts")
    options = parser.parse_args()
    now = rooms(sources(None))
    before = rooms(sources(options.before)) if options.before else {}
    if options.json:
        tables = {"now": now, "before": before}
        print(json.dumps(tables, default=vars))
        return
    print(f"{'room':30}{'files':>12}{'lines':>16}{'functions':>14}{'named numbers':>16}")
    for name in sorted(now | before):
        cells = [_cell(now.get(name, Room()), before.get(name), field) for field in vars(Room())]
        print(f"{name:30}{cells[0]:>12}{cells[1]:>16}{cells[2]:>14}{cells[3]:>16}")


def _cell(now: Room, before: Room | None, field: str) -> str:
    value = getattr(now, field)
    return str(value) if before is None else f"{value} ({value - getattr(before, field):+d})"


if __name__ == "__main__":
    main()
