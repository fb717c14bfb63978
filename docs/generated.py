# SPDX-License-Identifier: Apache-2.0
"""Generated parts of pages: between `<!-- generated: NAME -->` and `<!-- end -->`.

docs/generated.toml says which command writes which part, by which scripts, and what it measures.
docs/generated.json says of which sources each part is: put() notes it when it writes the part.

`make docs-old` names the parts that are older than their sources, and the command that writes them
again. tests/rules/test_generated_parts.py fails when a part is empty, or older than its scripts.
After a change of a script that leaves a part as it is: docs/generated.py same PAGE NAME...
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_MARK = re.compile(r"^<!-- generated: ([\w-]+) -->\n(.*?)^<!-- end -->$", re.M | re.S)
#: The name, in a note, of the scripts that write a part; other names are groups of sources.
BY = "by"


@dataclass(frozen=True)
class Part:
    """One generated part of a page."""

    page: str
    name: str
    command: str
    by: tuple[str, ...]
    measures: tuple[str, ...]
    compared: bool  # `make check` compares it whole

    @property
    def key(self) -> str:
        """Its name in docs/generated.json."""
        return f"{self.page}#{self.name}"


class Parts:
    """All parts of the pages of a checkout."""

    def __init__(self, root: Path = ROOT) -> None:
        """Read the tables; KeyError names what an entry lacks."""
        self._root = root
        self._notes_file = root / "docs/generated.json"
        table = tomllib.loads((root / "docs/generated.toml").read_text())
        self._sources: dict[str, list[str]] = table["sources"]
        self._hashes: dict[tuple[str, ...], str] = {}
        self.all = tuple(
            Part(
                entry["page"], name, entry["command"], tuple(entry.get("by", ())),
                tuple(entry.get("measures", ())), entry.get("compared", False),
            )
            for entry in table["parts"] for name in entry["names"]
        )  # fmt: skip

    def marked(self, page: str) -> dict[str, str]:
        """Text of each part that is marked in a page."""
        return dict(_MARK.findall((self._root / page).read_text()))

    def files(self, paths: tuple[str, ...]) -> list[str]:
        """Files of git at these paths, which are files or folders."""
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--", *paths],
            cwd=self._root, check=True, capture_output=True, text=True,
        ).stdout  # fmt: skip
        return sorted(file for file in listed.split("\0") if (self._root / file).is_file())

    def note(self, part: Part) -> dict[str, str]:
        """Of which sources a part would be, if it were written now."""
        groups = {BY: part.by} | {name: tuple(self._sources[name]) for name in part.measures}
        return {name: self._hash(paths) for name, paths in groups.items()}

    def changed(self, part: Part) -> list[str]:
        """Which of its sources are not those of which it was written: BY, and names of groups."""
        noted = self._notes().get(part.key, {})
        return [name for name, value in self.note(part).items() if noted.get(name) != value]

    def write_notes(self, page: str, names: list[str], groups: tuple[str, ...] = ()) -> None:
        """Note that parts are of the sources of now; of some `groups` of them alone, if given."""
        notes = self._notes()
        for part in self.all:
            if part.page == page and part.name in names and not part.compared:
                new = self.note(part)
                kept = {k: v for k, v in new.items() if not groups or k in groups}
                notes[part.key] = notes.get(part.key, {}) | kept if groups else new
        lines = (f"{json.dumps(key)}: {json.dumps(notes[key])}" for key in sorted(notes))
        self._notes_file.write_text("{\n" + ",\n".join(lines) + "\n}\n")

    def _notes(self) -> dict[str, dict[str, str]]:
        if not self._notes_file.exists():
            return {}
        return dict(json.loads(self._notes_file.read_text()))

    def _hash(self, paths: tuple[str, ...]) -> str:
        if paths not in self._hashes:
            total = hashlib.sha256()
            for file in self.files(paths):
                data = (self._root / file).read_bytes()
                total.update(f"{file}\n{hashlib.sha256(data).hexdigest()}\n".encode())
            self._hashes[paths] = total.hexdigest()[:12]
        return self._hashes[paths]


def replace(text: str, name: str, part: str) -> str:
    """Put `part` where `name` is marked; SystemExit when it is not, or when the part is empty."""
    if not part.strip():
        raise SystemExit(f"docs: the part {name} is empty: what writes it found nothing")
    marked = re.compile(rf"(^<!-- generated: {name} -->\n).*?(^<!-- end -->$)", re.M | re.S)
    text, count = marked.subn(lambda m: f"{m[1]}{part.rstrip()}\n{m[2]}", text)
    if count != 1:
        raise SystemExit(f"docs: {count} parts are marked as {name} in the page, expected 1")
    return text


def written(page: Path, name: str) -> str:
    """Give a part as it stands in the page."""
    return dict(_MARK.findall(page.read_text()))[name].strip()


def put(page: Path, parts: dict[str, str], root: Path = ROOT) -> None:
    """Replace marked parts of a page, and note of which sources they are."""
    text = page.read_text()
    for name, part in parts.items():
        text = replace(text, name, part)
    page.write_text(text)
    Parts(root).write_notes(str(page.relative_to(root)), list(parts))


def keep(page: str, name: str, change: Callable[[str], str], root: Path = ROOT) -> None:
    """Change a part that is not measured again, and note that its scripts have changed."""
    parts, file = Parts(root), root / page
    file.write_text(replace(file.read_text(), name, change(parts.marked(page)[name])))
    parts.write_notes(page, [name], (BY,))


def old(parts: Parts) -> list[str]:
    """A line for each part that is older than its sources."""
    lines = []
    for part in parts.all:
        if changed := [] if part.compared else parts.changed(part):
            what = ", ".join(" ".join(part.by) if name == BY else name for name in changed)
            lines.append(f"{part.page}, {part.name}: {what} changed since: {part.command}")
    return lines


def main() -> None:
    """Name the parts that are old, or note that some are not."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="what")
    same = commands.add_parser(
        "same", help="a change of their scripts leaves these parts as they are"
    )
    same.add_argument("page")
    same.add_argument("names", nargs="+", metavar="NAME")
    arguments = parser.parse_args()
    parts = Parts()
    if arguments.what != "same":
        print("\n".join(old(parts)) or "every generated part is of the sources of now")
        return
    known = {part.name for part in parts.all if part.page == arguments.page}
    if missing := set(arguments.names) - known:
        sys.exit(f"docs: {arguments.page}: no part {', '.join(missing)}: see docs/generated.toml")
    parts.write_notes(arguments.page, arguments.names, (BY,))


if __name__ == "__main__":
    main()
