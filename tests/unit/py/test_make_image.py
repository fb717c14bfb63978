"""The image of a card: what its parts must agree on, and the key of its updates."""

import importlib.util
import re
import stat
import sys
from pathlib import Path

import pytest

IMAGE = Path(__file__).resolve().parents[3] / "packaging/image"
spec = importlib.util.spec_from_file_location("make_image", IMAGE / "make_image.py")
assert spec is not None
assert spec.loader is not None
make_image = importlib.util.module_from_spec(spec)
sys.modules[spec.name] = make_image
spec.loader.exec_module(make_image)


def image(tmp_path: Path) -> make_image.Image:
    """One that is about to be made."""
    (tmp_path / "out").mkdir(exist_ok=True)
    return make_image.Image(tmp_path / "out", tmp_path / "daemon", tmp_path / "a/keys", "1")


def test_the_halves_are_named_as_the_card_is_made() -> None:
    rauc = (IMAGE / "files/etc/rauc/system.conf").read_text()
    signature = f"{make_image.DISK_SIGNATURE:08x}"
    layout = make_image.layout("x.img")
    assert f"disk-signature = 0x{signature}" in layout
    parts = re.findall(r"partition (\w+) \{", layout)
    for half, bootname in (("0", "a"), ("1", "b")):
        section = rauc.split(f"[slot.rootfs.{half}]")[1].split("[")[0]
        number = parts.index(bootname) + 1
        assert f"device=/dev/disk/by-partuuid/{signature}-{number:02d}\n" in section
        assert f"bootname={bootname}" in section
    assert f"compatible={make_image.COMPATIBLE}\n" in rauc
    script = (IMAGE / "boot.cmd").read_text()
    assert f"= a; then setenv part {parts.index('a') + 1}; else" in script
    assert f"else setenv part {parts.index('b') + 1}; fi" in script
    init = (IMAGE / "init").read_text()
    assert f"*rauc.slot=b*) part={parts.index('b') + 1} ;;" in init
    assert f"*) part={parts.index('a') + 1} ;;" in init


def test_the_key_of_updates_is_made_once_and_never_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = image(tmp_path)
    one.ensure_keys()
    assert "keep it secret" in capsys.readouterr().out
    key = one.key.read_text()
    assert "PRIVATE KEY" in key
    assert stat.S_IMODE(one.key.stat().st_mode) == 0o600
    assert stat.S_IMODE(one.key.parent.stat().st_mode) == 0o700
    one.ensure_keys()
    assert one.key.read_text() == key
    one.certificate.unlink()
    with pytest.raises(make_image.StepError, match="put the other one back"):
        one.ensure_keys()
    assert one.key.read_text() == key
