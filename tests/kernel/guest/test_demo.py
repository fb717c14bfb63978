# SPDX-License-Identifier: Apache-2.0
"""What a user with a camera runs: `make demo CAMERA=v4l2:...`, and the client's commands."""

import json
import os
from pathlib import Path

import pytest
from camera import load_drivers
from machine import run

BUILD = Path(os.environ["LP_BUILD"])
LIGHTPROBE = str(BUILD.parent / "venv" / "bin" / "lightprobe")
SOURCE = "v4l2:/dev/video0?size=640x320"


@pytest.fixture(scope="module", autouse=True)
def _drivers():
    load_drivers()


@pytest.fixture(autouse=True)
def _plugged(camera):
    assert str(camera.plug()) == "/dev/video0"


def test_watch_prints_estimates(start):
    daemon = start(SOURCE)
    daemon.wait_estimate()
    printed = run(LIGHTPROBE, "watch", f"unix:{daemon.path}", "--json", "--count=3", timeout_s=400)
    estimates = [json.loads(line) for line in printed.splitlines() if line.startswith("{")]
    assert len(estimates) == 3
    # The lamp of the camera's pattern is ahead.
    x, _, z = estimates[-1]["lights"][0]["direction"]
    assert abs(x) < 0.02
    assert z < 0


@pytest.mark.nightly
def test_demo_with_a_camera(monkeypatch, tmp_path, record_property):
    """The very command of `make demo CAMERA=...`; panoramas are not needed for it."""
    monkeypatch.setenv("LIGHTPROBED", str(BUILD / "bin" / "lightprobed"))
    monkeypatch.setenv("LIGHTPROBE_SCENES", str(tmp_path))
    printed = run(
        LIGHTPROBE, "demo", "--seconds=40", f"--source={SOURCE}", f"--output={tmp_path}", "--json",
        timeout_s=500,
    )  # fmt: skip
    summary = json.loads(printed[printed.index("{") :])
    record_property("figure", f"demo: {summary['estimates']} estimates from the camera in 40 s")
    assert summary["estimates"] > 0
    assert summary["frames_rejected"] == 0
    assert (tmp_path / "camera.png").stat().st_size > 10000
