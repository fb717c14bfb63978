"""The Debian packages together are what `make install` installs, and no file is in two of them."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DEBIAN = ROOT / "packaging/deb/debian"


def make(*arguments: str) -> str:
    """Run make in the repository; gives what it printed."""
    done = subprocess.run(
        ["make", "-s", "PREFIX=/usr", "COMPILE=0", *arguments], cwd=ROOT, text=True, check=False,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        env={name: value for name, value in os.environ.items() if "MAKE" not in name},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    return done.stdout


def files(folder: Path) -> set[str]:
    """The files and links of a folder."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if not path.is_dir()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What debian/rules installs: a folder for each package."""
    made = tmp_path_factory.mktemp("packages")
    make("install-packages", f"DESTDIR={made}")
    yield made
    shutil.rmtree(made)


@pytest.fixture(scope="module")
def packages(folder):
    """Its files, by package."""
    return {path.name: files(path) for path in folder.iterdir()}


def test_the_packages_are_those_of_the_control_file(packages):
    control = (DEBIAN / "control").read_text()
    assert set(packages) == set(re.findall(r"^Package: (.*)$", control, re.M))


def test_together_they_are_what_make_install_installs(packages, tmp_path):
    make("install", f"DESTDIR={tmp_path}")
    assert set().union(*packages.values()) == files(tmp_path)
    shutil.rmtree(tmp_path)


def test_no_file_is_in_two_packages(packages):
    every = [path for found in packages.values() for path in found]
    assert len(every) == len(set(every))
    assert "usr/bin/lightprobed" in packages["lightprobed"]
    assert "usr/bin/lightprobe" in packages["lightprobe"]
    assert "usr/share/lightprobe/proto/lightprobe.proto" in packages["lightprobe-dev"]


def test_the_rules_install_nothing_themselves():
    """debhelper's own lists would decide it a second time."""
    rules = (DEBIAN / "rules").read_text()
    assert "install-packages DESTDIR=$(CURDIR)/debian PREFIX=/usr" in rules
    assert not re.findall(r"^\t(?:install|cp) ", rules, re.M)
    lists = {path.suffix for path in DEBIAN.iterdir()}
    assert not lists & {".install", ".service", ".udev", ".sysusers", ".links", ".docs"}


def test_no_package_names_the_folder_it_was_made_in(folder):
    installed = folder / "lightprobe/usr"
    for path in (installed / "lib/lightprobe/venv/pyvenv.cfg", installed / "bin/lightprobe"):
        assert str(folder) not in path.read_text()
    assert not list(installed.rglob("__pycache__"))


def test_the_version_is_written_alike_everywhere():
    makefile = (ROOT / "daemon/daemon.mk").read_text()
    (version,) = re.findall(r"^VERSION := (\S+)$", makefile, re.M)
    project = (ROOT / "host_py/pyproject.toml").read_text()
    assert f'\nversion = "{version}"\n' in project
    assert f'\n__version__ = "{version}"\n' in (ROOT / "host_py/lightprobe/__init__.py").read_text()


def test_without_a_key_the_repository_says_how_to_get_one(tmp_path):
    done = subprocess.run(
        ["/usr/bin/python3", ROOT / "packaging/deb/repo.py", "--packages", tmp_path,
         "--out", tmp_path / "apt", "--key", ""],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 1
    assert "make apt-repo KEY=" in done.stderr
    assert "gpg --quick-generate-key" in done.stderr
    assert not (tmp_path / "apt").exists()
