"""Generated parts of pages are there, listed, and no older than the scripts that write them."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
spec = importlib.util.spec_from_file_location("generated", ROOT / "docs/generated.py")
generated = sys.modules["generated"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(generated)
PARTS = generated.Parts()
MARK = re.compile(r"^<!-- generated: ([\w-]+) -->$", re.M)
EACH = pytest.mark.parametrize("part", PARTS.all, ids=lambda part: part.key)


def is_empty(text):
    """No word at all, or a table without a row."""
    tables = re.findall(r"(?:^\|.*\n)+", text, re.M)
    return not text.strip() or any(table.count("\n") < 3 for table in tables)


def test_every_marked_part_of_every_page_is_listed():
    marked = {
        f"{page}#{name}"
        for page in PARTS.files((":(glob)**/*.md",))
        for name in MARK.findall((ROOT / page).read_text())
    }
    assert marked == {part.key for part in PARTS.all}, "docs/generated.toml lists others"


@EACH
def test_no_part_is_empty(part):
    text = PARTS.marked(part.page)[part.name]
    assert not is_empty(text), f"{part.key} is empty: {part.command}"


@EACH
def test_what_writes_a_part_exists(part):
    assert part.compared or part.by
    for path in part.by:
        assert PARTS.files((path,)) == [path], f"docs/generated.toml: {part.key}: no file {path}"


@EACH
def test_no_part_is_older_than_what_writes_it(part):
    if part.compared:
        return  # docs/faults.py --check, docs/panel.py --check
    assert generated.BY not in PARTS.changed(part), (
        f"{part.key}: {', '.join(part.by)} changed after it was written: {part.command}; or, if "
        f"the change leaves it as it is: docs/generated.py same {part.page} {part.name}"
    )


# ---------------------------------------------------------------- the check itself

TABLE = """
[sources]
engine = ["engine"]

[[parts]]
page = "page.md"
names = ["speeds"]
command = "make speeds"
by = ["speeds.py"]
measures = ["engine"]
"""
PAGE = "# Page\n\n<!-- generated: speeds -->\n<!-- end -->\n\nEnd\n"


@pytest.fixture
def checkout(tmp_path):
    """A small checkout with one page, whose part has been written."""
    for name, text in (("docs/generated.toml", TABLE), ("page.md", PAGE), ("speeds.py", "1"),
                       ("engine/a.c", "1"), ("engine/b.c", "1")):  # fmt: skip
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    subprocess.run(["git", "add", "."], cwd=tmp_path, check=True)
    generated.put(tmp_path / "page.md", {"speeds": "| a |\n|---|\n| 1 |"}, tmp_path)
    return tmp_path


def test_a_part_that_was_just_written_is_not_old(checkout):
    assert generated.old(generated.Parts(checkout)) == []
    text = generated.Parts(checkout).marked("page.md")["speeds"]
    assert text == "| a |\n|---|\n| 1 |\n"
    assert (checkout / "page.md").read_text() == PAGE.replace("<!-- end", f"{text}<!-- end")


@pytest.mark.parametrize(("file", "words"), [("speeds.py", "speeds.py"), ("engine/b.c", "engine")])
def test_a_change_of_what_it_is_made_of_makes_it_old(checkout, file, words):
    (checkout / file).write_text("2")
    (line,) = generated.old(generated.Parts(checkout))
    assert line == f"page.md, speeds: {words} changed since: make speeds"


def test_a_file_that_comes_or_goes_makes_it_old(checkout):
    (checkout / "engine/a.c").unlink()
    assert generated.old(generated.Parts(checkout))
    (checkout / "engine/a.c").write_text("1")
    assert not generated.old(generated.Parts(checkout))
    (checkout / "engine/c.c").write_text("1")
    subprocess.run(["git", "add", "."], cwd=checkout, check=True)
    assert generated.old(generated.Parts(checkout))


def test_a_change_of_the_script_alone_can_be_called_the_same(checkout):
    """What is measured keeps its note: figures that are old stay old."""
    (checkout / "speeds.py").write_text("2")
    (checkout / "engine/a.c").write_text("2")
    generated.Parts(checkout).write_notes("page.md", ["speeds"], (generated.BY,))
    parts = generated.Parts(checkout)
    assert parts.changed(parts.all[0]) == ["engine"]


def test_a_part_that_was_never_written_is_old(checkout):
    (checkout / "docs/generated.json").unlink()
    parts = generated.Parts(checkout)
    assert parts.changed(parts.all[0]) == [generated.BY, "engine"]


@pytest.mark.parametrize("part", ["", "\n\n"])
def test_nothing_is_not_written(checkout, part):
    before = (checkout / "page.md").read_text()
    with pytest.raises(SystemExit, match="the part speeds is empty"):
        generated.put(checkout / "page.md", {"speeds": part}, checkout)
    assert (checkout / "page.md").read_text() == before


def test_a_part_without_a_place_is_refused(checkout):
    with pytest.raises(SystemExit, match="0 parts are marked as heights"):
        generated.put(checkout / "page.md", {"heights": "1"}, checkout)


@pytest.mark.parametrize("text", ["", "\n", "| a |\n|---|\n", "words\n\n| a |\n|---|\n\nwords\n"])
def test_what_counts_as_empty(text):
    assert is_empty(text)
    assert not is_empty("| a |\n|---|\n| 1 |\n")
