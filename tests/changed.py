"""Which tests a change can touch: those that use a file which differs from a commit.

A Python test uses what it imports, and what that imports; a C test what it includes, with the
sources beside each header. Programs are not imported: a test that names one (a word of PROGRAMS)
uses its folder as a whole, and so does one that names a folder. What no rule knows, all tests use.

    python tests/changed.py --out build/changed [--base REF]

writes the lists `python`, `unit` and `targets` into a folder. For `make test-changed` alone: what
lands has passed .ci/run, which runs all.
"""

from __future__ import annotations

import argparse
import ast
import re
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("accuracy", "bench", "e2e", "extremes", "unit", "firmware", "package")
#: Folders that `import` finds test helpers in (pythonpath of pytest.ini), beside the test's own.
HELPERS = ("", "accuracy", "unit", "e2e", "extremes", "hw", "bench", "seen", "package")
#: Words of a test, or of what it imports from tests/, that say which folders it uses as a whole.
PROGRAMS = {
    r"[Dd]aemon|LiveProbe|lightprobed": ("daemon", "proto"),
    r"LIGHTPROBE\b|subprocess|sys\.executable": ("host_py", "proto"),
    r"\bBox\b|LiveBox|LiveRing|[Ff]irmware|simavr": ("firmware", "proto"),
}
#: Modules that start a program, and the folder of its sources.
STARTS = {"host_py/lightprobe/daemon.py": "daemon", "host_py/lightprobe/sim/box.py": "firmware"}
FOLDERS = re.compile(r"""["'/](clients|docs|firmware|host_py|hw|packaging|proto|web)(?=["'/])""")
INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.M)
BACK_END = re.compile(r"\blp_(?:source|rotator|ring|publisher)_[a-z0-9_]+_ops\b")
#: Targets beside the Python and the C tests, by the folders that they test.
TARGETS = {
    "test-js": ("clients/js", "web", "proto"),
    "test-csharp": ("clients/csharp", "tests/engines/csharp", "proto"),
    "test-firmware": ("firmware", "proto"),
    "test-hw": ("hw", "tests/hw", "firmware", "packaging"),
}
#: What all tests share: they run when it changes.
SHARED = re.compile(r"tests/[^/]+\.(py|ini)")
#: What no test uses, and what is tested by the targets above or by `make check`.
NOBODYS = ("docs/", "tests/rules/", "tests/kernel/", "tests/fuzz/", "tests/engines/", "tests/seen/",
           "tests/debian/", "tests/arm64/", "clients/", "web/", "hw/", "README.md", "LICENSE",
           ".ci/")  # fmt: skip
KNOWN = ("daemon/", "host_py/lightprobe/", "firmware/", "proto/", "packaging/", "tests/")


@dataclass
class Uses:
    """What a test uses: files, and folders as a whole."""

    files: set[str] = field(default_factory=set)
    folders: set[str] = field(default_factory=set)

    def any_of(self, changed: Iterable[str]) -> bool:
        """Tell whether one of the changed files is among it."""
        return any(
            path in self.files or any(path.startswith(f"{folder}/") for folder in self.folders)
            for path in changed
        )


class Tree:
    """The files of a repository, and who uses which."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.read = cache(lambda path: (root / path).read_text(errors="replace"))
        self.imports = cache(self._imports)
        self.includes = cache(self._includes)

    def python_tests(self) -> list[str]:
        """Test files that `make test` gives to pytest."""
        return self._found([f"tests/{room}/**/test_*.py" for room in ROOMS])

    def unit_tests(self) -> list[str]:
        """C and C++ tests."""
        return self._found(["tests/unit/test_*.c", "tests/unit/test_*.cpp"])

    def _found(self, patterns: list[str]) -> list[str]:
        paths = {path for pattern in patterns for path in self.root.glob(pattern)}
        return sorted(str(path.relative_to(self.root)) for path in paths)

    def uses(self, test: str) -> Uses:
        """Give what a test uses."""
        found, waiting = Uses(), [test]
        is_python = test.endswith(".py")
        while waiting:
            path = waiting.pop()
            if path in found.files:
                continue
            found.files.add(path)
            if path in STARTS:
                found.folders |= {STARTS[path], "proto"}
            waiting += self.imports(path) if is_python else self.includes(path)
            if is_python and path.startswith("tests/"):
                found.folders |= self._named(path)
            elif not is_python and path.startswith("tests/") and BACK_END.search(self.read(path)):
                found.folders.add("daemon/drivers")
        return found

    def _named(self, path: str) -> set[str]:
        text = self.read(path)
        folders = {name for word, names in PROGRAMS.items() if re.search(word, text)
                   for name in names}  # fmt: skip
        return folders | set(FOLDERS.findall(text))

    def _is_file(self, path: str) -> bool:
        return (self.root / path).is_file()

    def _imports(self, path: str) -> list[str]:
        names: list[str] = []
        if not path.endswith(".py"):
            return []
        for node in ast.walk(ast.parse(self.read(path))):
            if isinstance(node, ast.Import):
                names += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        found = [file for name in names for file in self._files_of(name, path)]
        if path.startswith("tests/"):
            parents = [str(parent) for parent in Path(path).parents]
            found += [f"{parent}/conftest.py" for parent in parents if parent != "tests"]
        return [file for file in found if self._is_file(file)]

    def _files_of(self, name: str, importer: str) -> list[str]:
        """Where a module may lie; its packages too."""
        parts = name.split(".")
        if parts[0] == "lightprobe":
            ways = ["/".join(parts[:k]) for k in range(1, len(parts) + 1)]
            return [f"host_py/{way}{end}" for way in ways for end in (".py", "/__init__.py")]
        if parts[0] == "lightprobe_proto":
            return ["proto/lightprobe.proto"]
        beside = str(Path(importer).parent)
        folders = [beside, *(f"tests/{folder}".rstrip("/") for folder in HELPERS)]
        if not importer.startswith("tests/"):
            return []
        return [f"{folder}/{parts[0]}.py" for folder in folders]

    def _includes(self, path: str) -> list[str]:
        """Files that a C file includes; for a header the sources in its folder as well."""
        if Path(path).suffix not in (".c", ".h", ".cpp", ".hpp"):
            return []
        here = Path(path).parent
        found = []
        for name in INCLUDE.findall(self.read(path)):
            for base in (str(here), "daemon", "daemon/include", "tests/unit", "firmware", "."):
                file = (self.root / base / name).resolve()
                if file.is_file() and self.root in file.parents:
                    found.append(str(file.relative_to(self.root)))
                    break
        if Path(path).suffix in (".h", ".hpp") and path.startswith("daemon/"):
            beside = sorted((self.root / here).glob("*.c*"))
            found += [str(one.relative_to(self.root)) for one in beside]
        return found


@dataclass
class Choice:
    """Tests to run; `why_all`: a file for which all run."""

    python: list[str]
    unit: list[str]
    targets: list[str]
    why_all: str | None = None


def choose(tree: Tree, changed: Iterable[str]) -> Choice:
    """Choose the tests that changed files can touch."""
    files = sorted(changed)
    all_python, all_unit = tree.python_tests(), tree.unit_tests()
    for path in files:
        shared = SHARED.fullmatch(path) or path.endswith(".mk")
        if shared or not path.startswith(KNOWN + NOBODYS):
            return Choice(all_python, all_unit, list(TARGETS), path)
    if any(path.startswith("proto/") for path in files):  # generated code, which nobody includes
        all_of_unit = all_unit
    else:
        all_of_unit = [test for test in all_unit if tree.uses(test).any_of(files)]
    return Choice(
        [test for test in all_python if tree.uses(test).any_of(files)],
        all_of_unit,
        [target for target, folders in TARGETS.items() if Uses(folders=set(folders)).any_of(files)],
    )


def git(*arguments: str) -> str:
    """Give what a command of git says; nothing when it fails."""
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True)
    return done.stdout.strip() if done.returncode == 0 else ""


def base_of(wanted: str) -> str:
    """Find the commit to compare with: as asked, else origin/main, or the one before when there."""
    if wanted:
        return wanted
    origin = git("merge-base", "origin/main", "HEAD")
    return origin if origin and origin != git("rev-parse", "HEAD") else "HEAD~1"


def main() -> int:
    """Write the lists, and print what runs and how much does not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--base", default="")
    options = parser.parse_args()
    base = base_of(options.base)
    if not git("rev-parse", "--verify", "--quiet", f"{base}^{{commit}}"):
        print(f"changed: {base}: no such commit: name one with BASE=", file=sys.stderr)
        return 2
    files = git("diff", "--name-only", "--no-renames", base).splitlines()
    files += git("ls-files", "--others", "--exclude-standard").splitlines()
    tree = Tree(ROOT)
    choice = choose(tree, files)
    options.out.mkdir(parents=True, exist_ok=True)
    for name in ("python", "unit", "targets"):
        chosen = getattr(choice, name)
        (options.out / name).write_text("".join(f"{one}\n" for one in chosen))
        print(
            "\n".join(f"changed: runs {one}" for one in chosen) if chosen else f"changed: no {name}"
        )
    if choice.why_all:
        print(f"changed: {choice.why_all}: any test may use it, so all run")
    left_out = {
        "files of Python tests": len(tree.python_tests()) - len(choice.python),
        "C tests": len(tree.unit_tests()) - len(choice.unit),
        "other targets": len(TARGETS) - len(choice.targets),
    }
    counts = ", ".join(f"{count} {what}" for what, count in left_out.items())
    print(f"changed: {len(files)} files since {base}; skipped: {counts}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
