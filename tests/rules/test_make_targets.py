"""Every make target has someone who runs it: tests/README.md says who, and the makefiles agree.

A target that nobody runs rots. Who runs it follows from .ci/run, and from what each target calls.
"""

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = "tests/README.md"
HEADING = "## Who runs which make target"
#: A word that is a target, and no part of a path, a variable or an option.
WORD = re.compile(r"(?<![\w./$(=-])[a-z][\w-]*(?![\w./=)-])")
RULE = re.compile(r"^([a-z][\w -]*?):(?!=)([^\n#]*)[^\n]*\n((?:\t[^\n]*\n)*)", re.M)


def makefiles() -> str:
    """The text of all makefiles, with continued lines joined."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.mk", "Makefile"]
    names = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return "\n".join((ROOT / name).read_text() for name in names.split()).replace("\\\n", " ")


def targets(text: str) -> set[str]:
    """All targets that are no files."""
    return {word for line in re.findall(r"^\.PHONY: (.*)$", text, re.M) for word in line.split()}


def calls(text: str) -> dict[str, set[str]]:
    """What each target needs, and what its recipe makes."""
    found: dict[str, set[str]] = {}
    for heads, needed, recipe in RULE.findall(text):
        made = re.findall(r"\$\(MAKE\)(.*)", recipe)
        for head in heads.split():
            found.setdefault(head, set()).update(WORD.findall(" ".join([needed, *made])))
    return found


def runners(text: str, ci: str) -> dict[str, str]:
    """Who runs each target: the first command of .ci/run that reaches it, or nobody."""
    every, needs, who = targets(text), calls(text), {}
    for command in re.findall(r"^make (\S+)$", ci, re.M):
        waiting = [command]
        while waiting:
            target = waiting.pop()
            if target in every and target not in who:
                who[target] = command
                waiting += needs.get(target, ())
    return {target: who.get(target, "by hand") for target in every}


def listed(page: str) -> dict[str, list[str]]:
    """The rows of the page: who runs them, and the targets."""
    part = page.split(HEADING)[1].split("\n## ")[0]
    found: dict[str, list[str]] = {}
    for who, names in re.findall(r"^\| (?!run by)(.*?) \| (.*?) \|", part, re.M):
        found.setdefault(who, []).extend(re.findall(r"`([a-z][\w-]*)`", names))
    return found


def test_every_target_is_listed_with_who_runs_it():
    who = runners(makefiles(), (ROOT / ".ci/run").read_text())
    rows = listed((ROOT / PAGE).read_text())
    wrong = []
    for row, names in rows.items():
        automatic = re.fullmatch(r"`make ([\w-]+)`", row)
        right = automatic[1] if automatic else "by hand"
        wrong += [(name, row, who.get(name)) for name in names if who.get(name) != right]
    assert wrong == []
    named = [name for names in rows.values() for name in names]
    assert sorted(named) == sorted(who)  # each once


def test_a_target_that_nobody_lists_is_noticed():
    text = ".PHONY: test part rotten\ntest: part\n\t@true\nrotten: build/part\n\t@true\n"
    assert runners(text, "make test\n") == {"test": "test", "part": "test", "rotten": "by hand"}
    text += "part:\n\t@$(MAKE) -j$(JOBS) rotten\n"
    assert runners(text, "make test\n")["rotten"] == "test"
    page = f"{HEADING}\n| `make test` | `test` |\n| by hand | `part` |\n| `make test` | `c` |\n"
    assert listed(page) == {"`make test`": ["test", "c"], "by hand": ["part"]}


def test_nothing_of_another_processor_is_installed():
    """Its packages collide with this machine's: packaging/sysroot unpacks them instead."""
    lists = "".join(path.read_text() for path in (ROOT / "packaging/apt").glob("*.txt"))
    assert re.findall(r"^[^#\n]*:[a-z0-9]+", lists, re.M) == []
    assert "--add-architecture" not in (ROOT / "packaging/apt-install").read_text()


def test_a_32_bit_system_is_told_before_anything_is_installed():
    command = ["make", "--silent", "BITS=32", "setup"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr.startswith("setup: this system has 32 bits")
    assert done.stdout == ""
