"""--once: a finite source as one set, exactly one estimate on standard output, then the end."""

import math
import os
import pty
import subprocess

import numpy as np
import pytest
from harness import (
    BRACKET_INCOMPLETE,
    BUILD,
    LONG_S,
    Daemon,
    camera,
    jpeg,
    panorama,
    pfm,
    run,
    split,
    streaming,
)


def once(*arguments):
    """Exit status, the messages on standard output, and the log."""
    status, out, log = run(*arguments, "--once", "--publish=stdout:")
    messages, rest = split(out)
    assert rest == b""
    return status, messages, log


def only_estimate(messages):
    """Hello comes first on every connection; then one estimate, and nothing else."""
    assert [message.WhichOneof("message") for message in messages] == [
        "hello",
        "estimate",
    ]
    return messages[1].estimate


def test_one_picture(tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg())
    status, messages, _ = once(f"--source=file:{tmp_path}/a.jpg")
    estimate = only_estimate(messages)
    assert status == 0
    assert messages[0].hello.source == "file"
    assert messages[0].hello.protocol_major == 1
    assert estimate.sequence == 1
    assert estimate.sh.order == 4
    assert len(estimate.sh.coefficients) == 75
    assert len(estimate.lights) >= 1
    assert estimate.boot_id == messages[0].hello.boot_id
    assert not estimate.HasField("exposure_us")


def test_order_and_lights_as_asked(tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg())
    _, messages, _ = once(f"--source=file:{tmp_path}/a.jpg", "--sh-order=1", "--lights=0")
    estimate = only_estimate(messages)
    assert estimate.sh.order == 1
    assert len(estimate.lights) == 0
    assert (messages[0].hello.max_sh_order, messages[0].hello.max_lights) == (1, 0)


def test_a_bracket_is_one_set(tmp_path):
    for index in range(3):
        (tmp_path / f"{index}.jpg").write_bytes(jpeg(panorama(level=20 * (index + 1))))
    status, messages, _ = once(f"--source=file:{tmp_path}?exposures_us=1000,4000,16000")
    estimate = only_estimate(messages)
    assert status == 0
    assert estimate.exposure_count == 3
    assert estimate.exposure_us == 16000
    assert not estimate.flags & BRACKET_INCOMPLETE


def test_float_pictures_of_both_kinds(tmp_path):
    radiance = np.full((64, 128), 2.0, np.float32)
    for name, picture in (
        ("grey", radiance),
        ("rgb", np.stack([radiance] * 3, axis=2)),
    ):
        (tmp_path / f"{name}.pfm").write_bytes(pfm(picture))
        status, messages, _ = once(f"--source=file:{tmp_path}/{name}.pfm")
        assert status == 0
        sh = only_estimate(messages).sh
        # A furnace of radiance 2: L_0 = 2 * 4 pi * Y_0 = 2 * sqrt(4 pi).
        assert sh.coefficients[:3] == pytest.approx([2 * np.sqrt(4 * np.pi)] * 3, rel=1e-3)


def test_raw_pictures_need_their_size(tmp_path):
    (tmp_path / "a.yuyv").write_bytes(bytes([128]) * 128 * 64 * 2)
    status, messages, log = once(f"--source=file:{tmp_path}/a.yuyv")
    assert (status, [m.WhichOneof("message") for m in messages]) == (1, ["hello"])
    assert "raw pixels do not contain their size — give ?size=WxH" in log
    status, messages, _ = once(f"--source=file:{tmp_path}/a.yuyv?size=128x64")
    assert status == 0
    only_estimate(messages)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.jpg", b"", "no picture in it — is it empty, damaged, or of another kind?"),
        ("a.jpg", b"this is no picture", "no picture in it"),
        ("a.jpg", jpeg()[:500], "a picture is cut off or damaged"),
        ("a.pfm", b"PF\n128 64\n-1\n" + bytes(500), "a picture is cut off or damaged"),
        ("a.pfm", b"PF\n0 0\n-1\n", "not a picture of its kind"),
        ("a.bin", b"\x89PNG\r\n", "neither the name nor the first bytes tell the format"),
        ("a.jpg", jpeg()[:2] + bytes(100), "no picture in it"),
    ],
)
def test_no_estimate_is_exit_status_1(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    status, messages, log = once(f"--source=file:{tmp_path}/{name}")
    assert status == 1
    assert [m.WhichOneof("message") for m in messages] == ["hello"]
    assert message in log


def test_empty_folder_and_folder_without_pictures(tmp_path):
    status, _, log = once(f"--source=file:{tmp_path}")
    assert status == 1
    assert f"file: {tmp_path}: list: no picture in this folder" in log
    (tmp_path / "notes.txt").write_text("no picture")
    status, _, log = once(f"--source=file:{tmp_path}")
    assert status == 1
    assert "1 files are left out: their names are not those of pictures" in log


def test_a_damaged_member_of_a_set_is_told(tmp_path):
    """The others still make an estimate, and it says that one is missing."""
    for index in range(3):
        content = jpeg()
        (tmp_path / f"{index}.jpg").write_bytes(content[:300] if index == 1 else content)
    status, messages, log = once(f"--source=file:{tmp_path}?exposures_us=1000,4000,16000")
    assert status == 0
    assert only_estimate(messages).flags & BRACKET_INCOMPLETE
    assert "1.jpg: read: a picture is cut off or damaged" in log


def test_an_unreadable_member_of_a_set_is_a_failure(tmp_path):
    (tmp_path / "0.jpg").write_bytes(jpeg())
    (tmp_path / "1.jpg").write_bytes(b"")
    status, messages, _ = once(f"--source=file:{tmp_path}?exposures_us=1000,4000")
    assert status == 1
    assert [m.WhichOneof("message") for m in messages] == ["hello"]


@pytest.mark.parametrize("numbers", ["exposures_us=1000,4000", "exposures_us=1000,2000,4000,8000",
                                     "exposures_us=1000&wheel_deg=0,90"])  # fmt: skip
def test_numbers_that_are_not_one_for_each_picture_are_refused(tmp_path, numbers):
    """One of them would be another picture's: 54.8 became 0.86, and nothing said so."""
    for index in range(3):
        (tmp_path / f"{index}.jpg").write_bytes(jpeg())
    status, messages, log = once(f"--source=file:{tmp_path}?{numbers}")
    assert status == 1
    assert [m.WhichOneof("message") for m in messages] == ["hello"]
    count = numbers.rpartition("=")[2].count(",") + 1
    assert f"3 pictures, but {count} numbers in" in log
    status, _, _ = once(f"--source=file:{tmp_path}?exposures_us=1000")
    assert status == 0


def test_from_a_camera_the_first_estimate_counts():
    with camera() as cam, Daemon(f"--source=sim:{cam.path}", "--once") as daemon:
        cam.accept()
        cam.send(jpeg())
        out = daemon.process.stdout.read()
        assert daemon.wait() == 0
        only_estimate(split(out)[0])


def test_a_camera_that_does_not_tell_its_exposure_is_given_the_frames_that_it_needs():
    """Its first frames give no estimate: which exposure they have must be found out first."""
    with camera() as cam, Daemon(f"--source=sim:{cam.path}", "--once") as daemon:
        cam.accept()
        with streaming(cam, jpeg(), exposure_us=math.nan):
            out = daemon.process.stdout.read()
        assert daemon.wait() == 0, daemon.log()
        only_estimate(split(out)[0])


def test_standard_output_must_not_be_a_terminal(tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg())
    master, terminal = pty.openpty()
    done = subprocess.run(
        [BUILD / "asan/bin/lightprobed", f"--source=file:{tmp_path}/a.jpg", "--once"],
        stdout=terminal,
        stderr=subprocess.PIPE,
        timeout=LONG_S,
    )
    os.close(master)
    os.close(terminal)
    assert done.returncode == 1
    assert b"stdout:: open: standard output is a terminal" in done.stderr


def test_standard_output_to_a_file_is_appended(tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg())
    out = tmp_path / "out"
    for _ in range(2):
        with open(out, "ab") as file:
            subprocess.run(
                [
                    BUILD / "asan/bin/lightprobed",
                    f"--source=file:{tmp_path}/a.jpg",
                    "--once",
                ],
                stdout=file,
                check=True,
                timeout=LONG_S,
            )
    messages, rest = split(out.read_bytes())
    assert len(messages) == 4
    assert rest == b""
