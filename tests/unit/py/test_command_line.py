"""The table of sub-commands: quick to list, true to what it lists."""

import importlib
import pkgutil
import subprocess
import sys

import lightprobe
import pytest
from lightprobe import cli
from lightprobe.cli import main

SLOW = ("numpy", "google.protobuf", "cv2", "rich", "matplotlib", "asyncio")
ENTRIES = {**main.Root.entries, **main.Align.entries, **main.Calibrate.entries}


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["calibrate", "--help"]])
def test_help_loads_nothing_slow(words):
    """Half a second of imports stood before the first line of --help."""
    code = (
        "import sys\n"
        "from lightprobe.__main__ import main\n"
        f"sys.argv = ['lightprobe', *{words}]\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"print(sorted(set(sys.modules) & set({SLOW})), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"
    assert "lightprobe" in done.stdout


@pytest.mark.parametrize("name", ENTRIES)
def test_every_entry_leads_to_its_command(name):
    command = ENTRIES[name].load(name)
    assert command.name == name
    assert command.help


@pytest.mark.parametrize("name", ENTRIES)
def test_what_is_not_installed_is_named_with_its_extra(name, monkeypatch):
    def missing(module):
        raise ModuleNotFoundError(f"No module named {module!r}", name="what_it_needs")

    monkeypatch.setattr(main, "import_module", missing)
    extra = ENTRIES[name].extra
    with pytest.raises(main.LightprobeError, match=rf"what_it_needs.*\./host_py\[{extra}\]"):
        ENTRIES[name].load(name)


def test_every_command_of_the_package_is_listed():
    """A file that nobody can call is no command."""
    homes = {entry.home.partition(":")[0] for entry in ENTRIES.values()}
    names = [module.name for module in pkgutil.iter_modules(cli.__path__)]
    commands = {
        name
        for name in names
        if {"command", "app"} & set(vars(importlib.import_module(f"lightprobe.cli.{name}")))
    }
    assert commands - {"main", "mcu_flash"} <= homes  # flash is one of mcu's


def test_the_package_offers_what_it_names():
    for name in lightprobe.__all__:
        assert getattr(lightprobe, name).__name__ == name
    assert set(lightprobe.__all__) <= set(dir(lightprobe))
    with pytest.raises(AttributeError, match="no attribute 'Cliant'"):
        _ = lightprobe.Cliant
