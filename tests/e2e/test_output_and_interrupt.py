"""Full disks, readers that leave, and Ctrl-C at any moment: no traceback, and nothing lost."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from lightprobe import __main__ as program
from lightprobe.imaging import image

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
LONG_S = 120


@pytest.fixture
def picture(tmp_path):
    path = tmp_path / "grey.pfm"
    image.write_pfm(path, np.full((32, 64, 3), 0.5))
    return path


def run(*words, **popen):
    return subprocess.run(
        [LIGHTPROBE, *map(str, words)], stderr=subprocess.PIPE, text=True, timeout=LONG_S, **popen
    )


@pytest.mark.parametrize(
    "words",
    ["--version", "--help", "estimate grey.pfm", "estimate grey.pfm --json", "doctor --wait 0.1",
     "doctor --wait 0.1 --json", "watch unix:nobody --seconds 1",
     "evaluate --scenes grey.pfm --jobs 1 --json", "evaluate --scenes grey.pfm --jobs 1"],
)  # fmt: skip
def test_a_full_disk_is_one_sentence(words, picture):
    with open("/dev/full", "w") as full:
        done = run(*words.split(), stdout=full, cwd=picture.parent)
    assert done.returncode == 1
    assert "lightprobe: output: No space left on device" in done.stderr
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr


def test_a_reader_that_leaves_ends_it_silently(picture):
    reads, writes = os.pipe()
    os.close(reads)
    with os.fdopen(writes, "w") as closed:
        done = run("estimate", picture, "--json", stdout=closed)
    assert done.returncode == 1
    assert done.stderr == ""


@pytest.mark.parametrize("option", ["--json-file", "--plot"])
def test_figures_are_shown_though_the_disk_is_full(option, picture, tmp_path):
    """Minutes of work must not be lost to the file that they were to be written to."""
    link = tmp_path / "figures.png"
    link.symlink_to("/dev/full")
    done = run("evaluate", "--scenes", picture, "--jobs", 1, option, link, stdout=subprocess.PIPE)
    assert done.returncode == 1
    assert "relighting MAE" in done.stdout
    assert f"lightprobe: evaluate: {link}: write: No space left on device\n" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("words", ["evaluate --scenes room", "simulate", "demo --scenes room"])
def test_ctrl_c_while_scenes_are_loaded(words, capsys, monkeypatch, tmp_path):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("lightprobe.sim.scenes.load", interrupt)
    monkeypatch.setattr("lightprobe.cli.demo.simulation", interrupt)
    monkeypatch.setattr(sys, "argv", ["lightprobe", *words.split()])
    with pytest.raises(SystemExit) as done:
        program.main()
    assert done.value.code == 130
    assert "Traceback" not in capsys.readouterr().err


def loads_numpy(process):
    return "_multiarray_umath" in Path(f"/proc/{process.pid}/maps").read_text()


def has_children(process):
    return Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().strip()


@pytest.mark.parametrize(
    ("words", "stage"),
    [
        ("evaluate --scenes room", loads_numpy),
        ("simulate --socket s", loads_numpy),
        ("demo --scenes room --output out", loads_numpy),
        ("demo --scenes room --output out", has_children),
        ("watch unix:nobody", loads_numpy),
    ],
)
def test_ctrl_c_in_the_middle_of_the_start(words, stage, tmp_path):
    """As a terminal does it, to the whole group; children must not complain either."""
    process = subprocess.Popen(
        [LIGHTPROBE, *words.split()], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        cwd=tmp_path, start_new_session=True,
    )  # fmt: skip
    deadline = time.monotonic() + LONG_S
    while process.poll() is None and not stage(process):
        assert time.monotonic() < deadline
        time.sleep(0.002)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=LONG_S)
    assert process.returncode in (0, 130)
    assert "Traceback" not in err, err
    assert "KeyboardInterrupt" not in err
