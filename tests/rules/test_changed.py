"""Which tests run for which change."""

from pathlib import Path

import pytest
from changed import ROOT, TARGETS, Choice, Tree, choose

TREE = {
    "tests/conftest.py": "import pytest\n",
    "tests/unit/py/test_sh.py": "from lightprobe import sh\n",
    "tests/unit/py/test_tables.py": "import tables\n",
    "tests/unit/tables.py": "X = 1\n",
    "tests/e2e/conftest.py": "",
    "tests/e2e/test_files.py": "from lightprobe.offline import estimate\n",
    "tests/e2e/test_life.py": "from harness import Daemon\n",
    "tests/e2e/harness.py": "import subprocess\nBIN = 'bin/lightprobed'\n",
    "tests/e2e/test_page.py": "PAGE = ROOT / 'hw/guide.md'\n",
    "tests/unit/test_sum.c": '#include "light/math/sum.h"\n',
    "tests/unit/test_far.c": '#include "base/far.h"\n',
    "tests/unit/test_usb.c": "extern const struct lp_source_ops lp_source_usb_ops;\n",
    "host_py/lightprobe/__init__.py": "",
    "host_py/lightprobe/sh.py": "from lightprobe import geometry\n",
    "host_py/lightprobe/geometry.py": "",
    "host_py/lightprobe/other.py": "",
    "host_py/lightprobe/offline.py": "from lightprobe.daemon import Daemon\n",
    "host_py/lightprobe/daemon.py": "",
    "daemon/light/math/sum.h": "",
    "daemon/light/math/sum.c": '#include "base/deep.h"\n',
    "daemon/light/math/more.c": "",
    "daemon/base/deep.h": "",
    "daemon/drivers/source/usb.c": "",
    "daemon/far/far.c": "",
}
STARTERS = ["e2e/test_files.py", "e2e/test_life.py"]  # of the daemon


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    for name, text in TREE.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return Tree(tmp_path)


@pytest.mark.parametrize(
    ("changed", "python", "unit"),
    [
        ("host_py/lightprobe/geometry.py", ["e2e/test_life.py", "unit/py/test_sh.py"], []),
        ("host_py/lightprobe/other.py", ["e2e/test_life.py"], []),  # a program that it starts
        ("tests/unit/tables.py", ["unit/py/test_tables.py"], []),
        ("tests/unit/py/test_sh.py", ["unit/py/test_sh.py"], []),
        (
            "tests/e2e/conftest.py",
            ["e2e/test_files.py", "e2e/test_life.py", "e2e/test_page.py"],
            [],
        ),
        ("hw/guide.md", ["e2e/test_page.py"], []),
        ("daemon/light/math/sum.c", STARTERS, ["unit/test_sum.c"]),
        ("daemon/light/math/more.c", STARTERS, ["unit/test_sum.c"]),
        ("daemon/base/deep.h", STARTERS, ["unit/test_sum.c"]),
        ("daemon/far/far.c", STARTERS, []),
        ("daemon/drivers/source/usb.c", STARTERS, ["unit/test_usb.c"]),
        ("docs/users/start.md", [], []),
    ],
)
def test_a_file_brings_the_tests_that_use_it(
    tree: Tree, changed: str, python: list[str], unit: list[str]
) -> None:
    chosen = choose(tree, [changed])
    assert chosen.python == [f"tests/{name}" for name in python]
    assert chosen.unit == [f"tests/{name}" for name in unit]
    assert chosen.why_all is None


@pytest.mark.parametrize(
    "changed",
    ["Makefile", "tests/tests.mk", "tests/conftest.py", "host_py/pyproject.toml", "new/x"],
)
def test_what_no_rule_knows_runs_all(tree: Tree, changed: str) -> None:
    chosen = choose(tree, [changed])
    assert chosen == Choice(tree.python_tests(), tree.unit_tests(), list(TARGETS), changed)
    assert len(chosen.python) == 5
    assert len(chosen.unit) == 3


def test_schemas_are_used_by_all_c_tests_and_clients(tree: Tree) -> None:
    chosen = choose(tree, ["proto/lightprobe.proto"])
    assert chosen.unit == tree.unit_tests()
    assert chosen.targets == ["test-js", "test-csharp", "test-firmware"]


def test_nothing_changed_runs_nothing(tree: Tree) -> None:
    assert choose(tree, []) == Choice([], [], [])


def test_here_a_room_of_the_daemon_brings_its_tests() -> None:
    """The rules fit this repository's own files."""
    here = Tree(ROOT)
    chosen = choose(here, ["daemon/light/math/sh.c"])
    assert "tests/unit/test_sh.c" in chosen.unit
    assert "tests/e2e/test_daemon_life.py" in chosen.python
    assert "tests/unit/py/test_sh.py" not in chosen.python
    chosen = choose(here, ["host_py/lightprobe/sim/ldr.py"])
    assert chosen.unit == []
    assert "tests/e2e/test_ring_steps.py" in chosen.python
    chosen = choose(here, ["firmware/wheel.c"])
    assert chosen.targets == ["test-firmware", "test-hw"]
    assert "tests/firmware/test_wheel.py" in chosen.python
