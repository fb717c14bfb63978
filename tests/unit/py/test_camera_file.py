"""Camera files: edited, not rewritten; whole or not at all."""

import os

import numpy as np
import pytest
from lightprobe.calibrate import camera_file
from lightprobe.calibrate.files import CalibrationError
from lightprobe.imaging import camera
from lightprobe.imaging.camera import CameraError

TEXT = """; my camera
[camera]
name = mine ; a good one
projection = equirect
width_px = 64
height_px = 32

[v4l2]
# as it streams best
format = mjpeg
exposure_delay_frames = 1

[response]
table = old.txt
"""
LINEAR = np.repeat(np.linspace(0, 1, 256)[:, None], 3, 1)


def test_values_are_replaced_or_added_and_the_rest_stays():
    text = camera_file.edited(TEXT, "v4l2", {"exposure_delay_frames": "3", "fps": "30"})
    expected = TEXT.replace("frames = 1\n", "frames = 3\nfps = 30\n")
    assert text == expected
    assert camera_file.edited(text, "v4l2", {"exposure_delay_frames": "3", "fps": "30"}) == text


def test_a_value_is_left_out():
    assert camera_file.edited("[a]\nb = 1\nc = 2\n", "a", {"b": None, "d": None}) == (
        "[a]\nc = 2\n"
    )


def test_a_response_says_what_the_camera_did(tmp_path):
    """And a later one, of which nothing is known, does not go on saying it."""
    path = tmp_path / "probe.camera"
    for processing, line in (
        (["sharpness", "gamma"], "processing = sharpness, gamma\n"),
        ([], "processing = none\n"),
        (None, ""),
    ):
        table = camera_file.save_response(path, (64, 32), LINEAR, "", processing)
        assert path.read_text().endswith(f"[response]\ntable = {table.name}\n{line}")


def test_a_section_is_added_at_the_end():
    assert camera_file.edited("[camera]\na = 1\n", "new", {"b": "2"}) == (
        "[camera]\na = 1\n\n[new]\nb = 2\n"
    )
    assert camera_file.edited("", "new", {"b": "2"}) == "[new]\nb = 2\n"


def test_a_new_file_is_a_good_one(tmp_path):
    path = tmp_path / "probe.camera"
    camera_file.save(path, (640, 320), "v4l2", {"exposure_delay_frames": "2"})
    loaded = camera.load(str(path))
    assert (loaded.name, loaded.width_px, loaded.height_px) == ("probe", 640, 320)
    assert loaded.is_equirect


def test_tables_are_numbered_and_the_old_one_stays(tmp_path):
    path = tmp_path / "probe.camera"
    first = camera_file.save_response(path, (64, 32), LINEAR, "one")
    second = camera_file.save_response(path, (64, 32), LINEAR**2, "two")
    assert (first.name, second.name) == ("probe.response-1.txt", "probe.response-2.txt")
    assert np.allclose(camera.load(str(path)).response, LINEAR**2, atol=1e-7)
    assert np.allclose(camera.read_table(first), LINEAR, atol=1e-7)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(
        [path.name, f"{path.name}.~1~", first.name, second.name]
    )
    assert "response-1" in (tmp_path / f"{path.name}.~1~").read_text()


def test_a_broken_file_is_not_touched(tmp_path):
    path = tmp_path / "probe.camera"
    path.write_text("[camera]\nprojection = cube\n")
    with pytest.raises(CameraError, match="projection"):
        camera_file.save(path, (64, 32), "v4l2", {"fps": "30"})
    assert path.read_text() == "[camera]\nprojection = cube\n"
    path.write_text(TEXT.replace("[camera]", "[camera]\nversion = 2"))
    with pytest.raises(CameraError, match="version"):
        camera_file.save(path, (64, 32), "v4l2", {"fps": "30"})


def test_a_write_that_fails_leaves_the_old(tmp_path, monkeypatch):
    path = tmp_path / "probe.camera"
    path.write_text(TEXT.replace("table = old.txt\n", ""))
    before = path.read_bytes()

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(CalibrationError, match="No space left"):
        camera_file.save(path, (64, 32), "v4l2", {"fps": "30"})
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
