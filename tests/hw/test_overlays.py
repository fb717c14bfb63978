"""Device-tree overlays apply and do what they say; udev accepts the rules."""

import shutil
import subprocess
from pathlib import Path

import pytest
from dimensions import ROOT

OVERLAYS = sorted(path.stem for path in (ROOT / "hw/overlays").glob("*.dts"))
RULES = ROOT / "packaging/udev"


def run(*command: str | Path, code: int = 0) -> str:
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="session")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tree with the labels that the overlays refer to, as the Raspberry Pi's has them."""
    out = tmp_path_factory.mktemp("overlays") / "base.dtb"
    run("dtc", "-@", "-q", "-I", "dts", "-O", "dtb", "-o", out, ROOT / "tests/hw/pi.dts")
    return out


def applied(base: Path, name: str) -> Path:
    out = base.with_name(f"{name}.dtb")
    said = run(
        "dtc",
        "-@",
        "-Wno-unique_unit_address",
        "-I",
        "dts",
        "-O",
        "dtb",
        "-o",
        base.with_name(f"{name}.dtbo"),
        ROOT / f"hw/overlays/{name}.dts",
    )
    assert said == ""
    run("fdtoverlay", "-i", base, "-o", out, base.with_name(f"{name}.dtbo"))
    return out


def get(tree: Path, node: str, key: str) -> str:
    return run("fdtget", tree, node, key).strip()


@pytest.mark.parametrize("name", OVERLAYS)
def test_overlay_compiles_without_a_warning_and_applies(base: Path, name: str) -> None:
    assert applied(base, name).stat().st_size > base.stat().st_size


def test_overlay_of_a_label_that_is_not_there_is_refused(base: Path, tmp_path: Path) -> None:
    """The check can fail."""
    text = (
        (ROOT / "hw/overlays/lightprobe-servohat.dts").read_text().replace("&i2c1", "&i2c_nowhere")
    )
    (tmp_path / "x.dts").write_text(text)
    run("dtc", "-@", "-I", "dts", "-O", "dtb", "-o", tmp_path / "x.dtbo", tmp_path / "x.dts")
    run("fdtoverlay", "-i", base, "-o", tmp_path / "x.dtb", tmp_path / "x.dtbo", code=1)


def test_can_controller_sits_on_spi0_with_its_crystal_and_interrupt(base: Path) -> None:
    tree = applied(base, "lightprobe-can")
    can = "/soc/spi@7e204000/can@0"
    assert get(tree, can, "compatible") == "microchip,mcp2515"
    assert get(tree, can, "interrupts") == "25 8"
    assert get(tree, "/soc/spi@7e204000", "status") == "okay"
    assert get(tree, "/lightprobe-can-crystal", "clock-frequency") == "8000000"
    assert get(tree, can, "clocks") == get(tree, "/lightprobe-can-crystal", "phandle")
    assert get(tree, "/soc/gpio@7e200000/lightprobe-can-pins", "brcm,pins") == "25"
    assert get(tree, can, "pinctrl-0") == get(
        tree, "/soc/gpio@7e200000/lightprobe-can-pins", "phandle"
    )


def test_mcu_gets_a_bus_that_waits_for_a_stretched_clock(base: Path) -> None:
    tree = applied(base, "lightprobe-i2c")
    gpio = get(tree, "/soc/gpio@7e200000", "phandle")
    assert get(tree, "/lightprobe-i2c", "compatible") == "i2c-gpio"
    assert get(tree, "/lightprobe-i2c", "sda-gpios") == f"{gpio} 23 6"
    assert get(tree, "/lightprobe-i2c", "scl-gpios") == f"{gpio} 24 6"


def test_servo_hat_gets_i2c1(base: Path) -> None:
    tree = applied(base, "lightprobe-servohat")
    assert get(tree, "/soc/i2c@7e804000", "status") == "okay"
    assert get(tree, "/soc/i2c@7e804000", "clock-frequency") == "400000"


# --- udev --------------------------------------------------------------------------------------

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
udevadm --debug test /sys/devices/virtual/mem/null 2>&1
"""


def udev_says(rules: Path) -> list[str]:
    """What udev says about the rules: one line per file read, and its complaints."""
    said = run("unshare", "--map-root-user", "--mount", "bash", "-c", READ_RULES, "udev", rules)
    return [line for line in said.splitlines() if "/etc/udev/rules.d/" in line]


def test_udev_reads_the_rules_without_complaint() -> None:
    files = sorted(RULES.glob("*.rules"))
    assert udev_says(RULES) == [
        f"Reading rules file: /etc/udev/rules.d/{path.name}" for path in files
    ]


def test_a_wrong_rule_is_found(tmp_path: Path) -> None:
    """The check can fail."""
    shutil.copy(RULES / "71-lightprobe-mcu.rules", tmp_path / "71-x.rules")
    with (tmp_path / "71-x.rules").open("a") as f:
        f.write('SUBSYSTEM=="tty", GRUOP="dialout"\n')
    assert any("GRUOP" in line for line in udev_says(tmp_path))
