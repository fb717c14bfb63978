"""What the documents name exists: files, headings, tests, make targets, faults."""

import re
import subprocess
from pathlib import Path

import pytest
from lightprobe.cli.main import Align, Calibrate, Root

ROOT = Path(__file__).resolve().parents[2]
TRACKED = subprocess.run(
    ["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True
).stdout.split("\n")
PAGES = [name for name in TRACKED if name.endswith(".md") and (ROOT / name).exists()]
#: What tells a path in a code span from other words with a slash.
ROOMS = sorted({name.split("/")[0] for name in TRACKED if "/" in name})

LINK = re.compile(r"\]\(([^)\s]+)\)")
CODE = re.compile(r"`([^`\n]+)`")
FENCED = re.compile(r"^```.*?^```", re.S | re.M)
PLACEHOLDER = re.compile(r"[*<>{}$…=]|\bNAME\b|\b[A-Z]{3,}\b(?!\.md)")
A_PAGE = re.compile(r"(?<![\w./-])((?:docs|proto|hw|firmware|daemon|host_py)/[\w/-]+\.md)\b")
A_TEST = re.compile(r"(?:([\w/]+\.(?:py|cpp|c|test\.ts)))?(?:::(\w+))?")


def text_of(name):
    return (ROOT / name).read_text()


def anchors(page):
    """The headings of a page as GitHub names them in links."""
    headings = re.findall(r"^#+ (.*)$", FENCED.sub("", page), flags=re.M)
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.strip().replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("name", PAGES)
def test_links_lead_somewhere(name):
    broken = []
    for target in LINK.findall(FENCED.sub("", text_of(name))):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (ROOT / name).parent / path if path else ROOT / name
        if not file.exists() or (anchor and anchor not in anchors(file.read_text())):
            broken.append(target)
    assert not broken


def paths_in(name):
    """Paths in the code spans of a page: those that begin at a room, or with `../`."""
    for span in CODE.findall(FENCED.sub("", text_of(name))):
        path = span.split("::")[0].rstrip("/")
        is_path = re.fullmatch(r"[\w./,{}-]+", path) and "/" in path
        if not is_path or PLACEHOLDER.search(path):
            continue
        if path.startswith("../") or path.split("/")[0] in ROOMS:
            yield path


def exists(name, path):
    """From the page's folder, from the root, or from where its room looks for headers and tests."""
    bases = (ROOT / name).parent, ROOT, ROOT / "daemon", ROOT / "tests"
    return any((base / path).exists() for base in bases)


@pytest.mark.parametrize("name", PAGES)
def test_paths_in_pages_exist(name):
    assert [path for path in paths_in(name) if not exists(name, path)] == []


def sources():
    """All C and C++ of the project, by name."""
    kinds = (".c", ".h", ".cpp", ".hpp")
    return {name: text_of(name) for name in TRACKED if name.endswith(kinds)}


def test_functions_in_pages_exist():
    known = set(re.findall(r"\blp_\w+(?=\()", "".join(sources().values())))
    named = {(page, one) for page in PAGES for one in re.findall(r"`(lp_\w+)\(\)`", text_of(page))}
    assert sorted(named - {(page, one) for page, one in named if one in known}) == []
    assert len(named) > 20


def test_constants_are_where_pages_say():
    """As in: `THIS`, `THAT` (light/lamps/existence.c)."""
    text_by_name = sources()
    place = re.compile(r"((?:`[\w.]+`(?:,| and)?\s+)+)\(([\w/]+\.(?:c|h|cpp|hpp))\)")
    wrong = []
    named = 0
    for page in PAGES:
        for names, path in place.findall(text_of(page)):
            text = text_by_name.get(f"daemon/{path}", "")
            for one in re.findall(r"`([\w.]+)`", names):
                named += 1
                if not re.search(rf"\b{re.escape(one)}\b", text):
                    wrong.append((page, one, path))
    assert wrong == []
    assert named > 50


def test_pages_named_in_code_and_configuration_exist():
    missing = []
    for name in TRACKED:
        if not name or (ROOT / name).suffix in (".png", ".bin", ".jpg") or name.endswith(".md"):
            continue
        try:
            text = text_of(name)
        except (UnicodeDecodeError, FileNotFoundError, IsADirectoryError):
            continue
        missing += [(name, page) for page in A_PAGE.findall(text) if not (ROOT / page).exists()]
    assert missing == []


def test_the_map_lists_every_page():
    links = set(LINK.findall(text_of("docs/README.md")))
    below = {name.removeprefix("docs/") for name in PAGES if name.startswith("docs/")}
    assert below - {"README.md"} <= links


def test_make_targets_exist():
    rules = "".join(text_of(name) for name in TRACKED if name.endswith((".mk", "Makefile")))
    targets = {
        word
        for line in re.findall(r"^([\w .$()/-]+?) ?&?::?(?!=)", rules, flags=re.M)
        for word in line.split()
    }
    named = {
        (name, target)
        for name in PAGES
        for target in re.findall(
            r"(?:`|^ {4}|sudo )make ([a-z][a-z0-9-]+)", text_of(name), flags=re.M
        )
    }
    assert sorted((name, target) for name, target in named if target not in targets) == []
    assert len(named) > 10


def test_pages_install_packages_where_debian_allows_it():
    """Debian 12 and newer refuse pip outside of a virtual environment (PEP 668)."""
    found = [
        (name, at) for name in PAGES for at in re.findall(r"(\S*)pip3? install", text_of(name))
    ]
    assert [(name, at) for name, at in found if not at.endswith("venv/bin/")] == []
    assert len(found) > 2


def test_pages_that_install_the_python_client_name_the_python_it_needs():
    project = text_of("host_py/pyproject.toml")
    wanted = "Python " + re.search(r'^requires-python = ">=([\d.]+)"', project, re.M)[1]
    install = re.compile(r"pip install \S*host_py|host_py/README\.md#installing")
    telling = [name for name in PAGES if install.search(text_of(name))]
    telling += ["docs/users/clients.md", "docs/users/service.md"]
    assert [name for name in telling if wanted not in text_of(name)] == []
    assert len(telling) > 5


def test_nothing_advises_a_package_that_no_index_has():
    """Whoever claims the name there would run code on our users' machines."""
    advised = re.compile(r"(?:pipx?3?|uv) (?:install|add|pip install) +[-'\"\w ]*?\blightprobe\b")
    kinds = (".py", ".md", ".c", ".ts", ".mjs", ".cs")
    names = [
        name for name in TRACKED if name.endswith(kinds) and not name.startswith("tests/rules")
    ]
    found = [name for name in names if (ROOT / name).exists() and advised.search(text_of(name))]
    assert found == []
    assert advised.search("pip install 'lightprobe[ws]'")
    assert not advised.search("pip install './host_py[ws]'")


def commands_in(name, program):
    """What follows the name of a program where a page shows it as code, up to the next command."""
    page = text_of(name)
    code = [*CODE.findall(FENCED.sub("", page)), *re.findall(r"^ {4}\s*(\S.*)$", page, flags=re.M)]
    code += "".join(FENCED.findall(page)).replace("\\\n", " ").splitlines()
    for line in code:
        yield from re.findall(rf"(?<!from )(?<![\w-]){program} ([^;|#]*)", line)


def test_commands_of_lightprobe_exist():
    found, wrong = 0, []
    for name in PAGES:
        for words in (rest.split() for rest in commands_in(name, "lightprobe")):
            if not words or not re.fullmatch(r"[a-z]+", words[0]):
                continue
            found += 1
            if words[0] not in Root.entries:
                wrong.append((name, words[0]))
            elif words[0] == "calibrate" and len(words) > 1 and words[1].isalpha():
                wrong += [(name, f"calibrate {words[1]}")] * (words[1] not in Calibrate.entries)
            elif words[0] == "align" and len(words) > 1 and words[1].isalpha():
                wrong += [(name, f"align {words[1]}")] * (words[1] not in Align.entries)
    assert wrong == []
    assert found > 30


def test_options_of_lightprobed_exist():
    options = set(
        re.findall(r'^\t\{"([a-z-]+)", LP_PARAM', text_of("daemon/app/options/options.c"), re.M)
    )
    named = {
        (name, option)
        for name in PAGES
        for rest in commands_in(name, "lightprobed")
        for option in re.findall(r"(?<!\S)--([a-z][a-z-]*)", rest)
    }
    assert {(name, option) for name, option in named if option not in options} == set()
    assert len(named) > 8


# ---------------------------------------------------------------- the fault pages

#: Where the tests of a section of docs/maintainers/faults.md are, when its rows do not say.
FOLDERS = {
    "Cameras on USB: `v4l2:`": "tests/kernel/guest",
    "Cameras through `libcamera:`": "tests/kernel/guest",
    "Microcontroller": "tests/firmware",
}


def named_tests():
    """(section, file, function or None) of each test in the last column.

    `::test_x` is in the file named before it; `test_x` alone is one of the daemon's wheel tests.
    """
    page = text_of("docs/maintainers/faults.md")
    for section in re.split(r"^## ", page, flags=re.M)[1:]:
        title = section.partition("\n")[0]
        for row in re.findall(r"^\|(.*)\|$", section, flags=re.M):
            file = None
            for span in CODE.findall(row.rpartition("|")[2]):
                if re.fullmatch(r"test_\w+", span):
                    yield title, "test_daemon_wheel.py", span
                elif not span.startswith("make "):
                    named, function = A_TEST.fullmatch(span).groups()
                    file = named or file
                    yield title, file, function


def find_test(title, file):
    for folder in (FOLDERS.get(title, "tests/e2e"), "tests", "tests/e2e", "clients"):
        if (ROOT / folder / file).exists():
            return ROOT / folder / file
    return None


def test_every_test_on_the_fault_page_exists():
    named = list(named_tests())
    missing = []
    for title, file, function in named:
        path = find_test(title, file)
        if not path or (function and not re.search(rf"\b{function}\b", path.read_text())):
            missing.append((title, file, function))
    assert missing == []
    assert len(named) > 100


def test_users_find_every_fault_of_the_daemon():
    """The identifiers that the daemon's code gives to faults, and nothing that it does not know."""
    code = "".join(
        text_of(name) for name in TRACKED if name.startswith("daemon/") and name.endswith(".c")
    )
    called = re.findall(r'fault\([^;"]*?"([a-z0-9]+(?:-[a-z0-9]+)+)"', code)
    named = re.findall(r'^#define \w+ "([a-z0-9]+(?:-[a-z0-9]+)+)"', code, flags=re.M)
    table = text_of("docs/users/faults.md").partition("## Faults in the health")[2]
    listed = re.findall(r"^\| `([a-z0-9-]+)` \|", table.partition("\n## ")[0], flags=re.M)
    assert sorted(set(called + named)) == sorted(listed)
