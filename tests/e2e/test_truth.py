"""The simulator's truth as a probe, beside the estimate of the daemon that looks at its room."""

import subprocess
import sys
from pathlib import Path

import numpy as np
from lightprobe import Client, Subscription
from lightprobe.geometry import equirect_directions
from web_daemon import free_port

LIGHTPROBE = Path(sys.executable).parent / "lightprobe"
LONG_S = 60
NORMALS = equirect_directions(16, 8).reshape(-1, 3)


def test_the_truth_is_what_a_good_estimate_comes_close_to(probe, tmp_path):
    truth = f"tcp:127.0.0.1:{free_port()}"
    options = ("--scenes", "procedural:1", "--truth-publish", truth)
    with (
        probe(tmp_path, *options, daemon_options=("--smoothing-ms=0",)) as uri,
        Client(uri, Subscription(sh_order=4, max_lights=8)) as estimated,
        Client(truth, Subscription(sh_order=4, max_lights=8, health_period_ms=0)) as exact,
    ):
        wanted = exact.receive(LONG_S)
        assert exact.hello.name == "truth"
        light = wanted.irradiance(NORMALS)
        close = (np.abs(e.irradiance(NORMALS) - light).max() < 0.1 * light.max()
                 for e in estimated.estimates(LONG_S))  # fmt: skip
        # The bracket adapts to the room first.
        assert any(is_close for is_close, _ in zip(close, range(200), strict=False))
        estimate = estimated.receive(LONG_S)
    strongest = wanted.lights[0]
    assert max(light.direction @ strongest.direction for light in estimate.lights) > 0.9999


def test_an_address_of_the_network_is_refused(tmp_path):
    done = subprocess.run(
        [LIGHTPROBE, "simulate", "--socket", tmp_path / "s", "--truth-publish", "tcp:0.0.0.0:7788"],
        capture_output=True, text=True, timeout=LONG_S,
    )  # fmt: skip
    assert done.returncode == 1
    assert "this machine only" in done.stderr
