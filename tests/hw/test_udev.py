"""udev accepts the rules."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from dimensions import ROOT

RULES = ROOT / "packaging/udev"


def run(*command: str | Path, code: int = 0) -> str:
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done.stderr
    return done.stdout + done.stderr


# In a mount namespace of its own udev sees these rules only, and a Raspberry Pi's groups.
READ_RULES = """
set -e
mount -t tmpfs none /run
mkdir /run/empty /run/rules
cp "$1"/*.rules /run/rules/
{ cat /etc/group; echo gpio:x:986:; echo i2c:x:985:; } >/run/group
mount --bind /run/group /etc/group
mkdir -p /etc/udev/rules.d
for d in /usr/lib/udev/rules.d /lib/udev/rules.d; do [ -d $d ] && mount --bind /run/empty $d; done
mount --bind /run/rules /etc/udev/rules.d
mkdir /run/dev
touch /run/dev/null /run/dev/tty0
for node in null tty0; do mount --bind /dev/$node /run/dev/$node; done
mount --rbind /run/dev /dev
udevadm --debug test "/sys/devices/virtual/$2" 2>&1
"""


def udev_does(rules: Path, device: str) -> list[str]:
    """What udev says when a device comes, line by line."""
    words = ("bash", "-c", READ_RULES, "udev", rules, device)
    return run("unshare", "--map-root-user", "--mount", *words).splitlines()


def udev_says(rules: Path) -> list[str]:
    """What udev says about the rules: one line per file read, and its complaints."""
    return [line for line in udev_does(rules, "mem/null") if "/etc/udev/rules.d/" in line]


def test_udev_reads_the_rules_without_complaint() -> None:
    files = sorted(RULES.glob("*.rules"))
    assert udev_says(RULES) == [
        f"Reading rules file: /etc/udev/rules.d/{path.name}" for path in files
    ]


#: USB ids of the serial chips on Nanos and their clones.
CHIPS = {"CH340": "1a86:7523", "CH340K": "1a86:7522", "CH341": "1a86:5523", "CH343": "1a86:55d3",
         "CH9102": "1a86:55d4",
         "FT232R": "0403:6001", "FT231X": "0403:6015", "CP2102": "10c4:ea60",
         "Arduino Nano Every": "2341:0058", "Arduino of arduino.org": "2a03:0043"}  # fmt: skip


def is_named(vendor: str, product: str) -> bool:
    """Whether a serial port of this USB id becomes /dev/lightprobe-mcu."""
    for line in (RULES / "71-lightprobe-mcu.rules").read_text().splitlines():
        if 'SYMLINK+="lightprobe-mcu"' not in line:
            continue
        wanted = dict(re.findall(r'ATTRS\{(\w+)\}=="([^"]*)"', line))
        if vendor in wanted["idVendor"].split("|") and product in wanted.get(
            "idProduct", product
        ).split("|"):
            return True
    return False


@pytest.mark.parametrize("chip", CHIPS)
def test_the_serial_chips_of_nanos_get_their_name(chip: str) -> None:
    assert is_named(*CHIPS[chip].split(":"))
    assert not is_named("067b", "2303")  # a cable that may be anybody's


@pytest.mark.parametrize("named", [True, False])
def test_modem_manager_is_told_to_leave_the_microcontroller_alone(
    named: bool, tmp_path: Path
) -> None:
    """By both of its names, on the port that has got our name, and on no other."""
    for file in RULES.glob("*.rules"):
        shutil.copy(file, tmp_path)
    if named:  # as by its USB ids, which a port without hardware has not
        (tmp_path / "70-a.rules").write_text('SUBSYSTEM=="tty", SYMLINK+="lightprobe-mcu"\n')
    said = udev_does(tmp_path, "tty/tty0")
    assert ("DEVLINKS=/dev/lightprobe-mcu" in said) == named
    for name in ("ID_MM_DEVICE_IGNORE", "ID_MM_PORT_IGNORE"):
        assert (f"{name}=1" in said) == named


def test_a_wrong_rule_is_found(tmp_path: Path) -> None:
    """The check can fail."""
    shutil.copy(RULES / "71-lightprobe-mcu.rules", tmp_path / "71-x.rules")
    with (tmp_path / "71-x.rules").open("a") as f:
        f.write('SUBSYSTEM=="tty", GRUOP="dialout"\n')
    assert any("GRUOP" in line for line in udev_says(tmp_path))
