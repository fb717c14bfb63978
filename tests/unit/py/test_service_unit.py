"""The service as `make install-daemon` leaves it: what systemd says about unit and drop-ins.

That it works as a service, on Debian's kernel, is shown by tests/kernel/guest/test_service.py.
"""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parents[3]
DROP_INS = sorted(path.name for path in (REPO / "packaging/systemd/drop-ins").iterdir())
#: systemd's scale: 0 is no exposure, 10 is all; a service of systemd's defaults has 9.6.
MOST_EXPOSURE = 1.5


def make(*arguments: str) -> str:
    """Run make in the repository; gives what it printed."""
    done = subprocess.run(
        ["make", "-s", *arguments], cwd=REPO, text=True, check=False,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        env={name: value for name, value in os.environ.items() if "MAKE" not in name},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    return done.stdout


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A folder with everything installed under it."""
    make("install-daemon", f"DESTDIR={tmp_path}")
    return tmp_path


def files(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*") if path.is_file()}


def units(root: Path) -> Path:
    return root / "usr/local/lib/systemd/system"


def analyze(root: Path, *arguments: str) -> str:
    """systemd-analyze on the installed unit, whose program is where it has been installed."""
    unit = units(root) / "lightprobed.service"
    text = unit.read_text()
    assert "ExecStart=/usr/local/bin/lightprobed " in text
    unit.write_text(text.replace("ExecStart=/usr/local", f"ExecStart={root}/usr/local"))
    done = subprocess.run(
        ["systemd-analyze", "--no-pager", *arguments, unit], text=True, check=False,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        env=os.environ | {"SYSTEMD_UNIT_PATH": f"{units(root)}:"},
    )  # fmt: skip
    unit.write_text(text)
    assert done.returncode == 0, done.stdout
    return done.stdout


@pytest.mark.parametrize("drop_in", [None, *DROP_INS])
def test_systemd_finds_no_mistake(root, drop_in):
    if drop_in:
        folder = units(root) / "lightprobed.service.d"
        folder.mkdir()
        shutil.copy(root / "usr/local/share/lightprobe/drop-ins" / drop_in, folder)
    assert "lightprobe" not in analyze(root, "verify")


@pytest.mark.parametrize("name", ["lightprobe-setup", "lightprobe-panel"])
def test_systemd_finds_no_mistake_in_the_other_services(root, name):
    """Their program comes with another package."""
    unit = units(root) / f"{name}.service"
    text = unit.read_text()
    assert "ExecStart=/usr/local/bin/lightprobe " in text
    assert "ConditionPathExists=/usr/local/bin/lightprobe\n" in text
    unit.write_text(text.replace("ExecStart=/usr/local/bin/lightprobe", "ExecStart=/bin/true"))
    done = subprocess.run(
        ["systemd-analyze", "--no-pager", "verify", unit], text=True, check=False,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    assert (done.returncode, name in done.stdout) == (0, False), done.stdout


def test_verify_does_find_mistakes(root):
    """The test above can fail."""
    unit = units(root) / "lightprobed.service"
    unit.write_text(unit.read_text().replace("DevicePolicy=closed", "DevicePolicy=ajar"))
    with pytest.raises(AssertionError):
        assert "lightprobe" not in analyze(root, "verify")


def test_exposure_is_low(root, record_property):
    printed = analyze(root, "security", "--offline=yes")
    score = float(re.search(r"exposure level for lightprobed.service: ([\d.]+)", printed)[1])
    record_property("figure", f"systemd-analyze security: {score}")
    print(f"systemd-analyze security: {score} of 10 (less is better)")
    assert score <= MOST_EXPOSURE, printed


def test_packaged_configuration_is_good(root):
    """It names no simulator, and passes the daemon's own check."""
    config = root / "etc/lightprobe/lightprobed.conf"
    assert "\nsource = v4l2:\n" in config.read_text()
    done = subprocess.run(
        [root / "usr/local/bin/lightprobed", f"--config={config}", "--check-config"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_an_update_keeps_the_configuration_and_uninstall_too(root):
    before = files(root)
    config = root / "etc/lightprobe/lightprobed.conf"
    config.write_text("# mine\n")
    assert "is kept" in make("install-daemon", f"DESTDIR={root}")
    assert files(root) == before
    make("uninstall", f"DESTDIR={root}")
    assert files(root) == {"etc/lightprobe/lightprobed.conf"}
    assert config.read_text() == "# mine\n"


def test_a_package_has_its_own_prefix(tmp_path):
    make("install-daemon", f"DESTDIR={tmp_path}", "PREFIX=/usr")
    unit = (tmp_path / "usr/lib/systemd/system/lightprobed.service").read_text()
    assert "ExecStart=/usr/bin/lightprobed " in unit


def test_what_is_not_built_is_not_installed(tmp_path):
    with pytest.raises(AssertionError, match="make build"):
        make("install-daemon", f"DESTDIR={tmp_path}/root", f"BUILD={tmp_path}/build")
    assert not (tmp_path / "root").exists()


def test_groups_of_rules_and_drop_ins_are_made(root):
    """A rule or a drop-in that names a group which is not there does nothing, or fails."""
    share, rules = (
        root / "usr/local/share/lightprobe",
        root / "usr/local/lib/udev/rules.d",
    )
    made = found(r"^g (\S+) ", root / "usr/local/lib/sysusers.d/lightprobe.conf")
    named = found(r'GROUP="(\w+)"', *rules.iterdir())
    services = [units(root) / "lightprobed.service", *(share / "drop-ins").iterdir()]
    for line in found(r"^SupplementaryGroups=(.*)$", *services):
        named |= set(line.split())
    assert named == made


def test_groups_of_debian_have_the_numbers_that_debian_gives_them(root):
    """Otherwise systemd says each time that they contradict its own list."""
    folder = root / "usr/lib/sysusers.d"
    folder.mkdir(parents=True)
    shutil.copy("/usr/lib/sysusers.d/basic.conf", folder)
    command = ["systemd-sysusers", f"--root={root}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert "'gpio'" in done.stderr  # it has read ours
    assert "Conflict" not in done.stderr


def found(pattern: str, *paths: Path) -> set[str]:
    """What the pattern's group matches in the files' lines."""
    text = "\n".join(path.read_text() for path in paths)
    return set(re.findall(pattern, text, re.MULTILINE))
