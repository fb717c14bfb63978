"""Calibration files: whole or not at all, and no former one is lost."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe.calibrate import files as calibration


def test_the_former_file_is_kept_under_a_number(tmp_path: Path) -> None:
    path = tmp_path / "made" / "ring.ini"
    assert calibration.save(path, "one") is None
    first = calibration.save(path, "two")
    second = calibration.save(path, "three")
    assert (first, second) == (path.with_name("ring.ini.~1~"), path.with_name("ring.ini.~2~"))
    assert [p.read_text() for p in (path, first, second)] == ["three", "one", "two"]
    assert len(list(path.parent.iterdir())) == 3  # nothing temporary is left


def test_a_failure_leaves_the_former_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "ring.ini"
    calibration.save(path, "good")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(
        calibration.CalibrationError, match=r"ring\.ini: write: No space left.*--ou"
    ):
        calibration.save(path, "never")
    assert [p.read_text() for p in tmp_path.iterdir()] == ["good"]


def test_permissions_stay(tmp_path: Path) -> None:
    path = tmp_path / "ring.ini"
    calibration.save(path, "one")
    assert path.stat().st_mode & 0o400
    path.chmod(0o640)
    calibration.save(path, "two")
    assert path.stat().st_mode & 0o777 == 0o640


@given(texts=st.lists(st.text(st.characters(codec="utf-8", exclude_characters="\r")), max_size=5))
def test_every_version_can_be_read_again(
    texts: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("versions") / "file"
    kept = [calibration.save(path, text) for text in texts]
    assert kept[:1] in ([], [None])
    read = [old.read_text(encoding="utf-8") for old in kept[1:] if old]
    if texts:
        assert [*read, path.read_text(encoding="utf-8")] == texts
